// Recording in the browser: without loss, without automatic gain, with a level that says where to hold the microphone.
"use strict";

const PLAIN = { autoGainControl: false, echoCancellation: false, noiseSuppression: false, channelCount: 1 };
// quieter is within ten steps of 16 bit, and within ten times the noise of a telephone's microphone
const QUIET_DBFS = 20 * Math.log10(10 / 32768);
const FULL = 0.99; // of the largest value: what is louder was probably cut off
const ENOUGH_S = 20;
const LONGEST_S = 600; // the service takes no more

const decibels = (value) => 20 * Math.log10(Math.max(value, 1e-6));

// the parts of a file: one channel of 16 bit, in the byte order of every machine that has a browser
function wav(blocks, rate) {
  const size = blocks.reduce((sum, block) => sum + block.byteLength, 0);
  const format = [new Uint16Array([1, 1]), new Uint32Array([rate, 2 * rate]), new Uint16Array([2, 16])];
  const riff = ["RIFF", new Uint32Array([36 + size]), "WAVE"];
  return [...riff, "fmt ", new Uint32Array([16]), ...format, "data", new Uint32Array([size]), ...blocks];
}

/* one recorder in one form: what it records becomes the form's file */
export function recorder(root, form) {
  const find = (name) => root.querySelector(`[data-${name}]`);
  const [button, level, said] = ["record", "level", "said"].map(find);
  const player = document.createElement("audio");
  player.controls = true;
  let running = null;

  async function begin() {
    if (!navigator.mediaDevices?.getUserMedia) throw new Error("this browser records only over HTTPS or on the machine of the service. Record with the telephone's own recorder and choose the file.");
    const stream = await navigator.mediaDevices.getUserMedia({ audio: PLAIN });
    const context = new AudioContext();
    await context.audioWorklet.addModule(new URL("record-worklet.js", import.meta.url));
    const tap = new AudioWorkletNode(context, "tap", { numberOfOutputs: 0, channelCount: 1, channelCountMode: "explicit" });
    const heard = { stream, context, blocks: [], samples: 0, full: 0, squares: 0, begun: new Date() };
    heard.altered = Object.entries(stream.getAudioTracks()[0].getSettings()).some(([name, value]) => name in PLAIN && value === true);
    tap.port.onmessage = ({ data }) => take(heard, data);
    context.createMediaStreamSource(stream).connect(tap);
    stream.getAudioTracks()[0].addEventListener("ended", end);
    heard.awake = await navigator.wakeLock?.request("screen").catch(() => null);
    running = heard;
    button.textContent = "Stop";
    button.setAttribute("aria-pressed", "true");
    level.hidden = false;
    player.remove();
  }

  function take(heard, block) {
    if (heard !== running) return;
    let [squares, peak] = [0, 0];
    const samples = Int16Array.from(block, (value) => Math.max(-32768, Math.min(32767, Math.round(32768 * value))));
    for (const value of block) {
      squares += value * value;
      peak = Math.max(peak, Math.abs(value));
      heard.full += Math.abs(value) >= FULL;
    }
    heard.blocks.push(samples);
    heard.samples += block.length;
    heard.squares += squares;
    const rms = Math.sqrt(squares / block.length);
    const seconds = heard.samples / heard.context.sampleRate;
    level.value = decibels(rms);
    const advice = peak >= FULL ? "Too loud: hold it farther away." : decibels(rms) < QUIET_DBFS ? "Too quiet: hold it nearer." : "The level is good.";
    const rest = seconds < ENOUGH_S ? ` Go on to ${ENOUGH_S} s or more, and three cycles of the motion.` : "";
    said.textContent = `${seconds.toFixed(0)} s, ${decibels(rms).toFixed(0)} dB of full scale. ${advice}${rest}`.replaceAll("-", "−");
    if (seconds >= LONGEST_S) end();
  }

  async function end() {
    const heard = running;
    if (!heard) return;
    running = null;
    heard.stream.getTracks().forEach((track) => track.stop());
    const rate = heard.context.sampleRate;
    await heard.context.close();
    await heard.awake?.release();
    button.textContent = "Record again";
    button.setAttribute("aria-pressed", "false");
    level.hidden = true;
    const seconds = heard.samples / rate;
    if (!heard.samples) return void (said.textContent = "Nothing was recorded: the microphone gave no sound.");
    const name = `recording ${heard.begun.toLocaleString("sv").replaceAll(":", "-")}.wav`;
    const file = new File(wav(heard.blocks, rate), name, { type: "audio/wav" });
    const files = new DataTransfer();
    files.items.add(file);
    const input = form.querySelector("input[type=file]");
    input.files = files.files;
    input.dispatchEvent(new Event("change"));
    form.elements.recorded_at.value = heard.begun.toISOString();
    if (player.src) URL.revokeObjectURL(player.src);
    player.src = URL.createObjectURL(file);
    root.append(player);
    said.textContent = checked(heard, seconds).join(" ");
  }

  // what can be said before it is sent; the service looks closer
  function checked(heard, seconds) {
    const found = [];
    if (heard.altered) found.push("This browser keeps automatic gain or noise suppression on, which hides faults: use another recorder if you can.");
    if (heard.full) found.push("It was too loud at times: hold the microphone farther away and record again.");
    if (decibels(Math.sqrt(heard.squares / heard.samples)) < QUIET_DBFS) found.push("It is too quiet: hold the microphone nearer and record again.");
    if (seconds < ENOUGH_S) found.push(`It is ${seconds.toFixed(0)} s long; ${ENOUGH_S} s or more say more.`);
    return found.length ? found : [`Level and length are good. Listen to it, then press ${form.querySelector("[type=submit]").textContent}.`];
  }

  button.addEventListener("click", () => {
    const work = running ? end() : begin();
    work.catch((error) => {
      said.textContent = error.name === "NotAllowedError" ? "The browser may not use the microphone: allow it in the settings of this page." : `The microphone cannot be used: ${error.message}`;
    });
  });
  form.querySelector("input[type=file]").addEventListener("change", () => (form.elements.recorded_at.value = ""));
  form.closest("dialog")?.addEventListener("close", end);
}
