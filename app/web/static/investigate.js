// What is to be investigated: each column of a log becomes a channel, and what is wrong or missing stands at its column.
"use strict";
import { all, answered, one } from "./import.js";
import { drawAnew } from "./plots.js";

const TIME = "time_s";
const FACTOR = ["factor", "times 1"];
const CONSTANTS = { A: ["factor", "N m per A"], "%": ["factor", "N m per %"], count: ["counts_per_rev", "counts per turn"], format: ["format", "%d.%m.%Y %H:%M:%S,%f"] };
const SETTLED_MS = 400; // after the last change
const SOUNDS = /\.(wav|flac|caf|amr|mka|ogg|opus|mp3|m4a|aac|webm)$/i;
const MOVING = "joint:is([type=revolute], [type=continuous], [type=prismatic]):not(:has(mimic))";
const rounded = (value) => +value.toPrecision(6);
const without = (name, names) => names.filter((each) => each !== name);

export function investigation(form) {
  const { root, investigate } = form.dataset;
  const units = JSON.parse(investigate);
  const field = (name) => form.elements[name];
  const [table, body, status, problem, map, rate, store, lacks, offset] = ["[data-columns]", "tbody", "[data-status]", "[data-problem-here]", "#channels", "#rate", "[data-store]", "[data-lacks]", "[data-offset]"].map((each) => one(each, form));
  const template = one("template", form).content;
  let [rows, joints, layout, reading, waiting] = [[], [], {}, 0, 0];
  let [isNeeded, isEdited] = [false, false]; // the channel map
  const part = (row, name) => one(`[data-${name}]`, row.element);
  const channel = (row) => part(row, "channel").value;
  const joint = (row) => Number(part(row, "joint").value);
  const constant = (row) => CONSTANTS[part(row, "unit").value] ?? FACTOR;
  const taken = (name) => rows.filter((row) => channel(row) === name).sort((a, b) => joint(a) - joint(b));
  const isNew = () => field("subject").value === "new";
  const ofJoints = (name) => joints.length > 1 && name && name !== TIME;
  const words = (text) => Object.keys(units).reduce((said, name) => said.replaceAll(name, one(`option[value=${name}]`, template).textContent), text);
  function post(path, left = []) {
    const sent = new FormData(form);
    left.forEach((name) => sent.delete(name));
    return answered(root + path, field("csrf").value, { method: "POST", body: sent });
  }

  /* the table: what a log has, and what each column is taken for */
  function seen({ rises, speed_of: position, moves }, place, columns) {
    const pairs = columns.map((each, k) => [each.speed_of, k]).filter(([of]) => of !== undefined);
    const numbers = ([of, speed]) => `columns ${of + 1} and ${speed + 1}`;
    const pair = pairs.find(([of, speed]) => of === place || (moves && place > speed && speed - of > 1 && (place - speed) % (speed - of) === 0));
    if (rises) return "always rises";
    if (position !== undefined) return `looks like the speed of column ${position + 1}`;
    if (!pair) return moves && !pairs.length ? "moves" : "";
    return pair[0] === place ? `its speed is column ${pair[1] + 1}` : `same joint as ${numbers(pair)}, by its place`;
  }
  function added(column, place, columns) {
    body.append(template.cloneNode(true));
    const isNamed = /\D/.test(column.name);
    const row = { place, called: isNamed ? column.name : `column ${place + 1}`, element: body.lastElementChild, given: {} };
    row.key = isNamed && columns.filter(({ name }) => name === column.name).length === 1 ? column.name : place + 1;
    part(row, "name").textContent = row.called;
    part(row, "does").textContent = seen(column, place, columns);
    for (const name of ["channel", "joint", "unit", "constant"]) part(row, name).setAttribute("aria-label", `${name} of ${row.called}`);
    part(row, "joint").replaceChildren(...joints.map((name, k) => new Option(name, k)));
    const chart = one("svg", row.element);
    chart.setAttribute("aria-label", `${row.called} over time`);
    chart.hidden = !column.y;
    if (!column.y) return row;
    one("path", chart).setAttribute("d", `M${column.y.map((y, k) => `${rounded((125 * k) / column.y.length)} ${rounded(30 - 30 * y)}`).join("L")}`);
    part(row, "first").textContent = column.first.map((value) => (column.time ? new Date(1000 * value).toISOString() : rounded(value))).join(", ");
    part(row, "range").textContent = column.time ? "" : `${rounded(column.low)} to ${rounded(column.high)}`;
    return row;
  }
  function choose(row, name, unit, which = 0, given = {}) {
    const known = without("sample", units[name] ?? []);
    row.given = given;
    part(row, "channel").value = name;
    part(row, "joint").value = which;
    part(row, "joint").hidden = !ofJoints(name);
    part(row, "unit").hidden = !name;
    part(row, "unit").replaceChildren(new Option("unit …", ""), ...known.map((each) => new Option(each)));
    measure(row, known.length === 1 ? known[0] : known.includes(unit) ? unit : "");
  }
  function measure(row, unit) {
    part(row, "unit").value = unit;
    const [input, [key, placeholder]] = [part(row, "constant"), constant(row)];
    Object.assign(input, { type: key === "format" ? "text" : "number", step: "any", placeholder, required: placeholder !== FACTOR[1], value: row.given[key] ?? "" });
    input.hidden = !channel(row) || (channel(row) === TIME && key !== "format");
  }
  function fill(found) {
    layout = Object.fromEntries(Object.entries(found).filter(([, value]) => typeof value !== "object"));
    rate.value = found[TIME]?.rate_hz ?? "";
    rows.forEach((row) => choose(row, ""));
    const own = rows.filter(({ key }) => units[key]).map(({ key }) => [key, { column: key }]);
    for (const [name, given] of Object.keys(found).length ? Object.entries(found) : own) {
      [given.column ?? []].flat().forEach((column, which) => {
        const row = rows.find(({ key, place }) => column === key || column === place + 1);
        const its = Object.fromEntries(Object.entries(given).map(([key, value]) => [key, Array.isArray(value) ? value[which] : value]));
        if (row) choose(row, name, its.unit ?? units[name][0], which, its);
      });
    }
  }
  function written() {
    const out = { schema: "gearcase-channels/1", ...layout };
    for (const name of Object.keys(units)) {
      const tables = taken(name).map((row) => {
        const [[key], { value }] = [constant(row), part(row, "constant")];
        return { ...row.given, column: row.key, unit: part(row, "unit").value, [key]: !value ? undefined : key === "format" ? value : Number(value) };
      });
      const keys = ["column", "unit", "factor", "counts_per_rev"].filter((key) => tables.some((each) => each[key] !== undefined));
      const lists = Object.fromEntries(keys.map((key) => [key, tables.map((each) => each[key] ?? (key === "factor" ? 1 : null))]));
      if (tables.length) out[name] = ofJoints(name) ? lists : tables[0];
    }
    if (Number(rate.value)) out[TIME] = { unit: "sample", rate_hz: Number(rate.value) };
    return JSON.stringify(out, null, 1);
  }

  /* what is missing or wrong stands at its field or column, and beside the button; the first of it, nothing where all is there */
  function say(at, text) {
    at.closest("details")?.setAttribute("open", "");
    at.after(problem);
    problem.textContent = text;
    return at;
  }
  function lacking() {
    const given = (...names) => names.some((name) => field(name)?.value);
    if (!given("subject", "axis", "robot", "urdf", "again", "diagnosis")) return [field("subject"), "Choose an axis or a robot."];
    if (isNew() && !given("new_name", "axis", "robot", "urdf")) return [field("new_name"), "Give the new axis a name."];
    return given("telemetry", "sound", "again", "diagnosis") ? null : [field("telemetry"), "Choose the log of the drive, or a sound."];
  }
  function outstanding() {
    const next = lacking() ?? missing();
    lacks.textContent = next ? `Not yet: ${next[1]}` : "";
    offset.hidden = !offset.dataset.offset && !field("sound")?.value;
    field("new_name").parentElement.hidden = !isNew();
  }
  function wrong(row, text) {
    part(row, "wrong").textContent = text;
    part(row, "channel").setAttribute("aria-invalid", Boolean(text));
    return text && part(row, "channel");
  }
  function faults(row) {
    const others = taken(channel(row)).filter((each) => !ofJoints(channel(row)) || joint(each) === joint(row));
    if (!channel(row)) return "";
    if (others[0].place < row.place) return `${others[0].called} is this already: choose one of them.`;
    if (!part(row, "unit").value) return "Choose its unit.";
    const { required, value, validity } = part(row, "constant"); // what is disabled while a log is read is valid
    if (validity.badInput || (required && !value)) return `Give the number beside its unit: ${constant(row)[1]}${constant(row) === CONSTANTS.A ? "; 1 if nobody knows it, and read A for N m in what is found" : ""}.`;
    const lacking = ofJoints(channel(row)) && joints.length - taken(channel(row)).length;
    return lacking > 0 ? `A column for each joint is needed, ${lacking} are not chosen.` : "";
  }
  function missing() {
    const [first] = rows.filter((row) => wrong(row, faults(row)));
    if (first) return [part(first, "channel"), `${first.called}: ${faults(first)}`];
    if (!rows.length) return null;
    if (!taken(TIME).length && !Number(rate.value)) return [rate, "Choose the column that is the time, or give the rows per second."];
    return taken("").length + taken(TIME).length < rows.length ? null : [rate, "Choose what the other columns are: torque or current, and position or speed."];
  }
  function refused({ message }) {
    if (isNew() && message.startsWith("There is an axis")) return say(field("new_name"), message);
    const named = message.match(/the column (.+?) holds/)?.[1];
    const fits = rows.filter((row) => channel(row) && (String(row.key) === named || message.includes(channel(row))));
    const row = fits.find((each) => message.includes(`${joints[joint(each)]}: `)) ?? fits[0];
    if (row) return wrong(row, words(message));
    const files = ["telemetry", "sound", "as_new", "urdf", "axis"].filter((name) => field(name)?.value);
    const about = files.find((name) => [...field(name).files].some((file) => message.includes(file.name)) || message.includes(`'${name}'`));
    return say(field((about ?? (field("subject").value && files[0])) || "subject"), words(message));
  }
  function changed() {
    if (isNeeded) map.value = written();
    if (problem.textContent !== lacking()?.[1]) problem.textContent = ""; // columns that were read meanwhile mend nothing
    outstanding();
    clearTimeout(waiting);
    if (rows.length && !missing() && joints.length < 2) waiting = setTimeout(readLog, SETTLED_MS);
  }

  async function columns(text = "") {
    const [number, [file, ...others]] = [++reading, field("telemetry").files];
    table.hidden = !file && !field("again");
    if (table.hidden) return outstanding();
    [map.value, isEdited, status.textContent, table.disabled] = [text, Boolean(text), "Reading the columns …", true];
    const said = await post("investigations/columns", ["sound", "as_new"]).then((answer) => answer.json()).then((found) => {
      if (number !== reading) return "";
      joints = found.joints;
      body.replaceChildren();
      rows = found.columns.map(added);
      fill(found.map);
      isNeeded = Object.keys(found.map).length > 0;
      changed();
      const doubt = rows.every(({ called, key }) => called !== key) ? "The columns have no names: see by their courses which is the time, and which is what." : !found.doubt ? "Recognised by names and units." : `Their names do not tell enough: ${words(found.doubt).replace(/ \(the lines [^)]*\)/, "")}.`;
      return `${found.before ? "Filled in as in the last investigation of it." : doubt} ${others.length ? `The other logs are read the same way: ${others.map(({ name }) => name).join(", ")}.` : ""}`;
    }, ({ message }) => message);
    if (number === reading) [status.textContent, table.disabled] = [said, false];
  }
  table.addEventListener("change", ({ target }) => {
    const row = rows.find(({ element }) => element.contains(target));
    const name = row && channel(row);
    isNeeded = isEdited = true;
    if (target.matches("[data-channel]")) {
      const alike = taken(name).filter((each) => each !== row);
      const below = rows.slice(row.place + 1, row.place + joints.length);
      const leads = ofJoints(name) && (row.leads || (!alike.length && !below.some(channel))); // the next columns are of the other joints
      rows.forEach((each) => (each.leads = each === row && leads));
      choose(row, name, part(alike[0] ?? row, "unit").value, leads ? 0 : Math.max(0, joints.findIndex((_, k) => !alike.some((each) => joint(each) === k))));
      if (leads) below.forEach((each, k) => choose(each, name, "", k + 1));
    }
    if (target.matches("[data-unit]")) for (const each of ofJoints(name) ? taken(name) : [row]) measure(each, target.value);
    changed();
  });
  map.addEventListener("change", () => columns(map.value));
  field("telemetry").addEventListener("change", () => columns());

  /* axis or robot: a new one is described on its own page meanwhile, or stored from here */
  const described = () => columns(isEdited ? map.value : "");
  async function listed() {
    const [list, known] = [field("subject"), [...field("subject").options].map(({ value }) => value)];
    const page = new DOMParser().parseFromString(await (await fetch(form.action)).text(), "text/html");
    const fresh = all("#subject option", page).find(({ value }) => !known.includes(value));
    if (!fresh) return;
    one(`optgroup[label=${fresh.parentElement.label}]`, list).prepend(fresh);
    list.value = fresh.value;
    described();
  }
  one("[data-describe]", form)?.addEventListener("click", (event) => {
    event.preventDefault();
    open(event.target.href); // it may close itself then
  });
  addEventListener("storage", ({ key }) => key === "gearcase-axis" && listed());
  for (const name of ["subject", "axis", "robot"]) field(name).addEventListener("change", described);
  field("urdf").addEventListener("change", async ({ target }) => {
    if (!target.files.length) return described();
    const found = new DOMParser().parseFromString(await target.files[0].text(), "text/xml");
    const name = (element) => `name = ${JSON.stringify(element?.getAttribute("name"))}`;
    if (!field("robot").value.trim()) field("robot").value = [name(one("robot", found)), ...all(MOVING, found).map((each) => `[[joints]]\n${name(each)}`)].join("\n");
    field("robot").closest("details").open = true;
    if (store) store.hidden = false;
    columns();
  });
  store?.addEventListener("click", () => {
    const others = [...new FormData(form)].filter(([name, { size }]) => !["robot", "urdf", "axis"].includes(name) || size === 0);
    post("api/v1/robots", others.map(([name]) => name)).then(() => {
      for (const name of ["robot", "urdf", "axis"]) field(name).value = "";
      return listed();
    }, refused);
  });

  form.noValidate = true; // what is missing is said at its place
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const [button, lack] = [one(".primary", form), lacking() ?? missing()];
    button.disabled = true; // or a second press would ask for another one
    const at = lack ? lack[0] : await post("investigations/new").then(({ url }) => location.assign(url), refused);
    button.disabled = false;
    if (lack && !at.closest("tr")) say(...lack);
    at?.focus();
    at?.scrollIntoView({ block: "center" });
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
    const lines = series.map(({ name, style }) => {
      const line = Object.assign(document.createElement("li"), { className: "line" });
      line.innerHTML = `<svg viewBox="0 0 24 8" class="chart" aria-hidden="true"><path class="series s${style}" d="M0 4H24"/></svg>`;
      line.append(name);
      return line;
    });
    one(".legend", section).replaceChildren(...lines);
    drawAnew(one(".plot", section), { x: log.x, series, x_label: "time [s]", y_label: "share of the largest" });
  }
  async function looked(left, take, fails) {
    const number = ++last;
    [section.hidden, said.textContent] = [false, "Reading …"];
    const words = await post("investigations/preview", left).then((answer) => answer.json()).then(take).catch(fails);
    if (number === last) said.textContent = words ?? (log ? `${log.rows} rows, ${+log.seconds.toPrecision(4)} s` : "");
    show();
  }
  function readLog() {
    log = null;
    remarks.replaceChildren();
    const take = (found) => {
      log = found;
      remarks.replaceChildren(...log.remarks.map((textContent) => Object.assign(document.createElement("li"), { textContent })));
    };
    looked(["sound", "as_new"], take, (error) => void refused(error));
  }
  field("sound")?.addEventListener("change", () => {
    sound = null;
    if (!field("sound").files.length) return show(); // that of a diagnosis is there already
    looked(["as_new", "telemetry", "again"], (found) => void (sound = found), ({ message }) => message);
  });
  field("sound_offset_s").addEventListener("input", show);
  for (const each of ["change", "input"]) form.addEventListener(each, outstanding);
  outstanding();
  if (field("again")) columns(map.value);

  /* files that are dropped, each where it belongs */
  return async (files) => {
    const kinds = { urdf: [], axis: [], sound: [], telemetry: [] };
    for (const file of files) {
      const text = /\.(toml|json)$/i.test(file.name) && (await file.text());
      if (/^\s*\[\[joints\]\]|"joints"\s*:/m.test(text)) field("robot").value = text;
      else kinds[/\.(urdf|xml)$/i.test(file.name) ? "urdf" : text ? "axis" : SOUNDS.test(file.name) ? "sound" : "telemetry"].push(file);
    }
    const given = Object.keys(kinds).filter((name) => kinds[name].length && field(name));
    for (const name of given) {
      const data = new DataTransfer();
      kinds[name].forEach((file) => data.items.add(file));
      field(name).files = data.files;
    }
    for (const name of without("axis", without("telemetry", given))) field(name).dispatchEvent(new Event("change"));
    if (!given.includes("urdf")) (given.includes("telemetry") ? columns : described)();
  };
}
