// What a page gains with JavaScript. Everything here has a way without it: forms post, links lead, charts are drawn.
"use strict";
import { all, dropped, importer, one } from "./import.js";
import { investigation } from "./investigate.js";
import { recorder } from "./record.js";
import { playhead, start, style } from "./plots.js";

/* theme */
all(".masthead [aria-current]").forEach((here) => (here.parentElement.scrollLeft = here.offsetLeft - here.parentElement.offsetLeft - 80));
one("[data-theme-toggle]")?.addEventListener("click", () => {
  const { dataset } = document.documentElement;
  const isDark = dataset.theme ? dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  dataset.theme = isDark ? "light" : "dark";
  document.cookie = `gearcase-theme=${dataset.theme}; path=${one(".brand").pathname}; max-age=31536000; samesite=lax`;
  dispatchEvent(new Event("gearcase:theme"));
});

/* keyboard: a link or button says its key in data-key; ? lists them */
function keyboard(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input:not([type=checkbox]), select, textarea, dialog[open] [contenteditable]")) return;
  if (event.key === " " && event.target.matches("[type=checkbox]")) return; // it is ticked by that
  const target = all("[data-key]").find((element) => element.dataset.key === event.key && !element.disabled);
  if (!target) return;
  event.preventDefault();
  target.focus();
  target.click();
}
addEventListener("keydown", keyboard);

/* a correction needs its label, and a case how it was verified: the browser shows which is missing */
one("form[data-verdict]")?.addEventListener("submit", (event) => {
  const { label, another, verification, keep } = event.target.elements;
  const verdict = event.submitter?.value;
  label.required = verdict === "corrected";
  another.required = label.required && label.value === "+";
  verification.required = event.submitter?.hasAttribute("formaction") || (Boolean(keep?.checked) && verdict !== "rejected");
  if (!event.target.reportValidity()) event.preventDefault();
});

/* a key list made from the page itself */
const filled = (element, ...content) => (element.append(...content), element);
const made = (name, ...content) => filled(document.createElement(name), ...content);
for (const element of all("[data-key]")) {
  const key = element.dataset.key === " " ? "space" : element.dataset.key;
  one("#keys dl")?.append(made("dt", made("kbd", key)), made("dd", element.dataset.keyName ?? element.textContent.trim()));
}

/* size of a chosen recording, and its length where the browser can play it */
function described(form) {
  const [file, output] = [one("input[type=file]", form).files[0], one("[data-detected]", form)];
  if (!file || !output) return;
  output.textContent = `${file.name}: ${(file.size / 1e6).toFixed(2)} MB`;
  const sound = new Audio(URL.createObjectURL(file));
  sound.addEventListener("loadedmetadata", () => one("input[type=file]", form).files[0] === file && output.append(`, ${sound.duration.toFixed(1)} s`));
}

/* several recordings: the table of this page, or the one of the page of a new diagnosis, put before this page's content */
let many = one("[data-import]") && importer(one("[data-import]"));
async function several(found) {
  if (!many) {
    const page = new DOMParser().parseFromString(await (await fetch(upload.action)).text(), "text/html");
    one("main").prepend(one("[data-import]", page));
    many = importer(one("[data-import]"));
  }
  one("#many").scrollIntoView();
  await many(await found);
}

/* an axis that was described for an investigation that waits in another tab */
if (one("[data-stored]")) {
  localStorage.setItem("gearcase-axis", `${one("[data-stored]").dataset.stored} ${Date.now()}`);
  if (window.opener) close();
}

/* drop a recording anywhere, or what is to be investigated */
const investigate = one("[data-investigate]") && investigation(one("[data-investigate]"));
const upload = one("form[data-upload]");
const opener = one("[data-diagnose-link]");
if (upload || opener) {
  const dragging = (is) => document.body.classList.toggle("dragging", is);
  addEventListener("dragleave", (event) => event.relatedTarget ?? dragging(false)); // it is null where the page is left
  const over = (event) => {
    event.preventDefault();
    dragging(event.dataTransfer.types.includes("Files"));
  };
  ["dragenter", "dragover"].forEach((kind) => addEventListener(kind, over));
  addEventListener("drop", (event) => {
    event.preventDefault();
    dragging(false);
    const form = one("main form[data-upload]") ?? upload;
    const [found, files] = [dropped(event.dataTransfer), [...event.dataTransfer.files]];
    if (investigate) return Promise.resolve(found).then((its) => investigate(its?.map(([, file]) => file) ?? files));
    if (found) return several(found);
    if (!form || !event.dataTransfer.files.length) return;
    one("input[type=file]", form).files = event.dataTransfer.files;
    form.closest("dialog")?.showModal();
    described(form);
  });
}

