// Many recordings at once: a table of what their names and sounds tell, edited in place, sent together as one step.
"use strict";

export const one = (selector, root = document) => root.querySelector(selector);
export const all = (selector, root = document) => [...root.querySelectorAll(selector)];
const LONGEST_WAIT_MS = 120_000; // while the service is busy
const SAME = 1e-4; // distance of a case below which its sound is the same
const random = () => [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
const link = (href, textContent) => Object.assign(document.createElement("a"), { href, textContent });

/* the service's answer, asked again while it is busy; what it refuses is thrown in its words */
export async function answered(path, csrf, { headers, ...options }) {
  for (const since = Date.now(); ; ) {
    const answer = await fetch(path, { ...options, headers: { Accept: "application/json", "X-CSRF-Token": csrf, ...headers } }).catch(() => null);
    if (!answer) throw new Error("The service did not answer. Check that it runs, then send again.");
    if (answer.ok) return answer;
    if (![429, 503].includes(answer.status) || Date.now() - since > LONGEST_WAIT_MS) throw new Error((await answer.json()).detail);
    await new Promise((done) => setTimeout(done, 1000 * (Number(answer.headers.get("Retry-After")) || 1)));
  }
}

/* paths and files of what was dropped, folders with all that is in them; null where it is one file */
async function within(entry) {
  if (entry.isFile) return new Promise((done, fail) => entry.file((file) => done([[entry.fullPath.slice(1), file]]), fail));
  const [reader, found] = [entry.createReader(), []];
  for (let some; (some = await new Promise((done, fail) => reader.readEntries(done, fail))).length; ) found.push(...some);
  return (await Promise.all(found.map(within))).flat();
}
export function dropped({ items, files }) {
  const entries = [...items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (entries.some((entry) => entry.isDirectory)) return Promise.all(entries.map(within)).then((found) => found.flat());
  return files.length > 1 ? [...files].map((file) => [file.name, file]) : null;
}

/* what names tell: known words wherever they stand, then what is left of files and folders */
const SERIAL = /^(g|gb|gear ?box|gear|sn|serial|unit|no)[\s_.-]*\d/iu;
const AXIS = /(?<!\p{L})(axis|joint)[\s_-]?(\d+|\p{L}(?!\p{L}))/iu;
const NOT = /(?<!\p{L})(no|not|without)(?!\p{L})/iu;
const DATE = /^\d{4}\D?\d\d\D?\d\d(?!\d)/u;
const bare = (text) => text.replace(/^[\s_.,-]+|[\s_.,-]+$/gu, "");
const edge = (word) => (/\d/u.test(word) ? "\\d" : "\\p{L}");
function pattern(name) {
  const words = name.match(/\p{L}+|\d+/gu);
  return words ? new RegExp(`(?<!${edge(words[0])})${words.join("[^\\p{L}\\d]*")}(?!${edge(words.at(-1))})`, "giu") : /$^/u;
}
const patterns = (pairs) => pairs.sort(([a], [b]) => b.length - a.length).map(([words, name]) => [pattern(words), name]);
function labelled(text, words) {
  const found = new Set();
  const rest = words.reduce((left, [known, label]) => left.replace(known, () => (found.add(label), " ")), text);
  return { label: found.size === 1 && !NOT.test(rest) ? [...found][0] : "", rest: bare(rest) };
}
function recognised(paths, words, known) {
  const first = (name, parts) => known[name].map(([each, value]) => parts.some((part) => part.search(each) >= 0) && value).find(Boolean);
  const parsed = paths.map((path) => {
    const parts = path.replace(/\.[^./]*$/u, "").split("/").reverse(); // the file, then its folders upwards
    const axis = first("axis", parts) ?? parts.map((part) => part.match(AXIS)?.[0]).find(Boolean) ?? "";
    const [file, ...folders] = parts.map((part) => labelled(axis ? part.replace(pattern(axis), " ") : part, words));
    const label = [file, ...folders].map((each) => each.label).find(Boolean) ?? "";
    return { axis, label, gearbox: first("gearbox", parts), file: bare(file.rest.replace(/[\s_.-]+\d{1,3}$/u, "")), folders: folders.map(({ rest }) => rest) };
  });
  const shared = (rest) => parsed.filter(({ file }) => file === rest).length;
  return parsed.map(({ axis, label, gearbox, file, folders }) => {
    const common = (folder) => parsed.every((other) => other.folders.includes(folder));
    const folder = folders.find((each) => SERIAL.test(each) || (each && !DATE.test(each) && !common(each)));
    const isOne = SERIAL.test(file) || (!folder && /\d/u.test(file) && !DATE.test(file) && shared(file) > 1 && shared(file) < parsed.length);
    return { axis, label, gearbox: gearbox ?? (isOne ? file : (folder ?? "")) };
  });
}

/* the table of a page; `root` is its section */
export function importer(root) {
  const { api, csrf, pages } = root.dataset;
  const [form, body, line, bar, button, undo] = ["form", "tbody", "[data-status]", "progress", ".primary", "[data-undo]"].map((each) => one(each, root));
  const template = one("template", root).content;
  const words = patterns(Object.entries(JSON.parse(root.dataset.words)).flatMap(([label, others]) => [label, ...others].map((each) => [each, label])));
  const listed = (name) => all(`[name=${name}] option`, template).map(({ value }) => value).filter((value) => /\p{L}.|\d{3}/u.test(value));
  let [rows, step, sending] = [[], `step-${random()}`, false];
  const field = (row, name) => one(`[name=${name}]`, row.element);
  const left = () => rows.filter((row) => !row.place);
  const show = (row, kind, ...content) => one(`[data-${kind}]`, row.element).replaceChildren(...content);

  async function ask(path, method, body, headers) {
    const answer = await answered(api + path, csrf, { method, body, headers });
    return { ...(await answer.json()), isNew: answer.status === 201 };
  }
  function upload(row, path, name, document, headers) {
    const parts = new FormData();
    parts.append("file", row.file);
    parts.append(name, JSON.stringify(document));
    return ask(path, "POST", parts, headers);
  }
  const turn = async (waiting, work) => {
    for (let row; (row = waiting.shift()); ) await work(row);
  };
  const together = (waiting, work) => Promise.all([turn(waiting, work), turn(waiting, work)]); // more of one key wait at the service
  function status(words = "") {
    const done = rows.length - left().length;
    const boxes = new Set(rows.filter((row) => row.place === "cases/").map((row) => field(row, "gearbox").value).filter(Boolean)).size;
    [bar.hidden, bar.max, bar.value] = [!done && !sending, rows.length || 1, done];
    const kept = left().filter((row) => field(row, "label")?.value).length;
    button.textContent = !kept ? "Diagnose all" : kept === left().length ? "Keep all as cases" : `Keep ${kept} as cases, diagnose ${left().length - kept}`;
    line.textContent = `${done ? `${done} of ` : ""}${rows.length} recordings${done ? " done" : ""}${boxes ? `; gearboxes with cases: ${boxes}` : ""}. ${words}`;
  }

  /* lists: a new name is asked for, and stands in all of them from then on */
  function choose(name, value, where) {
    const list = one(`[name=${name}]`, template);
    if (![...list.options].some((option) => option.value === value)) {
      for (const select of [list, ...all(`[data-kind=${name}]`, root)]) select.insertBefore(new Option(`${value} (new)`, value), one("option[value='+']", select));
    }
    for (const select of where) select.was = select.value = value;
  }
  /* the name that is written where one is asked for, or what else there is to choose */
  const dialog = one("dialog", root);
  function named(question, given, otherwise, other) {
    [one("label", dialog).textContent, one("input", dialog).value, one("[value='']", dialog).textContent] = [question, given, otherwise];
    dialog.returnValue = ""; // where it is closed by a key
    dialog.showModal();
    return new Promise((done) => dialog.addEventListener("close", () => done(dialog.returnValue ? one("input", dialog).value.trim() : other), { once: true }));
  }
  /* a new name that looks like a known one is asked about, once */
  const answers = new Map();
  async function meant(name, value) {
    const key = `${name} ${value}`;
    if (!value || name === "label" || listed(name).includes(value)) return value;
    if (!answers.has(key)) {
      const also = all(`[name=${name}] option`, template).filter((option) => option.text === `${option.value} (new)`).map((option) => ["also", option.value]);
      const [near] = await (await answered(`${pages}names/${name}?${new URLSearchParams([["near", value], ...also])}`, csrf, {})).json();
      answers.set(key, near ? await named(`No ${name} ${value} is known, but ${near} is. Which is meant?`, near, `${value} is another ${name}`, value) : value);
    }
    return answers.get(key);
  }
  async function changed(select) {
    const name = select.dataset.kind;
    let { value } = select;
    if (value === "+") value = await meant(name, await named(`Name of the new ${name}, as it shall stand in all lists`, "", "Cancel", select.was ?? ""));
    if (select.dataset.all && !value) return void (select.value = "");
    if (value && name === "label") value = labelled(value, words).label || value.toLowerCase().replace(/\s+/gu, "_");
    choose(name, value, select.dataset.all ? [select, ...left().map((row) => field(row, name))] : [select]);
    status();
  }
  root.addEventListener("change", ({ target }) => {
    if (target.dataset.all === "recorded_at") left().forEach((row) => (field(row, "recorded_at").value = target.value));
    else if (target.files) add([...target.files].map((file) => [file.webkitRelativePath || file.name, file]));
    else if (target.options) changed(target);
  });

  async function recognise(row) {
    if (sending || !row.element.isConnected) return;
    row.bytes = `${row.file.size} ${await row.file.slice(row.file.size / 2, row.file.size / 2 + 4096).text()}`;
    const twin = rows.find((other) => other !== row && other.bytes === row.bytes);
    const same = twin ? `The same as ${twin.path}. ` : "";
    try {
      const { quality, motion_period_s: period, neighbours } = await upload(row, "/retrievals", "query", { k: 1 });
      const weak = ["unusable", "poor"].flatMap((how) => quality.filter(({ severity }) => severity === how))[0];
      const known = neighbours.filter(({ distance }) => distance < SAME).map((near) => link(`${pages}cases/${near.case_id}`, `The same as a case: ${near.label}`));
      show(row, "found", same, `${period ? `Cycle of ${period.toFixed(1)} s` : "No regular motion"}, ${weak ? `${weak.severity}: ${weak.reason}` : "good quality"}. `, ...known);
    } catch (error) {
      show(row, "found", same, error.message);
    }
  }
  async function add(found) {
    const accept = one("[accept]", root).accept.split(",");
    const fits = (file) => accept.some((each) => (each.endsWith("*") ? file.type.startsWith(each.slice(0, -1)) : file.name.toLowerCase().endsWith(each)));
    const wanted = found.filter(([, file]) => fits(file)).sort(([a], [b]) => a.localeCompare(b, "en", { numeric: true }));
    const known = Object.fromEntries(["axis", "gearbox"].map((name) => [name, patterns(listed(name).map((value) => [value, value]))]));
    const names = recognised(wanted.map(([path]) => path), words, known);
    const made = [];
    for (const [k, [path, file]] of wanted.entries()) {
      body.append(template.cloneNode(true));
      const row = { file, path, element: body.lastElementChild };
      show(row, "name", path);
      const saved = new Date(Math.floor(file.lastModified / 1000) * 1000);
      field(row, "recorded_at").valueAsNumber = saved - 60_000 * saved.getTimezoneOffset(); // at this place
      for (const select of all("select, input", row.element)) {
        select.setAttribute("aria-label", `${select.getAttribute("aria-label")} of ${path}`);
        if (select.options) choose(select.name, await meant(select.name, names[k][select.name] ?? ""), [select]);
      }
      one("[data-remove]", row.element).addEventListener("click", () => {
        rows = rows.filter((other) => other !== row);
        one("button:enabled, input", row.element.nextElementSibling ?? row.element.previousElementSibling ?? root)?.focus();
        row.element.remove();
        status();
      });
      made.push(row);
    }
    rows.push(...made);
    [form.hidden, button.disabled] = [!rows.length, sending || !rows.length];
    status(found.length > made.length ? `Left out, because they are no recordings: ${found.length - made.length}.` : "");
    await together(made, recognise);
  }

  async function store(row) {
    const given = Object.fromEntries(all("select, input", row.element).map(({ name, value }) => [name, value]).filter(([, value]) => value));
    if (!given.label) delete given.verification;
    if (given.recorded_at) given.recorded_at = new Date(given.recorded_at).toISOString();
    const asked = JSON.stringify(given);
    if (row.asked !== asked) Object.assign(row, { asked, key: random() }); // what is sent again is done once
    show(row, "state", "sending");
    try {
      const made = await upload(row, given.label ? "/cases" : "/diagnoses", "metadata", given, { "Idempotency-Key": row.key, "X-Request-ID": step });
      Object.assign(row, { place: given.label ? "cases/" : "diagnoses/", added: given.label && made.isNew ? made.id : null });
      show(row, "state", link(`${pages}${row.place}${made.id}`, !given.label ? "diagnosed" : row.added ? "kept" : "there already"));
      all("select, input, button", row.element).forEach((each) => (each.disabled = true));
    } catch (error) {
      show(row, "state", error.message);
    }
    status();
  }
  const newest = async () => (await ask(`/steps?kind=case&subject=${rows.find((row) => row.added).added}`, "GET")).items[0].number;
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    for (const row of left()) if (field(row, "verification")) field(row, "verification").required = field(row, "label").value !== "";
    if (!form.reportValidity()) return;
    const busy = (is) => ([sending, one("table", root).inert, button.disabled] = [is, is, is || !left().length]);
    busy(true);
    await together(left(), store);
    busy(false);
    undo.hidden = !rows.some((row) => row.added);
    if (!undo.hidden) line.append(link(`${pages}library?step=${await newest()}`, "See them in the library"));
  });
  undo.addEventListener("click", async () => {
    try {
      await ask(`/steps/${await newest()}/undo`, "POST");
    } catch (error) {
      return status(error.message);
    }
    for (const row of rows.filter((each) => each.added)) {
      Object.assign(row, { place: null, added: null, asked: null });
      show(row, "state", "taken back");
      all("select, input, button", row.element).forEach((each) => (each.disabled = false));
    }
    [step, undo.hidden, button.disabled] = [`step-${random()}`, true, false];
    button.focus();
    status();
  });
  return add;
}
