// A nebula in its canvas: pictures come from the solver, better from pass to pass.

import { numberOf } from "./state.js";

/** Milliseconds of rest after which the solver is asked, and the longest side of a picture [pixel]. */
const REST = 120, LONGEST = 288;

export class NebulaView {
  constructor(canvas, link, say) {
    this.canvas = canvas;
    this.link = link;
    this.say = say;
    this.context = canvas.getContext("2d");
    this.words = "";
    this.asked = null;
    this.late = 0;
  }

  ratio() { return null; }

  side(state) {
    const { clientWidth, clientHeight } = this.canvas, scale = Math.min(LONGEST / Math.max(clientWidth, clientHeight, 1), 1);
    const [width, height] = [clientWidth, clientHeight].map(side => Math.max(Math.round(side * scale), 16));
    return {
      model: state.model, inclination: state.inclination, turn: state.turn, fieldWidth: state.fieldWidth, width, height,
      exposure: state.autoExposure ? null : state.exposure,
    };
  }

  /** Show a state: the work on the one before ends at once. */
  show(state) {
    this.state = state;
    const wanted = JSON.stringify(this.side(state));
    if (wanted === this.asked) return;
    this.stop();
    this.asked = wanted;
    this.say(this.picture ? "still the side of before; tracing" : "tracing", 0);
    this.late = setTimeout(() => this.trace(this.side(state)), REST);
  }

  stop() {
    clearTimeout(this.late);
    if (this.asked) this.link.drop("picture");
    this.asked = null;
  }

  trace(side) {
    this.fresh = false;
    this.words = this.picture ? "still the side of before" : "first picture";
    this.link.ask("picture", side, (message, data) => {
      if (message.what === "share") this.say(`${this.words}; tracing ${message.words}`, message.share);
      if (message.what === "picture") this.draw(message, data);
      if (message.what === "numbers") { this.numbers = { ...message, values: new Float32Array(data) }; this.solved?.(); }
      if (message.what === "error") { this.asked = null; this.say(message.words, null, true); }
      if (message.what === "done") this.say(this.words, null);
    });
  }

  async draw(message, data) {
    const about = this.drawing = {};
    this.picture = new Blob([data], { type: "image/png" });
    this.samples = message.samples;
    this.exposure = +message.exposure.toFixed(2);
    this.words = `${message.width} × ${message.height} pixels, ${message.samples} walks each, noise ${(100 * message.noise).toPrecision(2)} %`;
    const bitmap = await createImageBitmap(this.picture);
    if (this.drawing !== about) return;
    this.canvas.width = message.width;
    this.canvas.height = message.height;
    this.context.drawImage(bitmap, 0, 0);
    this.canvas.dataset.samples = message.samples;
  }

  /** Place from 0 to 1, colour and its error at a pixel of the canvas; null before there are numbers. */
  at(x, y) {
    const { numbers, canvas } = this;
    if (!numbers) return null;
    const place = [(x + 0.5) / canvas.width, (y + 0.5) / canvas.height];
    const [i, j] = [[place[0], numbers.width], [place[1], numbers.height]].map(([share, size]) => Math.min(Math.max(Math.floor(share * size), 0), size - 1));
    const [X, Y, Z, error] = numbers.values.subarray(4 * (j * numbers.width + i), 4 * (j * numbers.width + i) + 4);
    return { place, xyz: [X, Y, Z], error };
  }

  pixel(x, y) { return [x * this.canvas.width - 0.5, y * this.canvas.height - 0.5]; }

  question(cross) { return { kind: "nebula-point", x: cross[0], y: cross[1] }; }

  commanded() { return { kind: "nebula-command", ...this.side(this.state), samples: Math.max(this.samples ?? 2, 2) }; }

  look(state, dx, dy) {
    const perPixel = 180 / Math.max(this.canvas.clientWidth, 1), within = angle => ((angle + 180) % 360 + 360) % 360 - 180;
    return { turn: within(Math.round(state.turn + dx * perPixel)), inclination: within(Math.round(state.inclination + dy * perPixel)) };
  }

  zoom(state, factor) { return { fieldWidth: numberOf("fieldWidth", state.fieldWidth * factor) }; }

  home(state, facts) { return facts ? { inclination: facts.inclination, turn: facts.turn, fieldWidth: facts.fieldWidth } : {}; }

  async png() { return this.picture; }
}
