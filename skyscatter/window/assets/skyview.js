// A sky in its canvas: drawn at once from a table, and refined by the solver behind.
import { SkyPicture } from "./sky.js";
import { FLAT, viewOf, viewText } from "./state.js";

/** Milliseconds of rest after which the solver is asked, and after which the picture is drawn whole. */
const REST = 250, SETTLE = 180;
/** Milliseconds that a picture may take while a hand moves; where it would take longer it is drawn smaller meanwhile. */
const PACE = 50, SHARES = [1, 0.7, 0.5, 0.35, 0.25];

export class SkyView {
  constructor(canvas, link, say) {
    this.canvas = canvas;
    this.link = link;
    this.say = say;
    this.picture = new SkyPicture(canvas);
    this.base = null; // what the table in use was solved for
    this.full = [canvas.width, canvas.height];
    this.cost = 0; // milliseconds a pixel; not known before the first picture
    this.asked = null;
    this.late = 0;
  }

  /** Shape of the picture: its width over its height, or null for that of the room there is. */
  ratio(state) { return state.view === "panorama" ? 2 : state.view === "fisheye" ? 1 : null; }

  /** Exposure value of the picture. */
  get exposure() { return this.base && this.picture.exposure !== null ? +this.picture.exposure.toFixed(2) : undefined; }

  /** What a table depends on. */
  settings(state) {
    const ground = state.ownGround ? null : state.ground;
    return { model: state.model, haze: state.haze, ozone: state.ozone, ground, altitude: state.altitude };
  }

  /** The table that comes with the page is that of the first settings. */
  first(settings) {
    this.waits = true;
    this.link.ask("first", {}, (message, data) => {
      if (message.what === "table") this.take(data, settings, message);
      if (message.what === "done" || message.what === "error") { this.waits = false; if (this.ready) this.show(this.state); this.solved?.(); }
    });
  }

  take(data, settings, message) {
    this.picture.setTable(data);
    this.base = settings;
    this.coarse = message.quick;
    this.tolerance = message.tolerance;
    this.redraw();
  }

  /** Show a state: at once as well as the table in use can, then solved. */
  show(state) {
    this.state = state;
    this.redraw();
    this.ready = true;
    if (this.waits) return; // for the table that comes with the page
    if (this.link.alone) { this.say(this.about(), null); return; }
    const wanted = JSON.stringify(this.settings(state));
    if (this.base && !this.coarse && JSON.stringify(this.base) === wanted) {
      this.stop();
      this.say(this.about(), null);
    } else if (this.asked !== wanted) {
      this.stop();
      this.asked = wanted;
      this.say(this.about(), 0);
      this.late = setTimeout(() => this.solve(this.settings(state)), REST);
    }
  }

  /** No solution is wanted. */
  stop() {
    clearTimeout(this.late);
    if (this.asked) this.link.drop("table");
    this.asked = null;
  }

  solve(settings) {
    this.link.ask("table", settings, (message, data) => {
      if (message.what === "table") this.take(data, settings, message);
      if (message.what === "error") { this.asked = null; this.say(message.words, null, true); }
      if (message.what === "share") this.say(`${this.about()}; ${message.words}`, message.share);
      if (message.what === "done") { this.asked = null; this.say(this.about(), null); this.solved?.(); }
    });
  }

  /** Whether the picture is of other settings than the table, and may be changed to them to first order. */
  get changed() { return this.base && ["haze", "ozone", "ground"].filter(name => this.base[name] !== this.settings(this.state)[name]); }

  /** What the picture on the screen is, in words. */
  about() {
    if (!this.base) return "solving";
    if (this.base.model !== this.state.model || this.base.altitude !== this.state.altitude) return "still the sky of before; solving";
    const names = this.changed, solving = this.link.alone ? "" : "; solving";
    if (names.includes("ground") && this.groundChange(this.state) === 1) return `still the ground of before${solving}`;
    if (names.length) return `first order in ${names.join(" and ")}${solving}`;
    const reached = this.tolerance ? ` to ${+(100 * this.tolerance).toPrecision(2)} %` : "";
    return this.coarse ? `solved roughly,${reached}; solving` : `solved${reached}`;
  }

  /** The picture shall have this size [pixel]. */
  resize(width, height) {
    if (this.full[0] === width && this.full[1] === height) return;
    this.full = [width, height];
    this.redraw();
  }

  /** Draw at once, as large as can be done fast; whole as soon as the hand rests. */
  redraw() {
    if (!this.state || !this.base) return;
    const pixels = this.full[0] * this.full[1];
    const share = this.cost ? SHARES.find(s => s * s * pixels * this.cost <= PACE) ?? SHARES.at(-1) : 0.5;
    this.set();
    this.draw(share);
    clearTimeout(this.settling);
    if (share < 1) this.settling = setTimeout(() => { this.draw(1); this.settled?.(); }, SETTLE);
  }

