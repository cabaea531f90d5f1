// The page: fields, picture, crosshair and buttons put together.
import { Controls } from "./controls.js";
import { NebulaView } from "./nebulaview.js";
import { SkyView } from "./skyview.js";
import { plot, superscript } from "./spectrum.js";
import { FLAT, NUMBERS, fromHash, momentOf, start as firstState, toHash } from "./state.js";

/** Milliseconds of rest after which a spectrum is asked for, and after which the address is written. */
const REST = 300;
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const PLACED = ["latitude", "longitude", "hour", "date"];

/**
 * Begin.  `root` holds the marked-up fields, `link` leads to the solver; with `address` the state is kept after the "#".
 * `given` is the state at first, `told(state)` hears of every change.
 */
export function start(root, link, { address = false, given = {}, told = () => {} } = {}) {
  return new Page(root, link, address, given, told);
}

class Page {
  constructor(root, link, address, given, told) {
    Object.assign(this, { root, link, address, told });
    this.state = { ...(address ? fromHash(location.hash) : firstState()), ...given };
    this.one = selector => root.querySelector(selector);
    this.canvases = { sky: this.one("canvas.sky"), nebula: this.one("canvas.nebula") };
    for (const node of link.alone ? root.querySelectorAll("[data-solver]") : []) node.hidden = true;
    this.controls = new Controls(root, (name, value) => this.change({ [name]: value }));
    this.one("form").addEventListener("submit", event => event.preventDefault());
    link.lost = words => {
      this.lost = true;
      this.status(words ?? "the line to the program is gone; if it has ended, start it again and open the address that it prints", null, true);
    };
    link.failed = error => this.status(`the page has failed: ${error.message}; please report it`, null, true);
    link.found = () => { if (this.lost) { this.lost = false; this.status("solving", 0); this.show(); } };
    this.pointer();
    this.buttons();
    if (address) addEventListener("hashchange", () => { if (location.hash.slice(1) !== toHash(this.state)) this.restore(); });
    new ResizeObserver(() => this.fit()).observe(this.one(".scene"));
    this.controls.show(this.state);
    this.begin();
  }

