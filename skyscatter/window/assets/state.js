// What the page shows, as one plain object, and as the part of an address after the "#".

/** Numbers that can be set: ends and step of their sliders, values at first, and the ends of their fields where these go further. */
export const NUMBERS = {
  sunElevation: { group: "sun", label: "Elevation", low: -14, high: 90, step: 0.1, value: 30, least: -14, unit: "°" },
  sunAzimuth: { group: "sun", label: "Azimuth", low: 0, high: 360, step: 0.5, value: 180, unit: "°" },
  latitude: { group: "place", label: "Latitude", low: -90, high: 90, step: 0.01, value: 48.86, unit: "°" },
  longitude: { group: "place", label: "Longitude", low: -180, high: 180, step: 0.01, value: 2.35, unit: "°" },
  hour: { group: "place", label: "Time, UTC", low: 0, high: 24, step: 0.05, value: 12, unit: "h" },
  haze: { group: "air", label: "Haze", low: 0, high: 4, step: 0.02, value: 1, most: 10, unit: "×" },
  ozone: { group: "air", label: "Ozone", low: 0, high: 4, step: 0.02, value: 1, most: 10, unit: "×" },
  ground: { group: "air", label: "Albedo", low: 0, high: 1, step: 0.01, value: 0.2, unit: "" },
  altitude: { group: "air", label: "Height", low: 0, high: 9000, step: 1, value: 2, most: 400000, unit: "m" },
  viewAzimuth: { group: "view", label: "Look to", low: 0, high: 360, step: 0.5, value: 180, unit: "°" },
  viewElevation: { group: "view", label: "Look up", low: -90, high: 90, step: 0.5, value: 15, unit: "°" },
  fov: { group: "view", label: "Width", low: 10, high: 170, step: 0.5, value: 100, least: 1, most: 360, unit: "°" },
  inclination: { group: "side", label: "Inclination", low: -180, high: 180, step: 1, value: 0, least: -360, most: 360, unit: "°" },
  turn: { group: "side", label: "Turn", low: -180, high: 180, step: 1, value: 0, least: -360, most: 360, unit: "°" },
  fieldWidth: { group: "side", label: "Width", low: 0.01, high: 5, step: 0.01, value: 1, least: 1e-9, most: 1e6, unit: "pc" },
  exposure: { group: "exposure", label: "Exposure", low: -12, high: 20, step: 0.1, value: 14, least: -30, most: 30, unit: "EV" },
};
/** The widest picture on a plane [°]. */
export const FLAT = 170;
export const VIEWS = { landscape: "Landscape", panorama: "Panorama", fisheye: "Fisheye", perspective: "Perspective" };

/** A state before anything was changed. */
export function start() {
  const state = { model: "earth", date: "2026-06-21", view: "landscape", ownGround: true, autoExposure: true, cross: null };
  for (const [name, spec] of Object.entries(NUMBERS)) state[name] = spec.value;
  return state;
}

/** A finite number within the bounds of a field; NaN where the text is none. */
export function numberOf(name, text) {
  const spec = NUMBERS[name], value = Number(text);
  if (String(text).trim() === "" || !Number.isFinite(value)) return NaN;
  return Math.min(Math.max(value, spec.least ?? spec.low), spec.most ?? spec.high);
}

/** The state as text for an address: what differs from the start. */
export function toHash(state) {
  const first = start(), words = new URLSearchParams();
  for (const name of Object.keys(first)) {
    const value = state[name];
    if (name === "cross") { if (value) words.set("cross", value.map(v => +v.toFixed(3)).join(",")); }
    else if (name === "model" || value !== first[name]) words.set(name, typeof value === "number" ? +value.toPrecision(9) : value);
  }
  return words.toString();
}

/** The state that an address holds; what makes no sense is left as it was at the start. */
export function fromHash(text) {
  const state = start(), words = new URLSearchParams(text.replace(/^#/, ""));
  for (const [name, value] of words) {
    if (name in NUMBERS) { const number = numberOf(name, value); if (!Number.isNaN(number)) state[name] = number; }
    else if (name === "view") { if (value in VIEWS) state.view = value; }
    else if (name === "ownGround" || name === "autoExposure") state[name] = value === "true";
    else if (name === "date") { if (/^\d{4}-\d\d-\d\d$/.test(value) && !Number.isNaN(Date.parse(`${value}T00:00:00Z`))) state.date = value; }
    else if (name === "cross") { const c = value.split(",").map(Number); if (c.length === 2 && c.every(Number.isFinite)) state.cross = c; }
    else if (name === "model") state.model = value;
  }
  return state;
}

/** The view as `skyscatter sky --view` takes it. */
export function viewText(state) {
  const number = value => String(+value.toPrecision(6));
  if (state.view === "landscape") return `landscape:${number(state.viewAzimuth)},${number(state.fov)}`;
  if (state.view === "panorama") return `panorama:${number(state.viewAzimuth)}`;
  if (state.view === "perspective") return `perspective:${number(state.viewAzimuth)},${number(state.viewElevation)},${number(state.fov)}`;
  return "fisheye";
}

/** The same view as the picture takes it: panoramas and fisheyes are whole. */
export function viewOf(state) {
  const { view: kind, viewAzimuth: azimuth, viewElevation: elevation, fov } = state;
  return { landscape: { kind, azimuth, fov }, panorama: { kind, azimuth }, fisheye: { kind }, perspective: { kind, azimuth, elevation, fov } }[kind];
}

/** The moment that is set, in UTC. */
export function momentOf(state) {
  const seconds = Math.round(state.hour * 3600);
  return new Date(Date.parse(`${state.date}T00:00:00Z`) + 1000 * seconds).toISOString().slice(0, 19) + "Z";
}