  /** Draw at a share of the full size, and learn what a pixel costs. */
  draw(share) {
    const { canvas } = this, [width, height] = this.full.map(side => Math.max(Math.round(share * side), 1));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const began = performance.now(), gl = this.picture.backend === "webgl2" ? canvas.getContext("webgl2") : null;
    this.picture.draw();
    if (gl) gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits for the picture
    this.cost = (performance.now() - began) / (width * height);
    if (!this.drawn) performance.mark("skyscatter: first light");
    this.drawn = true;
  }

  set() {
    const state = this.state, change = {};
    for (const name of ["haze", "ozone"]) change[name] = this.base[name] > 0 ? state[name] / this.base[name] : 1;
    if (this.base.model === state.model) change.ground = this.groundChange(state);
    this.picture.set({
      sunElevation: state.sunElevation, sunAzimuth: state.sunAzimuth,
      view: viewOf(state),
      exposure: state.autoExposure ? "auto" : state.exposure, tone: "photograph", change,
    });
  }

  groundChange(state) {
    if (state.ownGround || this.base.ground === null || !(this.base.ground > 0)) return 1;
    return state.ground / this.base.ground;
  }

  /** Direction and colour of a pixel of the canvas; null where the picture has none. */
  at(x, y) {
    const direction = this.base && this.picture.direction(x, y);
    return direction ? { direction, xyz: this.picture.xyz(x, y) } : null;
  }

  /** The pixel in which a direction is seen, found by halving steps; null if it is in none. */
  pixel(azimuth, elevation) {
    if (!this.base) return null;
    const { width, height } = this.canvas, radians = Math.PI / 180;
    const vector = (a, e) => [Math.cos(e * radians) * Math.sin(a * radians), Math.cos(e * radians) * Math.cos(a * radians), Math.sin(e * radians)];
    const goal = vector(azimuth, elevation);
    const miss = (x, y) => {
      const d = this.picture.direction(x, y);
      return d ? Math.hypot(...vector(d.azimuth, d.elevation).map((v, k) => v - goal[k])) : Infinity;
    };
    let best = [Infinity, 0, 0];
    for (let i = 0; i <= 32; i++) for (let j = 0; j <= 32; j++) {
      const x = i / 32 * (width - 1), y = j / 32 * (height - 1), value = miss(x, y);
      if (value < best[0]) best = [value, x, y];
    }
    for (let step = Math.max(width, height) / 32; step > 0.002; step /= 2) {
      for (let moved = true; moved;) {
        moved = false;
        for (const [dx, dy] of [[step, 0], [-step, 0], [0, step], [0, -step]]) {
          const x = Math.min(Math.max(best[1] + dx, 0), width - 1), y = Math.min(Math.max(best[2] + dy, 0), height - 1), value = miss(x, y);
          if (value < best[0]) { best = [value, x, y]; moved = true; }
        }
      }
    }
    const pixel = 0.05 + 2 * (viewOf(this.state).fov ?? 360) / width * radians;
    return best[0] < pixel ? [best[1], best[2]] : null;
  }

  /** What is asked of the solver about a direction. */
  question(cross) {
    const { state } = this;
    return { kind: "sky-point", ...this.settings(state), sunElevation: state.sunElevation, sunAzimuth: state.sunAzimuth, azimuth: cross[0], elevation: cross[1] };
  }

  /** What is asked for the command that makes this picture. */
  commanded() {
    const { state } = this, [width, height] = this.full;
    return {
      kind: "sky-command", ...this.settings(state), sunElevation: state.sunElevation, sunAzimuth: state.sunAzimuth,
      view: viewText(state), width, height, exposure: state.autoExposure ? null : state.exposure,
    };
  }

  /** Look elsewhere by so many pixels of the page; the names that change. */
  look(state, dx, dy) {
    const perPixel = (state.view === "panorama" ? 360 : state.fov) / this.canvas.clientWidth;
    if (state.view === "fisheye") return {};
    const turned = { viewAzimuth: (((state.viewAzimuth - dx * perPixel) % 360) + 360) % 360 };
    if (state.view === "perspective") turned.viewElevation = Math.min(Math.max(state.viewElevation + dy * perPixel, -90), 90);
    return turned;
  }

  zoom(state, factor) {
    const most = state.view === "perspective" ? FLAT : 360;
    return state.view === "landscape" || state.view === "perspective" ? { fov: Math.min(Math.max(state.fov * factor, 1), most) } : {};
  }

  home(state) { return { viewAzimuth: state.sunAzimuth, ...(state.view === "perspective" ? { viewElevation: Math.max(state.sunElevation, -90) } : {}) }; }

  /** The picture as a PNG file. */
  png() { clearTimeout(this.settling); this.draw(1); return new Promise(resolve => this.canvas.toBlob(resolve, "image/png")); }
}