/* a form with something to fill in is sent from its page: a refusal stands at it, and what was typed stays */
function send(form, submitter) {
  const bar = Object.assign(made("progress"), { ariaLabel: "Progress", value: 0, hidden: form.enctype !== "multipart/form-data" });
  const stage = Object.assign(made("p"), { role: "status", className: "hint" });
  all(":scope > :is(progress, [role=status])", form).forEach((each) => each.remove());
  form.append(bar, stage);
  const [request, data] = [new XMLHttpRequest(), new FormData(form, submitter)];
  const [address, buttons] = [submitter?.getAttribute("formaction") ?? form.getAttribute("action"), all("button:enabled", form)];
  request.open("POST", address);
  request.setRequestHeader("Accept", "text/html");
  buttons.forEach((button) => (button.disabled = true));
  const refused = (words) => {
    Object.assign(stage, { className: "notice bad", textContent: words });
    stage.scrollIntoView({ block: "nearest" });
    buttons.forEach((button) => (button.disabled = false));
    bar.hidden = true;
  };
  request.upload.addEventListener("progress", ({ loaded, total }) => {
    if (bar.hidden) return;
    const share = Math.round((100 * loaded) / total);
    share < 100 ? (bar.value = share / 100) : bar.removeAttribute("value");
    stage.textContent = share < 100 ? `Sending: ${share} %` : "Decoding, extracting features, comparing with the library";
  });
  request.addEventListener("load", () => {
    const page = new DOMParser().parseFromString(request.responseText, "text/html");
    const problem = one("[data-problem]", page)?.textContent;
    if (problem || !one("main", page)) return refused(problem ?? `The service answered ${request.status}.`);
    if (request.responseURL !== new URL(address, location).href) return location.assign(request.responseURL);
    one("main").replaceWith(one("main", page)); // the answer is this page: a key that is shown once, a question
    [times, asCards].forEach((work) => work(document));
    scrollTo(0, 0);
  });
  request.addEventListener("error", () => refused("The service did not answer. Check that it runs, then send again."));
  request.send(bar.hidden ? new URLSearchParams(data) : data);
}
addEventListener("submit", (event) => {
  const { target: form, submitter } = event;
  if (event.defaultPrevented || (submitter?.formMethod || form.method) !== "post" || !one("input:not([type=hidden], [type=password]), select, textarea", form)) return;
  event.preventDefault();
  send(form, submitter);
});

/* names of axes and gearboxes that are known, while somebody writes one; a gearbox of the axis beside it */
async function suggest({ target }) {
  if (!target.matches?.("input[data-names]")) return;
  const asked = new URLSearchParams({ search: target.value, axis: target.form.elements.axis?.value ?? "" });
  const answer = await fetch(`${target.dataset.names}?${asked}`, { headers: { Accept: "application/json" } });
  if (!answer.ok) return;
  const names = await answer.json();
  target.list.replaceChildren(...names.map((name) => new Option(name)));
  const tick = one(".check", target.parentElement); // asked for only where the name is new
  if (tick) tick.hidden = !target.value || names.includes(target.value);
}
all("input[data-names] ~ .check").forEach((tick) => (tick.hidden = true));
addEventListener("focusin", suggest);
addEventListener("input", suggest);

/* times are those of the browser */
const { timeZone } = Intl.DateTimeFormat().resolvedOptions();
const local = new Intl.DateTimeFormat("sv", { year: "numeric", month: "2-digit", day: "2-digit", hour: "2-digit", minute: "2-digit", timeZoneName: "short" });
function times(root) {
  all("time[datetime]", root).forEach((time) => (time.textContent = local.format(new Date(time.dateTime))));
}
times(document);
all("[data-zone]").forEach((element) => (element[element.matches("input") ? "value" : "textContent"] = timeZone));

for (const form of all("form[data-upload]")) {
  one("input[type=file]", form).addEventListener("change", () => described(form));
  if (one("[data-recorder]", form)) recorder(one("[data-recorder]", form), form);
}

/* copy a command */
addEventListener("click", async ({ target }) => {
  if (!target.matches("[data-copy]")) return;
  await navigator.clipboard.writeText(one(target.dataset.copy).textContent);
  target.textContent = "Copied";
});

