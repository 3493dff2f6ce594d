// What is to be investigated: each column of a log becomes a channel, and what is wrong or missing stands at its column.
"use strict";
import { all, one } from "./import.js";
import { drawAnew } from "./plots.js";

const TIME = "time_s";
const CONSTANTS = { A: ["factor", "N m per A"], "%": ["factor", "N m per %"], count: ["counts_per_rev", "counts per turn"], format: ["format", "%d.%m.%Y %H:%M:%S,%f"] };
const FACTOR = ["factor", "times 1"];
const SETTLED_MS = 400; // after the last change
const SOUNDS = /\.(wav|flac|caf|amr|mka|ogg|opus|mp3|m4a|aac|webm)$/i;
const rounded = (value) => +value.toPrecision(6);
const entry = (value, joint) => (Array.isArray(value) ? value[joint] : value);

export function investigation(form) {
  const { root, investigate } = form.dataset;
  const units = JSON.parse(investigate);
  const field = (name) => form.elements[name];
  const [table, body, status, problem, map, rate, store] = ["[data-columns]", "tbody", "[data-status]", "[data-problem-here]", "#channels", "#rate", "[data-store]"].map((each) => one(each, form));
  const template = one("template", form).content;
  let [rows, joints, layout, reading, edited, waiting] = [[], [], {}, 0, false, 0];
  const part = (row, name) => one(`[data-${name}]`, row.element);
  const channel = (row) => part(row, "channel").value;
  const joint = (row) => Number(part(row, "joint").value);
  const constant = (row) => CONSTANTS[part(row, "unit").value] ?? FACTOR;
  const taken = (name) => rows.filter((row) => channel(row) === name).sort((a, b) => joint(a) - joint(b));
  const words = (text) => Object.keys(units).reduce((said, name) => said.replaceAll(name, one(`option[value=${name}]`, template).textContent), text);

  async function post(place, ...without) {
    const sent = new FormData(form);
    without.forEach((name) => sent.delete(name));
    const headers = { Accept: "application/json", "X-CSRF-Token": field("csrf").value };
    const answer = await fetch(root + place, { method: "POST", body: sent, headers }).catch(() => null);
    if (!answer) throw new Error("The service did not answer. Check that it runs, then try again.");
    if (!answer.ok) throw new Error((await answer.json()).detail);
    return answer;
  }

  /* the table: what a log has, and what each column is taken for */
  function added(column, place, columns) {
    body.append(template.cloneNode(true));
    const alone = columns.filter(({ name }) => name === column.name).length === 1 && /\D/.test(column.name);
    const row = { place, key: alone ? column.name : place + 1, element: body.lastElementChild, given: {} };
    row.called = /\D/.test(column.name) ? column.name : `column ${place + 1}`;
    part(row, "name").textContent = row.called;
    part(row, "does").textContent = column.rises ? "always rises" : column.moves ? "this one moves" : "";
    for (const name of ["channel", "joint", "unit", "constant"]) part(row, name).setAttribute("aria-label", `${name} of ${row.called}`);
    part(row, "joint").replaceChildren(...joints.map((name, k) => new Option(name, k)));
    const chart = one("svg", row.element);
    chart.setAttribute("aria-label", `${row.called} over time`);
    chart.hidden = !column.y;
    if (!column.y) return row;
    const points = column.y.map((y, k) => `${((125 * k) / column.y.length).toFixed(1)} ${30 - 30 * y}`);
    one("path", chart).setAttribute("d", `M${points.join("L")}`);
    part(row, "first").textContent = column.first.map((value) => (column.time ? new Date(1000 * value).toISOString() : rounded(value))).join(", ");
    part(row, "range").textContent = column.time ? "" : `${rounded(column.low)} to ${rounded(column.high)}`;
    return row;
  }
  function choose(row, name, unit, which = 0, given = {}) {
    const known = (units[name] ?? []).filter((each) => each !== "sample");
    row.given = given;
    part(row, "channel").value = name;
    part(row, "joint").value = which;
    part(row, "joint").hidden = joints.length < 2 || !name || name === TIME;
    part(row, "unit").hidden = !name;
    part(row, "unit").replaceChildren(new Option("unit …", ""), ...known.map((each) => new Option(each)));
    measure(row, known.length === 1 ? known[0] : known.includes(unit) ? unit : "");
  }
  function measure(row, unit) {
    part(row, "unit").value = unit;
    const [input, [key, hint]] = [part(row, "constant"), constant(row)];
    [input.type, input.step, input.placeholder, input.required] = [key === "format" ? "text" : "number", "any", hint, hint !== FACTOR[1]];
    input.hidden = !channel(row) || (channel(row) === TIME && key !== "format");
    input.value = row.given[key] ?? "";
  }
  function fill(found) {
    layout = Object.fromEntries(Object.entries(found).filter(([, value]) => typeof value !== "object"));
    rate.value = found[TIME]?.rate_hz ?? "";
    rows.forEach((row) => choose(row, ""));
    const own = rows.filter(({ key }) => units[key]).map(({ key }) => [key, { column: key }]);
    for (const [name, given] of Object.keys(found).length ? Object.entries(found) : own) {
      [given.column ?? []].flat().forEach((column, which) => {
        const row = rows.find(({ key, place }) => column === key || column === place + 1);
        const its = Object.fromEntries(Object.entries(given).map(([key, value]) => [key, entry(value, which)]));
        if (row) choose(row, name, its.unit ?? units[name][0], which, its);
      });
    }
  }
  function written() {
    const out = { schema: "gearcase-channels/1", ...layout };
    for (const name of Object.keys(units)) {
      const tables = taken(name).map((row) => {
        const [[key], { value }] = [constant(row), part(row, "constant")];
        const given = value && { [key]: key === "format" ? value : Number(value) };
        return { ...row.given, [key]: undefined, ...given, column: row.key, unit: part(row, "unit").value };
      });
      const keys = [...new Set(tables.flatMap(Object.keys))].filter((key) => tables.some((each) => each[key] !== undefined));
      const lists = Object.fromEntries(keys.map((key) => [key, tables.map((each) => each[key] ?? (key === "factor" ? 1 : null))]));
      if (tables.length) out[name] = joints.length > 1 && name !== TIME ? lists : tables[0];
    }
    if (Number(rate.value)) out[TIME] = { unit: "sample", rate_hz: Number(rate.value) };
    return JSON.stringify(out, null, 1);
  }

  /* what is missing or wrong: at its column, else below the form; the first of it, null where all is there */
  function wrong(row, text) {
    part(row, "wrong").textContent = text;
    part(row, "channel").setAttribute("aria-invalid", Boolean(text));
    return text ? row : null;
  }
  function faults(row) {
    const others = taken(channel(row)).filter((each) => each !== row && (joints.length < 2 || channel(row) === TIME || joint(each) === joint(row)));
    if (!channel(row)) return "";
    if (others.some(({ place }) => place < row.place)) return `${others[0].called} is this already: choose one of them.`;
    if (!part(row, "unit").value) return "Choose its unit.";
    if (!part(row, "constant").validity.valid) return `Give the number beside its unit: ${constant(row)[1]}.`;
    const lacking = joints.length > 1 && channel(row) !== TIME && joints.length - taken(channel(row)).length;
    return lacking > 0 ? `A column for each joint is needed, ${lacking} are not chosen.` : "";
  }
  function missing() {
    problem.textContent = "";
    const first = rows.map((row) => wrong(row, faults(row))).find(Boolean);
    if (first || !rows.length) return first ?? null;
    if (!taken(TIME).length && !Number(rate.value)) return "Choose the column that is the time, or give the rows per second.";
    return rows.some((row) => channel(row) && channel(row) !== TIME) ? null : "Choose what the other columns are: torque or current, and position or speed.";
  }
  function refused({ message }) {
    const named = message.match(/the column (.+?) holds/)?.[1];
    const fits = rows.filter((row) => channel(row) && (String(row.key) === named || message.includes(channel(row))));
    const row = fits.find((each) => message.includes(`${joints[joint(each)]}: `)) ?? fits[0];
    if (row) wrong(row, words(message));
    else problem.textContent = words(message);
    one("select", (row ?? { element: form }).element).focus();
  }
  function changed() {
    if (edited) map.value = written();
    clearTimeout(waiting);
    if (rows.length && missing() === null && joints.length < 2) waiting = setTimeout(readLog, SETTLED_MS);
  }

  async function columns(text = "") {
    const [number, [file, ...others]] = [++reading, field("telemetry").files];
    table.hidden = !file && !field("again");
    if (table.hidden) return;
    [map.value, status.textContent, table.disabled] = [text, "Reading the columns …", true];
    try {
      const found = await (await post("investigations/columns", "sound", "as_new")).json();
      if (number !== reading) return;
      joints = found.joints;
      body.replaceChildren();
      rows = found.columns.map(added);
      fill(found.map);
      edited = Object.keys(found.map).length > 0;
      let from = found.doubt && `Their names do not tell enough: ${words(found.doubt)}.`;
      if (rows.every(({ called, key }) => called !== key)) from = "The columns have no names: see by their courses which is the time, and which is what.";
      if (found.before) from = "Filled in as in the last investigation of it.";
      status.textContent = `${from} ${others.length ? `The other logs are read the same way: ${others.map(({ name }) => name).join(", ")}.` : ""}`;
      changed();
    } catch ({ message }) {
      if (number === reading) status.textContent = message;
    }
    if (number === reading) table.disabled = false;
  }
  table.addEventListener("change", ({ target }) => {
    const row = rows.find(({ element }) => element.contains(target));
    const [name, isOfJoints] = [row && channel(row), joints.length > 1];
    edited = true;
    if (target.matches("[data-channel]")) {
      const alike = taken(name).filter((each) => each !== row);
      const below = isOfJoints && name && name !== TIME && !alike.length ? rows.slice(row.place + 1, row.place + joints.length) : [];
      choose(row, name, alike[0] && part(alike[0], "unit").value, Math.max(0, joints.findIndex((_, k) => !alike.some((each) => joint(each) === k))));
      if (!below.some(channel)) below.forEach((each, k) => choose(each, name, "", k + 1)); // one for each joint
    }
    if (target.matches("[data-unit]")) for (const each of isOfJoints && name !== TIME ? taken(name) : [row]) measure(each, target.value);
    changed();
  });
  map.addEventListener("change", () => columns(map.value));
  field("telemetry").addEventListener("change", () => columns());

  /* axis or robot: a new one is described on its own page meanwhile, or stored from here */
  const described = () => columns(edited ? map.value : "");
  async function listed() {
    const [list, known] = [field("subject"), [...field("subject").options].map(({ value }) => value)];
    const page = new DOMParser().parseFromString(await (await fetch(form.action)).text(), "text/html");
    const fresh = all("#subject option", page).find(({ value }) => !known.includes(value));
    if (!fresh) return;
    one(`optgroup[label=${fresh.parentElement.label}]`, list).prepend(fresh);
    list.value = fresh.value;
    described();
  }
  field("subject").addEventListener("change", ({ target }) => {
    if (target.value !== "+") return described();
    target.value = "";
    open(`${root}describe`);
    addEventListener("focus", listed);
  });
  for (const name of ["axis", "robot"]) field(name).addEventListener("change", described);
  field("urdf").addEventListener("change", async ({ target }) => {
    const found = new DOMParser().parseFromString(await target.files[0].text(), "text/xml");
    const moving = all("joint:is([type=revolute], [type=continuous], [type=prismatic]):not(:has(mimic))", found);
    const joined = ["name = " + JSON.stringify(one("robot", found)?.getAttribute("name")), ...moving.map((each) => `[[joints]]\nname = ${JSON.stringify(each.getAttribute("name"))}`)];
    if (!field("robot").value.trim()) field("robot").value = joined.join("\n");
    field("robot").closest("details").open = true;
    if (store) store.hidden = false;
    columns();
  });
  store?.addEventListener("click", async () => {
    try {
      const others = [...new FormData(form)].filter(([name, value]) => !["robot", "urdf", "axis"].includes(name) || !(value.size ?? 1)).map(([name]) => name);
      await post("api/v1/robots", ...others);
      for (const name of ["robot", "urdf", "axis"]) field(name).value = "";
      await listed();
    } catch (error) {
      refused(error);
    }
  });

  /* files that are dropped, each where it belongs */
  async function dropped(files) {
    const kinds = { urdf: [], axis: [], sound: [], telemetry: [] };
    for (const file of files) {
      const text = /\.(toml|json)$/i.test(file.name) && (await file.text());
      if (/^\s*\[\[joints\]\]|"joints"\s*:/m.test(text)) field("robot").value = text;
      else kinds[/\.(urdf|xml)$/i.test(file.name) ? "urdf" : text ? "axis" : SOUNDS.test(file.name) ? "sound" : "telemetry"].push(file);
    }
    const given = Object.entries(kinds).filter(([name, its]) => its.length && field(name)).map(([name, its]) => {
      const data = new DataTransfer();
      its.forEach((file) => data.items.add(file));
      field(name).files = data.files;
      return name;
    });
    for (const name of ["sound", "urdf"].filter((each) => given.includes(each))) field(name).dispatchEvent(new Event("change"));
    if (!given.includes("urdf")) (given.includes("telemetry") ? columns : described)();
  }
  form.noValidate = true; // what is missing is said at its place
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const open = missing();
    if (open) {
      if (open.element) part(open, "channel").focus();
      else problem.textContent = open;
      return;
    }
    const button = one(".primary", form);
    button.disabled = true;
    await post("investigations/new").then(({ url }) => location.assign(url), refused);
    button.disabled = false;
  });

  /* log and sound laid over each other before anything is asked; the sound is moved by its offset */
  const section = one("[data-preview]", form);
  const [said, remarks] = ["[data-preview-said]", "[data-preview-remarks]"].map((each) => one(each, section));
  let [log, sound, last] = [null, null, 0];
  // the sound's level at a time of the log, none where it has not begun or has ended
  function level(seconds) {
    const at = (seconds - (Number(field("sound_offset_s").value) || 0)) / sound.step_s;
    const low = Math.floor(at);
    if (low < 0 || low + 1 >= sound.y.length) return null;
    return sound.y[low] + (at - low) * (sound.y[low + 1] - sound.y[low]);
  }
  function show() {
    section.hidden = !log && !sound;
    if (!log) return;
    const series = log.series.map(({ name, unit, largest, y }, k) => ({ name: `${name}, at most ${+largest.toPrecision(3)} ${unit}`, y, style: k + 1 }));
    if (sound) series.push({ name: "level of the sound", y: log.x.map(level), style: 3 });
    const lines = series.map(({ name, style: number }) => {
      const line = Object.assign(document.createElement("li"), { className: "line" });
      line.innerHTML = `<svg viewBox="0 0 24 8" class="chart" aria-hidden="true"><path class="series s${number}" d="M0 4H24"/></svg>`;
      line.append(name);
      return line;
    });
    one(".legend", section).replaceChildren(...lines);
    drawAnew(one(".plot", section), { x: log.x, series, x_label: "time [s]", y_label: "share of the largest" });
  }
  async function looked(without, take, fails) {
    const number = ++last;
    [section.hidden, said.textContent] = [false, "Reading …"];
    try {
      take(await (await post("investigations/preview", ...without)).json());
      if (number === last) said.textContent = log ? `${log.rows} rows, ${+log.seconds.toPrecision(4)} s` : "";
    } catch (error) {
      if (number === last) said.textContent = fails(error) ?? "";
    }
    show();
  }
  function readLog() {
    log = null;
    remarks.replaceChildren();
    const take = (found) => {
      log = found;
      remarks.replaceChildren(...log.remarks.map((textContent) => Object.assign(document.createElement("li"), { textContent })));
    };
    looked(["sound", "as_new"], take, refused);
  }
  field("sound")?.addEventListener("change", () => {
    sound = null;
    if (!field("sound").files.length) return show(); // that of a diagnosis is there already
    looked(["as_new", "telemetry", "again"], (found) => (sound = found), ({ message }) => message);
  });
  field("sound_offset_s").addEventListener("input", show);
  if (field("again")) columns(map.value);
  return dropped;
}
