// Interactive plots over what the server has drawn: a [data-plot] element holds an SVG and names its JSON.
// Plots with the same data-cursor share one cursor; colours come from the style sheet and follow the theme.
"use strict";

const probe = document.createElement("span");
probe.hidden = true;
document.body.append(probe);

// a colour of the style sheet as it is in the theme of now, for canvases
export function style(name) {
  probe.style.color = `var(${name})`;
  return getComputedStyle(probe).color;
}

// colour and stroke by number, as `.series.s1` and so on in the style sheet
const COLOURS = [, "--plot-1", "--plot-2", "--plot-3", "--plot-4", "--ink", "--ink-soft", "--plot-4"];
const DASHES = [, undefined, [6, 3], [2, 3], [8, 3, 2, 3], [9, 3], [1.5, 2.5], undefined];
const FEW = 24; // so few values are drawn as dots besides
const plots = [];

function number(value) {
  if (value === null || value === undefined) return "–";
  return Math.abs(value) >= 1e4 || (value !== 0 && Math.abs(value) < 1e-3) ? value.toExponential(2) : String(+value.toPrecision(4));
}

function annotate(data) {
  return (u) => {
    const [{ ctx }, px] = [u, devicePixelRatio];
    const { left: start, top, width, height } = u.bbox;
    const [edge, bottom] = [start + width, top + height];
    const within = (marks) => marks.map((mark) => ({ ...mark, at: u.valToPos(mark.x, "x", true) })).filter(({ at }) => at >= start && at <= edge).sort((a, b) => a.at - b.at);
    function upright(x) {
      ctx.beginPath();
      ctx.moveTo(x, top);
      ctx.lineTo(x, bottom);
      ctx.stroke();
    }
    // words at x, in the first of three rows in which they cover none; `ends` of the words of each row, `y` of a row
    function write(text = "", x, ends, y) {
      const wide = ctx.measureText(text).width;
      const left = Math.min(x + 4 * px, edge - wide);
      const row = Math.max(0, ends.findIndex((end) => end < left));
      if (text) ends[row] = left + wide + 6 * px;
      ctx.save();
      ctx.setLineDash([]);
      [ctx.lineWidth, ctx.strokeStyle] = [3 * px, style("--sheet")];
      ctx.strokeText(text, left, y(row));
      ctx.restore();
      ctx.fillText(text, left, y(row));
    }
    ctx.save();
    ctx.font = `${11 * px}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    ctx.textBaseline = "alphabetic";
    ctx.fillStyle = style("--plot-band");
    for (const band of data.bands ?? []) {
      const [high, low] = [band.high, band.low].map((y) => Math.min(Math.max(u.valToPos(y, "y", true), top), bottom));
      ctx.fillRect(start, high, width, low - high);
    }
    const feet = [-Infinity, -Infinity, -Infinity]; // rows from the bottom
    for (const stretch of [...(data.stretches ?? [])].sort((a, b) => a.start - b.start)) {
      const low = Math.max(u.valToPos(stretch.start, "x", true), start);
      const high = Math.min(Math.max(u.valToPos(stretch.end, "x", true), low + 2 * px), edge);
      if (high <= low) continue;
      ctx.fillStyle = style("--plot-stretch");
      ctx.fillRect(low, top, high - low, height);
      ctx.strokeStyle = style("--ink-soft");
      ctx.setLineDash([2 * px, 2 * px]);
      [low, high].forEach(upright);
      ctx.fillStyle = style("--ink");
      write(stretch.text, low, feet, (row) => bottom - (5 + 13 * row) * px);
    }
    ctx.strokeStyle = ctx.fillStyle = style("--ink-faint");
    ctx.setLineDash([4 * px, 4 * px]);
    const heads = [-Infinity, -Infinity, -Infinity];
    for (const { at, text } of within(data.markers ?? [])) {
      upright(at);
      write(text, at, heads, (row) => top + (12 + 13 * row) * px);
    }
    ctx.fillStyle = style("--event");
    for (const { at } of within((data.events ?? []).map((x) => ({ x })))) {
      ctx.beginPath();
      ctx.moveTo(at - 5 * px, top);
      ctx.lineTo(at + 5 * px, top);
      ctx.lineTo(at, top + 8 * px);
      ctx.fill();
    }
    ctx.restore();
  };
}

// the legend of the server stays; under the cursor it says the values
function values(element, data) {
  const legend = element.nextElementSibling?.matches(".legend") ? element.nextElementSibling : null;
  const lines = [...(legend?.querySelectorAll(".line") ?? [])].slice(0, data.series.length);
  const [, unit] = data.x_label.match(/\[([^\]]*)\]$/) ?? [];
  const said = lines.map((line) => line.querySelector("output") ?? line.appendChild(document.createElement("output")));
  return (u) => {
    const at = u.cursor.idx;
    const x = at === null || at === undefined ? null : data.x[at];
    lines.forEach((_line, k) => {
      said[k].textContent = x === null ? "" : ` ${number(data.series[k].y[at])} at ${number(x)}${unit && unit !== "1" ? ` ${unit}` : ""}`;
    });
  };
}

// the range of a trend stands in the address, so that a link holds it; all trends of the page follow
function ranged(element) {
  const keep = (since, until) => {
    const address = new URL(location);
    for (const [name, value] of [["from", since], ["to", until]]) value ? address.searchParams.set(name, value) : address.searchParams.delete(name);
    return address;
  };
  element.addEventListener("dblclick", () => location.assign(keep()));
  return (u) => {
    const [min, max] = [u.select.left, u.select.left + u.select.width].map((left) => u.posToVal(left, "x"));
    const { since, unitS } = element.dataset;
    history.replaceState(null, "", keep(...[min, max].map((x) => new Date(Date.parse(since) + 1000 * unitS * x).toISOString())));
    for (const one of plots) if (one.element.dataset.since && one.plot !== u) one.plot.setScale("x", { min, max });
  };
}

// in the place of the drawing that is there
export function drawAnew(element, data) {
  for (const one of plots.filter((each) => each.element === element)) plots.splice(plots.indexOf(one), 1)[0].plot.destroy();
  element.querySelectorAll("svg.chart").forEach((svg) => svg.remove());
  const around = (_, low, high) => uPlot.rangeNum(Math.min(low, ...data.bands.map((band) => band.low)), Math.max(high, ...data.bands.map((band) => band.high)), 0.1, true);
  const axis = (label) => ({
    label,
    labelSize: 20,
    labelGap: 0,
    gap: 4,
    size: 26,
    labelFont: "12px system-ui, sans-serif",
    font: "11px system-ui, sans-serif",
    stroke: style("--ink-soft"),
    grid: { stroke: style("--plot-grid"), width: 1 },
    ticks: { stroke: style("--line-strong"), width: 1, size: 5 },
    values: (_, splits) => splits.map((value) => (value === null ? "" : String(+value.toPrecision(4)))), // small ones too
  });
  const options = {
    width: Math.max(element.clientWidth, 240),
    height: Number(element.dataset.height ?? 240),
    cursor: { sync: element.dataset.cursor ? { key: element.dataset.cursor } : undefined, drag: { x: true, y: false } },
    scales: { x: { time: false }, y: data.logarithmic ? { distr: 3 } : data.bands?.length ? { range: around } : {} },
    axes: [axis(data.x_label), { ...axis(data.y_label), size: 54 }],
    series: [
      {},
      ...data.series.map((one) => ({
        stroke: style(COLOURS[one.style]),
        dash: DASHES[one.style],
        width: 1.25,
        spanGaps: Boolean(element.dataset.since),
        points: { show: data.x.length <= FEW, size: 6, fill: style(COLOURS[one.style]) },
      })),
    ],
    legend: { show: false },
    hooks: { draw: [annotate(data)], setCursor: [values(element, data)], setSelect: element.dataset.since ? [ranged(element)] : [] },
  };
  const plot = new uPlot(options, [data.x, ...data.series.map((one) => one.y)], element);
  plots.push({ element, data, plot });
  element.dataset.ready = "true";
  return plot;
}

function redraw() {
  for (const { element, data, plot } of [...plots]) {
    const { min, max } = plot.scales.x;
    drawAnew(element, data).setScale("x", { min, max });
  }
}

async function show(element) {
  const answer = await fetch(element.dataset.plot, { headers: { Accept: "application/json" } });
  if (answer.ok) drawAnew(element, await answer.json()); // or else the drawing of the server stays
}

export function start() {
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries.filter((one) => one.isIntersecting)) {
      seen.unobserve(entry.target);
      show(entry.target);
    }
  });
  document.querySelectorAll("[data-plot]").forEach((element) => seen.observe(element));
  let width = innerWidth;
  addEventListener("resize", () => {
    if (innerWidth === width) return;
    width = innerWidth;
    for (const { element, plot } of plots) plot.setSize({ width: Math.max(element.clientWidth, 240), height: plot.height });
  });
  for (const query of ["(prefers-color-scheme: dark)", "print"]) matchMedia(query).addEventListener("change", redraw);
  addEventListener("gearcase:theme", redraw);
}

// where the sound stands, in every plot over time
export function playhead(seconds) {
  for (const { element, plot } of plots) {
    if (element.dataset.cursor === "time") plot.setCursor({ left: plot.valToPos(seconds, "x"), top: plot.over.clientHeight / 2 }, false);
  }
}
