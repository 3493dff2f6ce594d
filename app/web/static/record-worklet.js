// Hands the samples of the microphone on as they are, in blocks of about a tenth of a second.
"use strict";
class Tap extends AudioWorkletProcessor {
  block = [];
  process([[samples = []]]) {
    this.block.push(...samples);
    if (this.block.length >= 4096) this.port.postMessage(Float32Array.from(this.block.splice(0)));
    return true;
  }
}
registerProcessor("tap", Tap);