  /** Facts of all models, and meanwhile the picture that comes with the page. */
  begin() {
    const say = (...words) => this.status(...words);
    try {
      const sky = new SkyView(this.canvases.sky, this.link, say);
      sky.solved = () => this.answered();
      sky.settled = () => this.cross();
      this.views = { sky };
      sky.first({ model: "earth", haze: 1, ozone: 1, ground: null, altitude: 2 });
    } catch (error) { this.status(error.message, null, true); this.views = {}; }
    const nebula = new NebulaView(this.canvases.nebula, this.link, say);
    nebula.solved = () => this.answered();
    this.views.nebula = nebula;
    this.kind = this.views.sky ? "sky" : "nebula";
    if (this.views.sky) this.views.sky.state = this.state;
    this.link.ask("facts", {}, (message) => {
      if (message.what !== "facts") return;
      this.facts = message;
      if (!this.address || !/(^#|&)model=/.test(location.hash)) this.state.model = message.model;
      this.controls.models(message.models, this.state.model);
      this.choose();
    });
  }

  /** The model has been chosen: offer what it has. */
  choose() {
    const facts = this.facts.models.find(model => model.name === this.state.model) ?? this.facts.models[0];
    const another = this.chosen !== undefined && this.chosen !== facts.name;
    this.state.model = this.chosen = facts.name;
    this.about = facts;
    this.one(".about").textContent = facts.description;
    if (this.views[this.kind] && this.kind !== facts.kind) { this.views[this.kind].stop(); }
    this.kind = facts.kind;
    if (facts.kind === "nebula" && (another || !/(^#|&)(inclination|turn|fieldWidth)=/.test(this.address ? location.hash : ""))) {
      Object.assign(this.state, this.views.nebula.home(this.state, facts));
    }
    for (const node of this.root.querySelectorAll("[data-kind]")) node.hidden = node.dataset.kind !== facts.kind || (this.link.alone && "solver" in node.dataset);
    if (!facts.places) this.one("[data-group=place]").hidden = true;
    for (const name of ["haze", "ozone"]) {
      const offered = (facts.changes ?? []).includes(name);
      this.controls.offer(name, offered);
      if (!offered) this.state[name] = 1; // what this model lacks cannot be more or less
    }
    // Without a solver there is but the table's own ground and height.
    for (const name of ["ownGround", "ground", "altitude"]) this.controls.offer(name, !this.link.alone);
    this.controls.rows.altitude.field.max = facts.top ?? NUMBERS.altitude.most;
    this.state.altitude = Math.min(this.state.altitude, facts.top ?? NUMBERS.altitude.most);
    for (const [kind, canvas] of Object.entries(this.canvases)) canvas.hidden = kind !== facts.kind;
    if (another) this.clear();
    this.fit();
    this.show();
    if (this.state.cross) this.askPoint(REST);
  }

  /** Something is set. */
  change(values) {
    Object.assign(this.state, values);
    const names = Object.keys(values);
    if (names.includes("model") && values.model !== this.chosen) { this.choose(); return; }
    if (names.includes("ground") && !names.includes("ownGround")) this.state.ownGround = false;
    if (names.includes("exposure") && !names.includes("autoExposure")) this.state.autoExposure = false;
    if (names.includes("view")) this.fit();
    if (names.some(name => PLACED.includes(name)) && !names.includes("sunElevation")) this.askSun();
    this.show();
  }

  askSun() {
    const { model, latitude, longitude, altitude } = this.state;
    this.link.ask("sun", { model, latitude, longitude, altitude, time: momentOf(this.state) }, message => {
      if (message.what === "sun") {
        const elevation = +message.elevation.toFixed(4), lowest = NUMBERS.sunElevation.least;
        this.change({ sunElevation: Math.max(elevation, lowest), sunAzimuth: +message.azimuth.toFixed(4) });
        if (elevation < lowest) this.status(`night: the Sun stands at ${elevation.toFixed(1)}°, the picture is that of ${lowest}°`, null);
      }
      if (message.what === "error") this.status(message.words, null, true);
    });
  }

  /** Show the state: picture, fields, address. */
  show() {
    const { state } = this, widest = state.view === "perspective" ? FLAT : NUMBERS.fov.most;
    state.fov = Math.min(state.fov, widest);
    this.controls.rows.fov.field.max = widest;
    this.view?.show(state);
    this.controls.show(state);
    if (state.autoExposure && this.view?.exposure !== undefined) this.controls.rows.exposure.show(this.view.exposure);
    this.controls.offer("viewElevation", state.view === "perspective");
    this.controls.offer("viewAzimuth", state.view !== "fisheye");
    this.controls.offer("fov", state.view === "landscape" || state.view === "perspective");
    this.cross();
    this.root.querySelector(".said").hidden = true;
    this.root.querySelector("[data-act=model]").hidden = true;
    this.told(state);
    clearTimeout(this.writing);
    if (this.address) this.writing = setTimeout(() => history.replaceState(null, "", `#${toHash(state)}`), REST);
  }

  restore() {
    Object.assign(this.state, fromHash(location.hash));
    if (this.facts) this.choose();
  }

  status(words, share, wrong = false) {
    const line = this.one(".status"), bar = this.one(".share");
    if (line.textContent !== words) line.textContent = words;
    line.classList.toggle("wrong", wrong);
    bar.hidden = share === null;
    bar.value = share ?? 0;
  }

  /** The canvas takes the room that its view's shape leaves. */
  fit() {
    const frame = this.one(".frame"), canvas = this.canvases[this.kind], { clientWidth, clientHeight } = frame;
    if (!clientWidth || !clientHeight) return;
    const ratio = this.views[this.kind]?.ratio(this.state) ?? clientWidth / clientHeight;
    const width = Math.floor(Math.min(clientWidth, clientHeight * ratio)), height = Math.floor(Math.min(clientHeight, clientWidth / ratio));
    Object.assign(canvas.style, { width: `${width}px`, height: `${height}px` });
    const dense = Math.min(Math.max(devicePixelRatio, 1), 2);
    if (this.kind === "sky") this.views.sky?.resize(Math.round(width * dense), Math.round(height * dense));
    else if (this.kind === "nebula" && this.facts) this.views.nebula.show(this.state);
    this.cross();
  }

  /** Dragging looks around, a click sets the crosshair, moving reads. */
  pointer() {
    for (const canvas of Object.values(this.canvases)) {
      let from = null, moved = 0;
      const place = event => {
        const box = canvas.getBoundingClientRect();
        return [(event.clientX - box.left) / box.width * canvas.width - 0.5, (event.clientY - box.top) / box.height * canvas.height - 0.5];
      };
      canvas.addEventListener("pointerdown", event => { from = [event.clientX, event.clientY]; moved = 0; canvas.setPointerCapture(event.pointerId); });
      canvas.addEventListener("pointermove", event => {
        if (!from) { if (!this.state.cross) this.read(...place(event)); return; }
        const [dx, dy] = [event.clientX - from[0], event.clientY - from[1]];
        moved = Math.max(moved, Math.hypot(dx, dy));
        if (moved > 4) { this.change(this.view.look(this.state, dx, dy)); from = [event.clientX, event.clientY]; }
      });
      canvas.addEventListener("pointerup", event => { if (from && moved <= 4) this.mark(...place(event)); from = null; });
      canvas.addEventListener("pointercancel", () => { from = null; });
      canvas.addEventListener("pointerleave", () => { if (!this.state.cross) this.numbers(null); });
      canvas.addEventListener("wheel", event => {
        if (document.activeElement !== canvas) return; // else the page scrolls
        event.preventDefault();
        this.change(this.view.zoom(this.state, Math.exp(event.deltaY / 800)));
      }, { passive: false });
      canvas.addEventListener("keydown", event => this.key(event, canvas));
    }
  }

  get view() { return this.views[this.kind]; }

  key(event, canvas) {
    const step = KEYS[event.key], { state } = this;
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (step && event.shiftKey) {
      const size = Math.max(canvas.width / 64, 1), [x, y] = this.crossPixel() ?? [(canvas.width - 1) / 2, (canvas.height - 1) / 2];
      const next = this.crossPixel() ? [x + step[0] * size, y + step[1] * size] : [x, y];
      this.mark(Math.min(Math.max(next[0], 0), canvas.width - 1), Math.min(Math.max(next[1], 0), canvas.height - 1));
    } else if (step) this.change(this.view.look(state, -step[0] * canvas.clientWidth / 36, -step[1] * canvas.clientWidth / 36));
    else if (event.key === "+" || event.key === "=") this.change(this.view.zoom(state, 0.8));
    else if (event.key === "-") this.change(this.view.zoom(state, 1.25));
    else if (event.key === "Home") this.change(this.view.home(state, this.about));
    else if (event.key === "Enter") { if (state.cross) this.askPoint(0); else this.mark((canvas.width - 1) / 2, (canvas.height - 1) / 2); }
    else if (event.key === "Escape") this.clear();
    else return;
    event.preventDefault();
  }

  /** Set the crosshair on a pixel. */
  mark(x, y) {
    const found = this.view?.at(x, y);
    if (!found) return;
    this.state.cross = this.kind === "sky" ? [found.direction.azimuth, found.direction.elevation] : found.place;
    this.show();
    this.askPoint(REST);
  }

  clear() {
    this.state.cross = null;
    clearTimeout(this.pointing);
    this.link.drop(`${this.kind}-point`);
    this.one(".spectrum").hidden = true;
    this.numbers(null);
    this.cross();
  }

  crossPixel() { return this.state.cross && this.view?.state ? this.view.pixel(...this.state.cross) : null; }

  /** Draw the crosshair, and read what is beneath it. */
  cross() {
    const mark = this.one(".cross"), canvas = this.canvases[this.kind], pixel = this.crossPixel();
    mark.hidden = !pixel;
    if (!pixel) { if (this.state.cross) this.numbers(null); return; }
    const scale = canvas.clientWidth / canvas.width;
    mark.style.left = `${canvas.offsetLeft + (pixel[0] + 0.5) * scale}px`;
    mark.style.top = `${canvas.offsetTop + (pixel[1] + 0.5) * scale}px`;
    this.read(...pixel);
    const key = JSON.stringify({ ...this.view.question(this.state.cross) });
    if (!this.one(".spectrum").hidden && key !== this.pointed) this.askPoint(2 * REST);
  }

  read(x, y) {
    const found = this.view?.at(x, y);
    this.numbers(found);
  }

  /** Say where the crosshair is and what comes from there. */
  numbers(found) {
    const out = this.one(".numbers");
    if (!found) { out.textContent = this.link.alone ? "" : "Click into the picture for its numbers and the spectrum."; out.value && (out.dataset.luminance = ""); return; }
    const [X, Y, Z] = found.xyz, sum = X + Y + Z, words = [];
    if (found.direction) words.push(`elevation ${found.direction.elevation.toFixed(2)}°`, `azimuth ${found.direction.azimuth.toFixed(2)}°`);
    const error = found.error === undefined || !(Y > 0) ? "" : ` ± ${(100 * found.error / Y).toPrecision(2)} %`;
    words.push(`luminance ${amount(Y)}${error} cd m⁻²`);
    if (sum > 0) words.push(`x ${(X / sum).toFixed(4)}, y ${(Y / sum).toFixed(4)}`);
    out.textContent = words.join(" · ");
    out.dataset.luminance = Y;
  }

  /** Ask for the spectrum at the crosshair, after some rest. */
  askPoint(rest) {
    clearTimeout(this.pointing);
    if (this.link.alone) return;
    this.pointing = setTimeout(() => {
      if (!this.state.cross || !this.view) return;
      const { kind, ...question } = this.view.question(this.state.cross), box = this.one(".spectrum");
      this.pointed = JSON.stringify({ kind, ...question });
      box.hidden = false;
      box.classList.add("old");
      const caption = this.one(".caption");
      caption.textContent = "asking the solver";
      this.link.ask(kind, question, message => {
        if (message.what === "share") caption.textContent = `asking the solver, ${Math.round(100 * message.share)} %`;
        if (message.what === "error") caption.textContent = message.words;
        if (message.what === "spectrum") this.spectrum(message);
      });
    }, rest);
  }

  spectrum(message) {
    const box = this.one(".spectrum"), drawn = plot(message);
    box.classList.remove("old");
    this.one(".plot").replaceChildren(drawn.svg);
    this.one(".caption").textContent = `luminance ${amount(message.xyz[1])} cd m⁻²; ${drawn.caption}`;
    box.dataset.luminance = message.xyz[1];
  }

  /** The picture has become better: so may the numbers. */
  answered() {
    this.cross();
    if (this.state.autoExposure && this.view.exposure !== undefined) this.controls.rows.exposure.show(this.view.exposure);
    if (this.state.cross && this.kind === "nebula" && !this.one(".spectrum").hidden) this.askPoint(REST);
  }

  buttons() {
    const acts = { command: () => this.command(), link: () => this.copy(location.href, "the link is copied"), png: () => this.savePng(), model: () => this.saveModel() };
    for (const [name, act] of Object.entries(acts)) this.one(`[data-act=${name}]`).addEventListener("click", act);
    if (!this.address) this.one("[data-act=link]").hidden = true;
  }

  command() {
    const { kind, ...question } = this.view.commanded();
    this.link.ask(kind, question, message => {
      if (message.what === "error") this.status(message.words, null, true);
      if (message.what !== "command") return;
      const said = this.one(".said"), save = this.one("[data-act=model]");
      said.hidden = false;
      this.one(".command").value = message.command;
      this.file = message.file ? [message.file, message.text] : null;
      save.hidden = !this.file;
      this.copy(message.command, this.file ? `the command is copied; it needs ${this.file[0]}: save the model` : "the command is copied");
    });
  }

  async copy(text, words) {
    try { await navigator.clipboard.writeText(text); this.status(words, null); }
    catch { this.one(".command").value = text; this.one(".said").hidden = false; this.one(".command").select(); this.status("select the text and copy it", null); }
  }

  async savePng() {
    const png = await this.view?.png();
    if (png) save(png, `${this.about?.title ?? "sky"}.png`);
  }

  saveModel() { if (this.file) save(new Blob([this.file[1]], { type: "application/toml" }), this.file[0]); }
}

/** A number of four digits, with a power of ten where it is far from one. */
function amount(value) {
  const size = Math.abs(value);
  if (size === 0 || (size >= 0.01 && size < 1e5)) return String(+value.toPrecision(4));
  const power = Math.floor(Math.log10(size));
  return `${(value / 10 ** power).toFixed(3)}·10${superscript(power)}`;
}

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** The page in an element of a notebook, whose model keeps the state; returns what ends it. */
export function embed(element, model, link) {
  // Several windows may stand in one document: each has names of its own.
  const own = `window-${Math.random().toString(36).slice(2, 8)}`;
  element.innerHTML = model.get("_markup").replaceAll("window-", `${own}-`);
  const root = element.firstElementChild;
  root.style.height = `${model.get("_height")}px`;
  let late = 0;
  const told = state => {
    clearTimeout(late);
    late = setTimeout(() => { model.set("state", { ...state }); model.save_changes(); }, REST);
  };
  const page = start(root, link, { given: model.get("state"), told });
  const changed = () => { const state = model.get("state"); if (JSON.stringify(state) !== JSON.stringify({ ...page.state })) page.change(state); };
  model.on("change:state", changed);
  return () => { clearTimeout(late); page.view?.stop(); model.off("change:state", changed); };
}