/* listening: the recording, and A/B with a neighbour at equal loudness */
const player = one("[data-audio]");
if (player && window.WaveSurfer) {
  const colours = () => ({ waveColor: style("--line-strong"), progressColor: style("--accent"), cursorColor: style("--ink") });
  const wave = WaveSurfer.create({
    container: player,
    url: player.dataset.audio,
    peaks: player.dataset.peaks ? [JSON.parse(player.dataset.peaks)] : undefined,
    duration: player.dataset.seconds ? Number(player.dataset.seconds) : undefined,
    height: 64,
    normalize: true,
    ...colours(),
    cspNonce: one("meta[name=csp-nonce]").content,
  });
  addEventListener("gearcase:theme", () => wave.setOptions(colours()));
  // the spectrogram and the marks lie in the waveform, so that playhead and zoom are theirs, too
  const drawn = [...player.querySelectorAll("[part]")];
  drawn.filter(({ dataset }) => dataset.at).forEach((mark) => (mark.style.left = `${(100 * mark.dataset.at) / player.dataset.seconds}%`));
  wave.getWrapper().append(...drawn);
  one("[data-zoom]")?.addEventListener("input", ({ target }) => wave.zoom((target.value * player.clientWidth) / wave.getDuration()));
  one("audio[data-plain]")?.remove();
  const button = one("[data-play]");
  button.addEventListener("click", () => wave.playPause());
  wave.on("play", () => (button.textContent = "Pause"));
  wave.on("pause", () => (button.textContent = "Listen"));
  wave.on("timeupdate", (seconds) => {
    one("[data-clock]").textContent = `${seconds.toFixed(1)} s`;
    playhead(seconds);
  });
  // equal loudness: the louder of the two is turned down to the quieter
  const own = Number(player.dataset.rms);
  for (const choice of all("[data-compare]")) {
    choice.addEventListener("click", () => {
      const level = Number(choice.dataset.rms);
      const back = choice.ariaPressed === "true";
      all("[data-compare]").forEach((element) => element.setAttribute("aria-pressed", "false"));
      choice.setAttribute("aria-pressed", String(!back));
      const at = wave.getCurrentTime();
      drawn.forEach((each) => (each.hidden = !back)); // they are of this recording alone
      wave.load(back ? player.dataset.audio : choice.dataset.compare).then(() => {
        const reference = Math.min(own, level);
        wave.setVolume(Math.min(1, reference / (back ? own : level)));
        wave.setTime(Math.min(at, wave.getDuration()));
        wave.play();
      });
    });
  }
  for (const element of all("[data-seek]")) {
    element.addEventListener("click", () => {
      wave.setTime(Number(element.dataset.seek));
      wave.play();
    });
  }
}

/* live progress of a job; at its end the page says what can be done now */
for (const element of all("[data-job-events]")) {
  const source = new EventSource(element.dataset.jobEvents);
  source.addEventListener("progress", (event) => {
    const { fraction, done, total, remaining_s: remaining } = JSON.parse(event.data);
    one("progress", element).value = fraction;
    const left = remaining ? `, about ${Math.ceil(remaining)} s left` : "";
    one("[data-stage]", element).textContent = total ? `${done} of ${total} parts are done${left}` : "";
  });
  source.addEventListener("end", () => {
    source.close();
    location.reload();
  });
}

/* what a slider asks for and cannot have is said where it would stand */
addEventListener("htmx:responseError", ({ detail: { target, xhr } }) => {
  const isProblem = xhr.getResponseHeader("Content-Type")?.includes("json");
  const textContent = isProblem ? JSON.parse(xhr.responseText).detail : `The service answered ${xhr.status}.`;
  target.replaceChildren(Object.assign(made("div"), { className: "notice bad", role: "alert", textContent }));
});

/* a slider and its number field say the same; without JavaScript there is the number alone */
addEventListener("input", ({ target }) => {
  const other = target.dataset.with && document.getElementById(target.dataset.with);
  if (other && target.value !== "") other.value = +Number(target.value).toPrecision(3);
});

/* two sounds: one plays at a time, and the other goes on where it was; the second follows the sliders */
const pair = one("[data-pair]");
if (pair) {
  const sounds = all("audio", pair);
  const button = one("[data-swap]", pair);
  let heard = sounds[1];
  button.addEventListener("click", () => {
    const other = sounds.find((sound) => sound !== heard);
    other.currentTime = heard.currentTime;
    other.play();
  });
  for (const sound of sounds) {
    sound.addEventListener("play", () => {
      sounds.filter((other) => other !== sound).forEach((other) => other.pause());
      heard = sound;
      one("[data-playing]", pair).textContent = `You hear: ${document.getElementById(sound.getAttribute("aria-labelledby")).textContent}`;
    });
  }
  addEventListener("htmx:afterSwap", () => {
    const [, second] = sounds;
    const { sound } = one("#result").dataset;
    if (second.getAttribute("src") === sound) return;
    const [at, plays] = [second.currentTime, !second.paused];
    second.src = sound;
    second.currentTime = at;
    if (plays) second.play();
  });
}

/* on a narrow screen tables are cards, whose values say what they are */
const LONG = 40; // characters from which on a value has a line of its own
function asCards(root) {
  for (const table of all("table:has(> thead)", root)) {
    const names = all(":scope > thead th", table).map((head) => head.textContent.trim());
    for (const row of all(":scope > tbody > tr", table)) {
      [...row.cells].forEach((cell, k) => {
        if (names[k]) cell.dataset.label = names[k];
        cell.classList.toggle("wide", cell.textContent.trim().length > LONG || Boolean(one("details", cell)));
      });
    }
    table.classList.add("cards");
  }
}
asCards(document);
addEventListener("htmx:afterSwap", (event) => [times, asCards].forEach((work) => work(event.target.isConnected ? event.target : document)));

/* bulk selection */
all("[data-select-all]").forEach((box) =>
  box.addEventListener("change", () => all("input[name=case_id]").forEach((item) => (item.checked = box.checked))),
);

start();
