// The sky of a table, drawn at once for any Sun and view: by WebGL2, or by JavaScript alone where there is none.
//
// What the numbers mean stands in docs/howto-sky-table.md; the picture is developed as `skyscatter sky` does it
// (skyscatter/image/tone.py, glare.py, nightvision.py).  Angles are in degrees outside of this module, radians within.

const RAD = Math.PI / 180;
const MAGIC = "SKYTABLE", VERSION = 1;
const TYPES = {uint16: Uint16Array, int16: Int16Array, float32: Float32Array};

// --- small linear algebra ------------------------------------------------------------------------------------------

const times = (m, v) => m.map(row => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
const product = (a, b) => a.map(row => [0, 1, 2].map(j => row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]));
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (m, factors) => m.map((row, i) => row.map(x => x * factors[i]));
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const columns = m => new Float32Array([0, 1, 2].flatMap(j => m.map(row => row[j])));  // as GLSL has matrices

function inverse(m) {
  const rows = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
  const whole = dot(m[0], rows[0]);
  return [0, 1, 2].map(i => rows.map(row => row[i] / whole));
}

// --- the table -----------------------------------------------------------------------------------------------------

/** Four nodes around a point and the weights of Lagrange's cubic; a line where the cubic would be wild. */
function cubic(nodes, x) {
  let after = 0;
  while (after < nodes.length && nodes[after] <= x) after++;
  const first = clamp(after - 2, 0, nodes.length - 4);
  const weights = [1, 1, 1, 1];
  let size = 0;
  for (let a = 0; a < 4; a++) {
    for (let b = 0; b < 4; b++) {
      if (a !== b) weights[a] *= (x - nodes[first + b]) / (nodes[first + a] - nodes[first + b]);
    }
    size += Math.abs(weights[a]);
  }
  if (size > 8) {
    const here = clamp(after - 1, 0, nodes.length - 2);
    const share = clamp((x - nodes[here]) / (nodes[here + 1] - nodes[here]), 0, 1);
    weights.fill(0);
    weights[here - first] = 1 - share;
    weights[here - first + 1] = share;
  }
  return {first, weights};
}

/** Two nodes around a point, and the share of the second; the ends go on. */
function line(nodes, x) {
  let [first, end] = [0, nodes.length - 1];
  while (end - first > 1) {
    const middle = (first + end) >> 1;
    if (nodes[middle] <= x) first = middle;
    else end = middle;
  }
  return {first, share: clamp((x - nodes[first]) / (nodes[first + 1] - nodes[first]), 0, 1)};
}

/** Cell among angles whose cosines are 1 - 2 (k / last)², and the place in it. */
function angleCell(cosine, last) {
  const cell = Math.min(Math.floor(Math.sqrt(Math.max(0.5 * (1 - cosine), 0)) * last), last - 1);
  const scale = 2 / (last * last);
  return {cell, share: clamp((1 - scale * cell * cell - cosine) / (scale * (2 * cell + 1)), 0, 1)};
}

/** A table of a sky: what its file says, and light along any direction under one Sun. */
export class SkyTable {
  constructor(buffer) {
    const bytes = new Uint8Array(buffer);
    const magic = String.fromCharCode(...bytes.subarray(0, 8));
    if (magic !== MAGIC) throw new Error("this is no table of a sky");
    const length = new DataView(buffer).getUint32(8, true);
    const header = JSON.parse(new TextDecoder().decode(bytes.subarray(12, 12 + length)));
    if (header.version !== VERSION) throw new Error(`a table of version ${header.version}; this page reads ${VERSION}`);
    this.header = header;
    this.shape = {};
    for (const [name, {dtype, shape, offset}] of Object.entries(header.arrays)) {
      const count = shape.reduce((a, b) => a * b, 1);
      this[name] = new TYPES[dtype](buffer, 12 + length + offset, count);
      this.shape[name] = shape;
    }
    [, this.blocks, , this.rows, this.turns] = this.shape.light;
    this.lower = this.elevation.subarray(0, header.below);
    this.upper = this.elevation.subarray(header.below);
    const turn = this.turn;
    this.mirrored = [-turn[1], ...turn, 2 * Math.PI - turn[turn.length - 2]];
  }

  /** Binary logarithms of the light under a Sun, (block, 3, elevation, turn). */
  under(sunElevation, change = {}) {
    const {sun, light, light_low: low, light_step: step} = this;
    const size = this.rows * this.turns, sheets = this.blocks * 3;
    const {first, weights} = cubic(sun, clamp(sunElevation, sun[0], sun[sun.length - 1]));
    const found = new Float64Array(sheets * size);
    for (let k = 0; k < 4; k++) {
      for (let sheet = 0; sheet < sheets; sheet++) {
        const at = (first + k) * sheets + sheet, from = at * size, to = sheet * size;
        const base = weights[k] * low[at], each = weights[k] * step[at];
        for (let i = 0; i < size; i++) found[to + i] += base + each * light[from + i];
      }
    }
    this.#change(found, sunElevation, change);
    return found;
  }

  /** Take the derivatives of another table of the same model: those of a coarse one are in none. */
  borrow(other) {
    if (this.header.changes.length || other.blocks !== this.blocks) return;
    if (other.header.settings.model !== this.header.settings.model) return;
    Object.assign(this.header, {changes: other.header.changes, change_step: other.header.change_step});
    for (const name of ["change", "change_sun", "change_elevation", "change_turn", "disk_change"]) {
      this[name] = other[name];
      this.shape[name] = other.shape[name];
    }
  }

  /** How far logarithms move per unit of the derivatives, for changes of haze, ozone and ground. */
  steps(change) {
    return this.header.changes.map(({name, law}) => {
      const factor = change[name] ?? 1;
      return law === "power" ? Math.log2(Math.max(factor, 1e-6)) : factor - 1;
    });
  }

  #change(logarithms, sunElevation, change) {
    const steps = this.steps(change);
    const sun = line(this.change_sun, sunElevation);
    steps.forEach((step, which) => {
      if (step === 0) return;
      const [, , blocks, , rows, turns] = this.shape.change;
      const across = [...this.elevation].map(x => line(this.change_elevation, x));
      const along = [...this.turn].map(x => line(this.change_turn, x));
      for (let sheet = 0; sheet < blocks * 3; sheet++) {
        for (let s = 0; s < 2; s++) {
          const share = step * this.header.change_step * (s ? sun.share : 1 - sun.share);
          const from = ((which * this.change_sun.length + sun.first + s) * blocks * 3 + sheet) * rows * turns;
          for (let i = 0; i < this.rows; i++) {
            for (let j = 0; j < this.turns; j++) {
              const a = across[i], b = along[j], at = from + a.first * turns + b.first;
              const one = this.change[at] * (1 - b.share) + this.change[at + 1] * b.share;
              const two = this.change[at + turns] * (1 - b.share) + this.change[at + turns + 1] * b.share;
              logarithms[(sheet * this.rows + i) * this.turns + j] += share * (one * (1 - a.share) + two * a.share);
            }
          }
        }
      }
    });
  }

  /** Nodes of elevation around a direction and their weights; nothing is joined across the horizon. */
  across(elevation) {
    const nodes = elevation < this.header.horizon ? this.lower : this.upper;
    const {first, weights} = cubic(nodes, clamp(elevation, nodes[0], nodes[nodes.length - 1]));
    return {first: first + (nodes === this.lower ? 0 : this.header.below), weights};
  }

  /** Nodes of azimuth from the Sun around a direction and their weights, mirrored at both ends. */
  along(turn) {
    const {first, weights} = cubic(this.mirrored, turn), last = this.turns - 1;
    const numbers = [0, 1, 2, 3].map(k => {
      const n = Math.abs(first + k - 1);
      return n > last ? 2 * last - n : n;
    });
    return {numbers, weights};
  }

  /** Phase function of a term at an angle from the Sun, for rays at an elevation [sr-1]. */
  phaseOf(term, cosine, elevation) {
    const count = this.shape.phase[1], nearCount = this.shape.near[2], {cell, share} = angleCell(cosine, count - 1);
    const from = term * count + cell;
    let found = this.phase[from] * (1 - share) + this.phase[from + 1] * share;
    if (cell + 1 < nearCount) {
      const {first, weights} = this.across(elevation);
      for (let k = 0; k < 4; k++) {
        const at = (term * this.rows + first + k) * nearCount + cell;
        found -= weights[k] * (this.near[at] * (1 - share) + this.near[at + 1] * share);
      }
    }
    return found;
  }

  /** XYZ of the sky [cd m-2] without the Sun's disk, by cubics; `logarithms` are those of `under`. */
  colour(logarithms, elevation, turn, cosine) {
    const rows = this.across(elevation), {numbers, weights} = this.along(turn), found = [0, 0, 0];
    for (let block = 0; block < this.blocks; block++) {
      const phase = block < this.blocks - 1 ? this.phaseOf(block, cosine, elevation) : 1;
      for (let c = 0; c < 3; c++) {
        let sum = 0;
        for (let i = 0; i < 4; i++) {
          const row = ((block * 3 + c) * this.rows + rows.first + i) * this.turns;
          for (let j = 0; j < 4; j++) sum += rows.weights[i] * weights[j] * logarithms[row + numbers[j]];
        }
        found[c] += phase * 2 ** sum;
      }
    }
    return found;
  }

  /** XYZ of the Sun's disk [cd m-2] at a squared distance from its middle, as a share of its radius. */
  disk(square, elevation, change = {}) {
    if (!(square <= 1) || elevation < this.header.horizon) return null;
    const place = line(this.disk_elevation, elevation), steps = this.steps(change);
    const rings = this.shape.disk_rings[0], ring = square * (rings - 1), k = Math.min(Math.floor(ring), rings - 2);
    const places = this.disk_elevation.length;
    return [0, 1, 2].map(c => {
      const value = (array, from) =>
        array[from + place.first * 3 + c] * (1 - place.share) + array[from + place.first * 3 + 3 + c] * place.share;
      let logarithm = value(this.disk_light, 0);
      steps.forEach((_, which) => {
        const {name} = this.header.changes[which];
        if (name !== "ground") logarithm += ((change[name] ?? 1) - 1) * value(this.disk_change, which * places * 3);
      });
      const shape = this.disk_rings[3 * k + c] * (1 - ring + k) + this.disk_rings[3 * k + 3 + c] * (ring - k);
      return shape * 2 ** logarithm;
    });
  }
}

// --- the sky under one Sun, on a grid that is even in rows and columns and fine enough for lines between -------------

const TIE = 1e-7;  // in single precision rows of pixels are told from the horizon [rad] by no less
const GRID = {below: 32, above: 176, turns: 72, up: 2, bent: 2};

class Grid {
  /** `before` is one of the same table under another Sun. */
  constructor(table, sunElevation, change, before) {
    const {below, above, turns} = GRID, {horizon} = table.header;
    this.table = table;
    this.horizon = horizon;
    this.near = clamp(-horizon, 0.02 * RAD, RAD);
    this.deepest = Math.asinh((Math.PI / 2 + horizon) / this.near);
    this.rows = below + above;
    const elevations = [];
    for (let i = 0; i < below; i++) {
      elevations.push(horizon - 1e-7 - this.near * Math.sinh((this.deepest * (below - 1 - i)) / (below - 1)));
    }
    for (let i = 0; i < above; i++) {
      elevations.push(horizon + 1e-7 + (Math.PI / 2 - horizon) * (i / (above - 1)) ** GRID.up);
    }
    this.across = elevations.map(e => table.across(e));
    this.along = Array.from({length: turns}, (_, j) => table.along(Math.PI * (j / (turns - 1)) ** GRID.bent));
    this.lost = before?.table === table ? before.lost : this.#lost();
    this.values = this.#values(table.under(sunElevation, change));
  }

  /** Light at all places, (block, row, turn, 4). */
  #values(logarithms) {
    const {table, rows} = this, {turns} = GRID, found = new Float32Array(table.blocks * rows * turns * 4);
    const strip = new Float64Array(table.turns);
    for (let block = 0; block < table.blocks; block++) {
      for (let c = 0; c < 3; c++) {
        for (let i = 0; i < rows; i++) {
          const {first, weights} = this.across[i];
          const from = ((block * 3 + c) * table.rows + first) * table.turns;
          for (let j = 0; j < table.turns; j++) {
            strip[j] = 0;
            for (let k = 0; k < 4; k++) strip[j] += weights[k] * logarithms[from + k * table.turns + j];
          }
          for (let j = 0; j < turns; j++) {
            const {numbers, weights: w} = this.along[j];
            const sum = w[0] * strip[numbers[0]] + w[1] * strip[numbers[1]]
              + w[2] * strip[numbers[2]] + w[3] * strip[numbers[3]];
            found[((block * rows + i) * turns + j) * 4 + c] = 2 ** sum;
          }
        }
      }
    }
    return found;
  }

  /** What phase functions lose close to the Sun at the rows of the grid, (term, row, angle). */
  #lost() {
    const {table, rows} = this, count = table.shape.near[2], terms = table.blocks - 1;
    const found = new Float32Array(terms * rows * count);
    for (let term = 0; term < terms; term++) {
      for (let i = 0; i < rows; i++) {
        const {first, weights} = this.across[i];
        for (let a = 0; a < count; a++) {
          let sum = 0;
          for (let k = 0; k < 4; k++) sum += weights[k] * table.near[(term * table.rows + first + k) * count + a];
          found[(term * rows + i) * count + a] = sum;
        }
      }
    }
    return found;
  }

  /** XYZ along a ray, as the shader has it. */
  light(elevation, turn, cosine) {
    const {table, rows, values} = this, {below, above, turns} = GRID;
    const down = elevation < this.horizon;
    const x = clamp(Math.sqrt(turn / Math.PI) * (turns - 1), 0, turns - 1);
    const y = down
      ? (below - 1) * (1 - clamp(Math.asinh((this.horizon - elevation) / this.near) / this.deepest, 0, 1))
      : below + (above - 1) * Math.sqrt(Math.max((elevation - this.horizon) / (Math.PI / 2 - this.horizon), 0));
    const i = Math.min(Math.floor(y), down ? below - 2 : rows - 2), j = Math.min(Math.floor(x), turns - 2);
    const v = clamp(y - i, 0, 1), u = x - j, found = [0, 0, 0];
    const count = table.shape.phase[1], near = table.shape.near[2], {cell, share} = angleCell(cosine, count - 1);
    const mixed = (array, from) => array[from] * (1 - share) + array[from + 1] * share;
    for (let block = 0; block < table.blocks; block++) {
      let phase = block < table.blocks - 1 ? mixed(table.phase, block * count + cell) : 1;
      if (block < table.blocks - 1 && cell + 1 < near) {
        const from = (block * rows + i) * near + cell;
        phase -= (1 - v) * mixed(this.lost, from) + v * mixed(this.lost, from + near);
      }
      const at = ((block * rows + i) * turns + j) * 4, next = at + turns * 4;
      for (let c = 0; c < 3; c++) {
        found[c] += phase * ((1 - v) * ((1 - u) * values[at + c] + u * values[at + 4 + c])
          + v * ((1 - u) * values[next + c] + u * values[next + 4 + c]));
      }
    }
    return found;
  }
}

// --- views: between pixels and directions (skyscatter/geometry/camera.py) -------------------------------------------

function direction(azimuth, elevation) {
  const across = Math.cos(elevation);
  return [across * Math.sin(azimuth), across * Math.cos(azimuth), Math.sin(elevation)];
}

function frame(azimuth, elevation) {
  const [s, c, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation)];
  const forward = [ce * s, ce * c, se], up = [-se * s, -se * c, ce];
  return {forward, right: cross(forward, up), up};
}

class View {
  constructor({kind, azimuth, elevation, fov}, sunAzimuth, horizon, width, height) {
    Object.assign(this, {kind, width, height});
    if (kind === "landscape" || kind === "panorama") {
      this.azimuth = (azimuth ?? sunAzimuth) * RAD;
      this.fov = (fov ?? (kind === "landscape" ? 120 : 360)) * RAD;
      if (kind === "panorama") [this.low, this.high] = [-Math.PI / 2, Math.PI / 2];
      else {
        const high = (this.fov * height) / width, low = horizon - high / 6;
        [this.low, this.high] = [Math.max(low, -Math.PI / 2), Math.min(low + high, Math.PI / 2)];
      }
      this.number = 0;
    } else if (kind === "fisheye") {
      Object.assign(this, frame((azimuth ?? 180) * RAD, (elevation ?? 90) * RAD));
      this.half = ((fov ?? 180) * RAD) / 2;
      this.radius = Math.min(width, height) / 2;
      this.number = 1;
    } else if (kind === "perspective") {
      Object.assign(this, frame((azimuth ?? sunAzimuth) * RAD, (elevation ?? 0) * RAD));
      this.focal = width / 2 / Math.tan(((fov ?? 60) * RAD) / 2);
      this.number = 2;
    } else throw new Error(`view ${kind}: landscape, panorama, fisheye or perspective`);
  }

  /** Unit vector (east, north, up) through a point of the picture; null outside a fisheye's circle. */
  through(x, y) {
    const a = x - (this.width - 1) / 2, b = (this.height - 1) / 2 - y;
    if (this.number === 0) {
      const elevation = (this.low + this.high) / 2 + ((this.high - this.low) * b) / this.height;
      return direction(this.azimuth + (this.fov * a) / this.width, clamp(elevation, this.low, this.high));
    }
    const mixed = (f, p, q) => [0, 1, 2].map(k => f * this.forward[k] + p * this.right[k] + q * this.up[k]);
    if (this.number === 1) {
      const length = Math.hypot(a, b);
      if (length > this.radius) return null;
      const angle = Math.min((length / this.radius) * this.half, Math.PI), share = Math.sin(angle) / (length || 1);
      return mixed(Math.cos(angle), a * share, b * share);
    }
    const d = mixed(this.focal, a, b), size = Math.hypot(...d);
    return d.map(value => value / size);
  }

  /** Where a direction is in the picture, beyond its edges too; null where it is nowhere. */
  pixel(d) {
    const [cx, cy] = [(this.width - 1) / 2, (this.height - 1) / 2];
    if (this.number === 0) {
      const turn = Math.atan2(d[0], d[1]) - this.azimuth;
      const from = turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI));
      const elevation = Math.atan2(d[2], Math.hypot(d[0], d[1]));
      const b = ((elevation - (this.low + this.high) / 2) * this.height) / (this.high - this.low);
      return [cx + (from / this.fov) * this.width, cy - b];
    }
    const [ahead, a, b] = [dot(d, this.forward), dot(d, this.right), dot(d, this.up)];
    if (this.number === 1) {
      const length = Math.hypot(a, b), scale = (this.radius * Math.atan2(length, ahead)) / this.half / (length || 1);
      return [cx + a * scale, cy - b * scale];
    }
    return ahead > 0 ? [cx + (a * this.focal) / ahead, cy - (b * this.focal) / ahead] : null;
  }
}

// --- developing (skyscatter/image/tone.py) --------------------------------------------------------------------------

const TO_RGB = (() => {  // XYZ to linear sRGB, by its primaries and white
  const white = [0.3127, 0.329], corners = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06]];
  const xyz = ([x, y]) => [x / y, 1, (1 - x - y) / y], three = corners.map(xyz);
  const primaries = [0, 1, 2].map(i => three.map(corner => corner[i]));
  const amounts = times(inverse(primaries), xyz(white));
  return inverse(primaries.map(row => row.map((value, k) => value * amounts[k])));
})();
const TO_XYZ = inverse(TO_RGB), LUMA = TO_XYZ[1];
const OKLAB = [
  [0.2104542553, 0.793617785, -0.0040720468], [1.9779984951, -2.428592205, 0.4505937099],
  [0.0259040371, 0.7827717662, -0.8086757660],
];
const LMS = (() => {
  const m = product([
    [0.8189330101, 0.3618667424, -0.1288597137], [0.0329845436, 0.9293118715, 0.0361456387],
    [0.0482003018, 0.2643662691, 0.633851707],
  ], TO_XYZ);
  return m.map(row => row.map(value => value / (row[0] + row[1] + row[2])));
})();
const FROM_OKLAB = inverse(OKLAB), FROM_LMS = inverse(LMS);
const WHITE_LAB = OKLAB.map(row => row[0] + row[1] + row[2]);
const BRADFORD = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
const D65 = [0.3127 / 0.329, 1, (1 - 0.3127 - 0.329) / 0.329];
const GREY = 0.18, METER = 0.125, SHARE = 0.01, CORE = 0.002, BRIGHT = 8;

const adaptation = luminance => {
  const k4 = (1 / (5 * luminance + 1)) ** 4;
  return k4 * luminance + 0.1 * (1 - k4) ** 2 * Math.cbrt(5 * luminance);
};
const STRENGTH = (adaptation(1000) / adaptation(20)) ** 0.25;

/** As numpy's: linear between the values of a sorted list. */
function percentile(sorted, share) {
  const at = (sorted.length - 1) * share / 100, k = Math.floor(at);
  return sorted[k] + (at - k) * (sorted[Math.min(k + 1, sorted.length - 1)] - sorted[k]);
}

/** Exposure value (ISO 100) that suits a sky with these luminances [cd m-2]. */
function autoExposure(luminances) {
  let values = luminances.filter(y => y > 0 && Number.isFinite(y)).sort();
  let ev = 0;
  if (values.length) {
    const floor = 1e-3 * percentile(values, 99);
    values = values.filter(y => y >= floor);
    const [low, high, bright] = [5, 95, 98].map(share => percentile(values, share));
    const inner = values.filter(y => y >= low && y <= high), kept = inner.length ? inner : values;
    const mean = kept.reduce((sum, y) => sum + Math.log2(y), 0) / kept.length;
    ev = Math.max(mean - 0.7, Math.log2(bright) - 3.5) - Math.log2(METER);
  }
  const key = 1.03 - 2 / (2 + Math.log10(2 ** ev * METER + 1));  // by night it looks dark
  return ev + Math.max(Math.log2(GREY / key), 0);
}

/** Matrix by which a camera takes the night's own colour for white; none by day. */
function balance(samples, ev) {
  const share = clamp((-2 - ev) / 3, 0, 1), seen = samples.filter(xyz => xyz[1] > 0);
  if (share === 0 || !seen.length) return null;
  const light = Float64Array.from(seen, xyz => xyz[1]).sort();
  const low = percentile(light, 5), high = percentile(light, 90), mean = [0, 0, 0];
  const chosen = seen.filter(xyz => xyz[1] >= low && xyz[1] <= high);
  for (const xyz of chosen) for (let c = 0; c < 3; c++) mean[c] += xyz[c] / xyz[1] / chosen.length;
  const response = times(BRADFORD, mean.map(value => value / mean[1])), white = times(BRADFORD, D65);
  const degree = 0.75 * share * share * (3 - 2 * share);
  const gains = [0, 1, 2].map(k => 1 + degree * (white[k] / response[k] - 1));
  return product(inverse(BRADFORD), scaled(BRADFORD, gains));
}

function mapGamut(rgb) {
  const grey = dot(rgb, LUMA), lowest = Math.min(...rgb);
  if (!(grey > 0)) return [0, 0, 0];
  const share = lowest < 0 ? -lowest / (grey - lowest) : 0;
  return rgb.map(value => Math.max(value + share * (grey - value), 0));
}

const fromLab = lab => times(FROM_LMS, times(FROM_OKLAB, lab).map(x => x * x * x));
const toLab = rgb => times(OKLAB, times(LMS, rgb).map(Math.cbrt));

/** Display-encoded colour in [0, 1] of exposed linear RGB. */
function develop(rgb) {
  let peak = Math.max(...rgb);
  if (!(peak > 0)) return [0, 0, 0];
  const saturation = 1 - Math.min(...rgb) / peak, factor = 1 + (STRENGTH - 1) * (1 - saturation ** 4);
  const lab = toLab(rgb);
  const strong = mapGamut(fromLab([lab[0], lab[1] * factor, lab[2] * factor]));
  peak = Math.max(...strong);
  if (!(peak > 0)) return [0, 0, 0];
  let ratios = strong.map(value => value / peak);
  if (peak > 1) {
    const fade = Math.min(Math.log2(peak) / 6, 1), share = fade * fade * (3 - 2 * fade), from = toLab(ratios);
    const inside = mapGamut(fromLab(from.map((value, k) => value + share * (WHITE_LAB[k] - value))));
    ratios = inside.map(value => value / Math.max(...inside));
  }
  const v = Math.min(peak, 8), curve = Math.min((v * (2.51 * v + 0.03)) / (v * (2.43 * v + 0.59) + 0.14), 1);
  return ratios.map(ratio => {
    const value = curve * ratio;
    return value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
  });
}

/** Threshold between two steps of 8 bits (skyscatter/image/png.py). */
function dither(x, y, channel) {
  const moved = 5.588238 * channel;
  const inner = (0.06711056 * (x + moved) + 0.00583715 * (y + moved)) % 1;
  return 0.002 + 0.996 * ((52.9829189 * inner) % 1);
}

// --- the Sun's disk and the glare of bright lights ------------------------------------------------------------------

/** Light that the disk adds to the pixels that it touches: a rectangle {x, y, width, height, xyz}; null if unseen. */
function diskPatch(table, view, sun, change) {
  const radius = table.header.sun_radius;
  if (!(radius > 0) || Math.asin(sun[2]) + radius < table.header.horizon) return null;
  const {right, up} = frame(Math.atan2(sun[0], sun[1]), Math.asin(clamp(sun[2], -1, 1)));
  const rim = Array.from({length: 48}, (_, k) => {
    const [c, s] = [Math.cos((k * Math.PI) / 24), Math.sin((k * Math.PI) / 24)];
    return view.pixel(sun.map((v, i) => v * Math.cos(radius) + Math.sin(radius) * (c * right[i] + s * up[i])));
  });
  if (rim.some(p => p === null)) return null;
  const side = k => rim.map(p => p[k]);
  let [x0, x1] = [Math.floor(Math.min(...side(0))), Math.ceil(Math.max(...side(0)))];
  let [y0, y1] = [Math.floor(Math.min(...side(1))), Math.ceil(Math.max(...side(1)))];
  const small = Math.max(2 * Math.min(x1 - x0, y1 - y0), 1);
  if (view.number === 0 && x1 - x0 > view.width / 2) [x0, x1] = [0, view.width - 1];  // it crosses the seam
  if (view.number === 0 && Math.PI / 2 - Math.asin(sun[2]) < radius) [x0, x1, y0] = [0, view.width - 1, 0];
  [x0, x1] = [Math.max(x0, 0), Math.min(x1, view.width - 1)];
  [y0, y1] = [Math.max(y0, 0), Math.min(y1, view.height - 1)];
  if (x0 > x1 || y0 > y1) return null;
  const [width, height] = [x1 - x0 + 1, y1 - y0 + 1], xyz = new Float32Array(width * height * 4);
  const sine = Math.sin(radius) ** 2;
  const lightAt = (x, y) => {
    const d = view.through(x, y);
    if (d === null || dot(d, sun) <= 0) return null;
    const c = cross(d, sun);
    return table.disk(dot(c, c) / sine, Math.asin(clamp(d[2], -1, 1)), change);
  };
  const corners = Array.from({length: (width + 1) * (height + 1)}, (_, k) =>
    lightAt(x0 - 0.5 + (k % (width + 1)), y0 - 0.5 + Math.floor(k / (width + 1))) !== null);
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++) {
      const first = row * (width + 1) + column, at = (row * width + column) * 4;
      const seen = [0, 1, width + 1, width + 2].reduce((sum, step) => sum + corners[first + step], 0);
      // An edge through a pixel asks for many points in it, and a small disk for many in all.
      const fine = small < 32 ? clamp(Math.ceil(80 / small), 4, 40) : seen % 4 ? 8 : 1;
      if (small >= 32 && seen === 0) continue;
      for (let k = 0; k < fine * fine; k++) {
        const light = lightAt(
          x0 + column + ((k % fine) + 0.5) / fine - 0.5, y0 + row + (Math.floor(k / fine) + 0.5) / fine - 0.5,
        );
        if (light) for (let c = 0; c < 3; c++) xyz[at + c] += light[c] / (fine * fine);
      }
    }
  }
  return {x: x0, y: y0, width, height, xyz};
}

/** What a patch adds to a pixel; nothing outside of it. */
function onPatch(patch, x, y) {
  const i = y - (patch?.y ?? 0), j = x - (patch?.x ?? 0);
  if (!patch || i < 0 || j < 0 || i >= patch.height || j >= patch.width) return null;
  return patch.xyz.subarray((i * patch.width + j) * 4, (i * patch.width + j) * 4 + 3);
}

/** Bright points gathered to a few: {x, y, square (of the radius that they fill, pixel²), light}. */
function gathered(points, most) {
  if (!points.length) return [];
  const ends = key => [Math.min(...points.map(p => p[key])), Math.max(...points.map(p => p[key])) + 1e-6];
  const [x0, x1] = ends("x"), [y0, y1] = ends("y"), groups = new Map();
  const size = Math.max((x1 - x0) / most, (y1 - y0) / most, 1);
  for (const {x, y, area, light} of points) {
    const key = Math.floor((x - x0) / size) * 64 + Math.floor((y - y0) / size);
    const group = groups.get(key) || {x: 0, y: 0, weight: 0, area: 0, light: [0, 0, 0]};
    const weight = light[0] + light[1] + light[2];
    group.x += weight * x;
    group.y += weight * y;
    group.weight += weight;
    group.area += area;
    for (let c = 0; c < 3; c++) group.light[c] += light[c];
    groups.set(key, group);
  }
  return [...groups.values()].map(({x, y, weight, area, light}) => (
    {x: x / weight, y: y / weight, square: area > 9 ? 0.3 * area : 0, light}
  ));
}

/** The middle of bright points, the squared distance from which they are as one, and their light. */
function together(glares) {
  const weight = glares.map(({light}) => light[0] + light[1] + light[2]), whole = weight.reduce((a, b) => a + b, 0);
  const mean = of => glares.reduce((total, glare, k) => total + (weight[k] / whole) * of(glare), 0);
  if (!glares.length) return {middle: [0, 0, -1], sum: [0, 0, 0]};
  const [x, y] = [mean(g => g.x), mean(g => g.y)];
  const spread = mean(g => (g.x - x) ** 2 + (g.y - y) ** 2 + g.square);
  return {middle: [x, y, 225 * spread], sum: [0, 1, 2].map(c => glares.reduce((total, g) => total + g.light[c], 0))};
}

// --- WebGL2 ---------------------------------------------------------------------------------------------------------

const VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0), 0.0, 1.0); }`;

const MOST_GLARE = 58;  // of the disk seven by seven at most, of the sky three by three
const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
const float PI = 3.14159265358979;
uniform sampler2DArray light;   // blocks: XYZ over turn and row
uniform sampler2D phases;       // terms over the angle
uniform sampler2DArray near;    // what they lose, over angle and row
uniform sampler2D disk;
uniform ivec4 diskAt;           // x, y, width, height
uniform vec2 size;
uniform int kind, blocks, glares, nearAngles;
uniform vec3 forward, right, up, sun;
uniform vec4 plane;             // what a view is made of
uniform float sunAzimuth, horizon, nearest, deepest;
uniform mat3 expose, lms, oklab, fromOklab, fromLms;
uniform vec3 luma, whiteLab;
uniform float strength;
uniform vec4 glarePlace[${MOST_GLARE}];   // x, y, square of the radius
uniform vec3 glareLight[${MOST_GLARE}];
uniform vec3 glareMiddle, glareSum;       // x, y, squared distance from which they are as one
out vec4 shown;

vec3 gamut(vec3 rgb) {
  float grey = dot(rgb, luma), lowest = min(rgb.r, min(rgb.g, rgb.b));
  if (!(grey > 0.0)) return vec3(0.0);
  float share = lowest < 0.0 ? -lowest / (grey - lowest) : 0.0;
  return max(rgb + share * (grey - rgb), 0.0);
}

float largest(vec3 v) { return max(v.r, max(v.g, v.b)); }
vec3 toLab(vec3 rgb) { return oklab * pow(max(lms * rgb, 0.0), vec3(1.0 / 3.0)); }
vec3 fromLab(vec3 lab) { vec3 c = fromOklab * lab; return fromLms * (c * c * c); }

vec3 develop(vec3 rgb) {
  float peak = largest(rgb);
  if (!(peak > 0.0)) return vec3(0.0);
  // Oklab is homogeneous: brightness goes out of it, which keeps single precision.
  vec3 unit = rgb / peak;
  float low = min(unit.r, min(unit.g, unit.b)), saturation = 1.0 - low;
  float square = saturation * saturation, factor = 1.0 + (strength - 1.0) * (1.0 - square * square);
  vec3 lab = toLab(unit);
  vec3 strong = gamut(fromLab(vec3(lab.x, lab.yz * factor)));
  float own = largest(strong);
  vec3 ratios = strong / own;
  peak *= own;
  if (peak > 1.0) {
    float fade = min(log2(peak) / 6.0, 1.0);
    vec3 from = toLab(ratios);
    vec3 inside = gamut(fromLab(from + fade * fade * (3.0 - 2.0 * fade) * (whiteLab - from)));
    ratios = inside / largest(inside);
  }
  float v = min(peak, 8.0);
  vec3 linear = ratios * min(v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14), 1.0);
  vec3 high = 1.055 * pow(max(linear, 0.0031308), vec3(1.0 / 2.4)) - 0.055;
  return mix(high, 12.92 * linear, vec3(lessThanEqual(linear, vec3(0.0031308))));
}

vec4 through(vec2 at) {  // direction, and whether there is one
  vec2 p = vec2(at.x - 0.5 * (size.x - 1.0), 0.5 * (size.y - 1.0) - at.y);
  if (kind == 0) {
    float e = clamp(plane.z + plane.w * p.y / size.y, -0.5 * PI, 0.5 * PI), a = plane.x + plane.y * p.x / size.x;
    return vec4(cos(e) * sin(a), cos(e) * cos(a), sin(e), 1.0);
  }
  if (kind == 1) {
    float length_ = length(p);
    if (length_ > plane.x) return vec4(0.0);
    float angle = min(length_ / plane.x * plane.y, PI);
    vec2 along = p * sin(angle) / max(length_, 1e-9);
    return vec4(cos(angle) * forward + along.x * right + along.y * up, 1.0);
  }
  return vec4(normalize(plane.x * forward + p.x * right + p.y * up), 1.0);
}

vec3 mixed(int block, ivec2 p, vec2 w) {
  vec3 a = mix(texelFetch(light, ivec3(p, block), 0).rgb, texelFetch(light, ivec3(p + ivec2(1, 0), block), 0).rgb, w.x);
  vec3 b = mix(texelFetch(light, ivec3(p + ivec2(0, 1), block), 0).rgb,
    texelFetch(light, ivec3(p + ivec2(1, 1), block), 0).rgb, w.x);
  return mix(a, b, w.y);
}

float nearMixed(int term, ivec2 p, vec2 w) {
  float a = mix(texelFetch(near, ivec3(p, term), 0).r, texelFetch(near, ivec3(p + ivec2(1, 0), term), 0).r, w.x);
  float b = mix(texelFetch(near, ivec3(p + ivec2(0, 1), term), 0).r,
    texelFetch(near, ivec3(p + ivec2(1, 1), term), 0).r, w.x);
  return mix(a, b, w.y);
}

vec3 sky(vec3 d) {
  float elevation = atan(d.z, length(d.xy)), turn = atan(d.x, d.y) - sunAzimuth;
  turn = abs(turn - 2.0 * PI * round(turn / (2.0 * PI)));
  float x = clamp(sqrt(turn / PI) * ${GRID.turns - 1}.0, 0.0, ${GRID.turns - 1}.0), y;
  bool down = elevation < horizon;
  if (down) {
    y = ${GRID.below - 1}.0 * (1.0 - clamp(asinh((horizon - elevation) / nearest) / deepest, 0.0, 1.0));
  } else {
    float share = max((elevation - horizon) / (0.5 * PI - horizon), 0.0);
    y = ${GRID.below}.0 + ${GRID.above - 1}.0 * sqrt(share);
  }
  ivec2 p = ivec2(min(int(x), ${GRID.turns - 2}), min(int(y), down ? ${GRID.below - 2} : ${GRID.below + GRID.above - 2}));
  vec2 w = vec2(x - float(p.x), clamp(y - float(p.y), 0.0, 1.0));
  // Half the angle from the Sun by the chord: cosines near one have few digits.
  float last = float(textureSize(phases, 0).x - 1), half_ = 0.5 * distance(d, sun), place = half_ * last;
  int cell = min(int(place), int(last) - 1);
  float share = clamp((place * place - float(cell * cell)) / float(2 * cell + 1), 0.0, 1.0);
  vec3 sum = mixed(blocks - 1, p, w);
  for (int term = 0; term < blocks - 1; term++) {
    float phase = mix(texelFetch(phases, ivec2(cell, term), 0).r, texelFetch(phases, ivec2(cell + 1, term), 0).r, share);
    if (cell + 1 < nearAngles) phase -= nearMixed(term, ivec2(cell, p.y), vec2(share, w.y));
    sum += phase * mixed(term, p, w);
  }
  return sum;
}

vec3 veil(vec2 away, float core, float square, vec3 light_) {
  float fall = core * core + square + dot(away, away);
  return light_ * (${SHARE} / (2.0 * PI) * core * inversesqrt(fall * fall * fall));
}

void main() {
  vec2 at = vec2(floor(gl_FragCoord.x), size.y - 1.0 - floor(gl_FragCoord.y));
  vec4 d = through(at);
  if (d.w == 0.0) { shown = vec4(0.0); return; }
  vec3 xyz = sky(d.xyz);
  ivec2 inside = ivec2(at) - diskAt.xy;
  if (all(greaterThanEqual(inside, ivec2(0))) && all(lessThan(inside, diskAt.zw))) {
    xyz += texelFetch(disk, inside, 0).rgb;
  }
  vec3 rgb = gamut(expose * xyz);
  float core = max(${CORE} * size.x, 1.0);
  // From afar all bright points are as one.
  vec2 off = at - glareMiddle.xy;
  if (dot(off, off) > glareMiddle.z) rgb += veil(off, core, 0.0, glareSum);
  else for (int k = 0; k < glares; k++) rgb += veil(at - glarePlace[k].xy, core, glarePlace[k].z, glareLight[k]);
  vec3 colour = develop(rgb);
  vec3 moved = 5.588238 * vec3(0.0, 1.0, 2.0);
  vec3 noise = fract(52.9829189 * fract(0.06711056 * (at.x + moved) + 0.00583715 * (at.y + moved)));
  shown = vec4(floor(colour * 255.0 + 0.002 + 0.996 * noise) / 255.0, 1.0);
}`;

class WebGl {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", {alpha: true, premultipliedAlpha: false, antialias: false,
      depth: false, preserveDrawingBuffer: true});
    if (!gl) throw new Error("no WebGL2");
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(this.program));
    gl.useProgram(this.program);
    gl.bindVertexArray(gl.createVertexArray());
    ["light", "phases", "near", "disk"].forEach((name, unit) => gl.uniform1i(this.#place(name), unit));
    this.textures = [0, 1, 2, 3].map(() => gl.createTexture());
  }

  #place(name) {
    return this.gl.getUniformLocation(this.program, name);
  }

  #bound(unit, target) {
    const {gl} = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, this.textures[unit]);
    for (const [name, value] of [
      [gl.TEXTURE_MIN_FILTER, gl.NEAREST], [gl.TEXTURE_MAG_FILTER, gl.NEAREST],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    ]) gl.texParameteri(target, name, value);
  }

  #flat(unit, width, height, values, rgba) {
    const {gl} = this;
    this.#bound(unit, gl.TEXTURE_2D);
    gl.texImage2D(gl.TEXTURE_2D, 0, rgba ? gl.RGBA32F : gl.R32F, width, height, 0, rgba ? gl.RGBA : gl.RED, gl.FLOAT, values);
  }

  #layers(unit, width, height, depth, values, rgba) {
    const {gl} = this;
    this.#bound(unit, gl.TEXTURE_2D_ARRAY);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, rgba ? gl.RGBA32F : gl.R32F, width, height, depth, 0,
      rgba ? gl.RGBA : gl.RED, gl.FLOAT, values);
  }

  /** What belongs to a table. */
  table(table, grid) {
    const terms = table.blocks - 1;
    this.nearAngles = table.shape.near[2];
    this.#flat(1, table.shape.phase[1], terms, table.phase, false);
    if (this.nearAngles) this.#layers(2, this.nearAngles, grid.rows, terms, grid.lost, false);
    else this.#layers(2, 1, 1, 1, new Float32Array(1), false);
  }

  /** What belongs to a Sun. */
  grid(grid) {
    this.#layers(0, GRID.turns, grid.rows, grid.table.blocks, grid.values, true);
  }

  draw({view, grid, sun, sunAzimuth, patch, glares, expose}) {
    const {gl} = this, set = (kind, name, ...values) => gl[`uniform${kind}`](this.#place(name), ...values);
    gl.viewport(0, 0, view.width, view.height);
    const {x = 0, y = 0, width = 0, height = 0} = patch || {};
    this.#flat(3, width || 1, height || 1, patch ? patch.xyz : new Float32Array(4), true);
    set("4i", "diskAt", x, y, width, height);
    set("2f", "size", view.width, view.height);
    set("1i", "kind", view.number);
    set("1i", "blocks", grid.table.blocks);
    set("1i", "nearAngles", this.nearAngles);
    for (const name of ["forward", "right", "up"]) set("3fv", name, view[name] || [0, 0, 0]);
    set("3fv", "sun", sun);
    set("4fv", "plane", [
      [view.azimuth, view.fov, (view.low + view.high) / 2, view.high - view.low],
      [view.radius, view.half, 0, 0], [view.focal, 0, 0, 0],
    ][view.number]);
    set("1f", "sunAzimuth", sunAzimuth);
    // A row of a panorama may lie on the horizon: all of it is ground then.
    set("1f", "horizon", grid.horizon + (view.number === 0 ? TIE : 0));
    set("1f", "nearest", grid.near);
    set("1f", "deepest", grid.deepest);
    set("Matrix3fv", "expose", false, columns(expose));
    for (const [name, matrix] of Object.entries({lms: LMS, oklab: OKLAB, fromOklab: FROM_OKLAB, fromLms: FROM_LMS})) {
      set("Matrix3fv", name, false, columns(matrix));
    }
    set("3fv", "luma", LUMA);
    set("3fv", "whiteLab", WHITE_LAB);
    set("1f", "strength", STRENGTH);
    set("1i", "glares", glares.length);
    if (glares.length) {
      set("4fv", "glarePlace", glares.flatMap(g => [g.x, g.y, g.square, 0]));
      set("3fv", "glareLight", glares.flatMap(g => g.light));
    }
    const {middle, sum} = together(glares);
    set("3fv", "glareMiddle", middle);
    set("3fv", "glareSum", sum);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

// --- JavaScript alone -----------------------------------------------------------------------------------------------

class Plain {
  constructor(canvas) {
    this.context = canvas.getContext("2d");
    if (!this.context) throw new Error("this browser draws neither with WebGL2 nor on a canvas");
  }

  table() {}

  grid() {}

  draw({view, grid, sun, sunAzimuth, patch, glares, expose}) {
    const {width, height} = view, image = this.context.createImageData(width, height);
    const core = Math.max(CORE * width, 1);
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        const d = view.through(x, y), at = (y * width + x) * 4;
        if (d === null) continue;
        const xyz = alongRay(grid, d, sun, sunAzimuth), light = onPatch(patch, x, y);
        if (light) for (let c = 0; c < 3; c++) xyz[c] += light[c];
        const rgb = mapGamut(times(expose, xyz));
        for (const g of glares) {
          const fall = core * core + g.square + (x - g.x) ** 2 + (y - g.y) ** 2;
          const share = ((SHARE / (2 * Math.PI)) * core) / (fall * Math.sqrt(fall));
          for (let c = 0; c < 3; c++) rgb[c] += share * g.light[c];
        }
        const colour = develop(rgb);
        for (let c = 0; c < 3; c++) image.data[at + c] = Math.floor(colour[c] * 255 + dither(x, y, c));
        image.data[at + 3] = 255;
      }
    }
    this.context.putImageData(image, 0, 0);
  }
}

/** Elevation and azimuth from the Sun of a direction [rad]. */
function seen(d, sunAzimuth) {
  const turn = Math.atan2(d[0], d[1]) - sunAzimuth;
  return [Math.atan2(d[2], Math.hypot(d[0], d[1])), Math.abs(turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI)))];
}

function alongRay(grid, d, sun, sunAzimuth) {
  return grid.light(...seen(d, sunAzimuth), clamp(dot(d, sun), -1, 1));
}

// --- the picture ----------------------------------------------------------------------------------------------------

// Pixels from which exposure and glare are found, about: some of every row, for edges of skies are level.
const SAMPLES = 16000, GOLDEN = 0.6180339887498949;

function* sampled({width, height}) {
  const count = clamp(Math.round(SAMPLES / height), 1, width);
  for (let y = 0; y < height; y++) {
    for (let k = 0; k < count; k++) yield [Math.floor(((k + ((y * GOLDEN) % 1)) / count) * width), y];
  }
}

/** A sky on a canvas. */
export class SkyPicture {
  /** `backend` "javascript" does without WebGL2. */
  constructor(canvas, {backend = "webgl2"} = {}) {
    this.canvas = canvas;
    this.state = {
      sunElevation: 30, sunAzimuth: 180, view: {kind: "landscape"}, exposure: "auto", tone: "photograph", change: {},
    };
    this.exposure = null;
    this.backend = backend;
    if (backend === "webgl2") {
      try {
        this.drawer = new WebGl(canvas);
        return;
      } catch (error) {
        if (canvas.getContext("2d") === null) throw new Error(`the sky cannot be drawn: ${error.message}`);
        this.backend = "javascript";
      }
    }
    this.drawer = new Plain(canvas);
  }

  /** A table as `SkyTableFile.to_bytes` has it, in an ArrayBuffer. */
  setTable(buffer) {
    const before = this.table;
    this.table = new SkyTable(buffer);
    if (before) this.table.borrow(before);
    this.#moved(true);
  }

  /** Change some of: sunElevation, sunAzimuth, view, exposure, tone, change. */
  set(values) {
    if ((values.tone ?? "photograph") !== "photograph") throw new Error(`tone ${values.tone}: photograph is the one here`);
    const before = JSON.stringify([this.state.sunElevation, this.state.change]);
    Object.assign(this.state, values);
    if (this.table && JSON.stringify([this.state.sunElevation, this.state.change]) !== before) this.#moved(false);
  }

  #moved(anew) {
    const {sunElevation, change} = this.state;
    this.grid = new Grid(this.table, sunElevation, change, this.grid);
    this.exact = null;
    if (anew) this.drawer.table(this.table, this.grid);
    this.drawer.grid(this.grid);
  }

  get #view() {
    const {width, height} = this.canvas;
    return new View(this.state.view, this.state.sunAzimuth, this.table.header.horizon, width, height);
  }

  get #sun() {
    return direction(this.state.sunAzimuth * RAD, this.state.sunElevation * RAD);
  }

  /** One frame. */
  draw() {
    if (!this.table) throw new Error("there is no table to draw; call setTable first");
    const view = this.#view, sun = this.#sun, sunAzimuth = this.state.sunAzimuth * RAD, {grid} = this;
    const patch = diskPatch(this.table, view, sun, this.state.change);
    const samples = [];
    for (const [x, y] of sampled(view)) {
      const d = view.through(x, y);
      if (!d) continue;
      const xyz = alongRay(grid, d, sun, sunAzimuth), light = onPatch(patch, x, y);
      samples.push({x, y, xyz, whole: light ? xyz.map((value, c) => value + light[c]) : xyz});
    }
    const {exposure} = this.state;
    this.exposure = exposure === "auto" ? autoExposure(Float64Array.from(samples, s => s.whole[1])) : exposure;
    const night = balance(samples.map(s => s.whole), this.exposure);
    const factor = GREY / (METER * 2 ** this.exposure), matrix = night ? product(TO_RGB, night) : TO_RGB;
    const expose = matrix.map(row => row.map(value => value * factor));
    const glares = this.#glares(view, samples, patch, expose);
    this.drawer.draw({view, grid, sun, sunAzimuth, patch, glares, expose});
  }

  /** Lights beyond white, gathered to a few points. */
  #glares(view, samples, patch, expose) {
    const spilt = (xyz, area) => {
      const rgb = mapGamut(times(expose, xyz)), peak = Math.max(...rgb);
      return peak > BRIGHT ? rgb.map(value => value * area * (1 - BRIGHT / peak)) : null;
    };
    const around = [], disk = [], area = view.width / clamp(Math.round(SAMPLES / view.height), 1, view.width);
    for (const {x, y, xyz} of samples) {
      const light = spilt(xyz, area);
      if (light) around.push({x, y, area, light});
    }
    for (let k = 0; patch && k < patch.width * patch.height; k++) {
      const light = spilt(patch.xyz.subarray(4 * k, 4 * k + 3), 1);
      if (light) disk.push({x: patch.x + (k % patch.width), y: patch.y + Math.floor(k / patch.width), area: 1, light});
    }
    return [...gathered(disk, disk.length < 300 ? 3 : 7), ...gathered(around, 3)];
  }

  /** Where a pixel of the canvas looks, in degrees; null where it sees nothing. */
  direction(x, y) {
    const d = this.#view.through(x, y);
    if (d === null) return null;
    const azimuth = Math.atan2(d[0], d[1]) / RAD;
    return {elevation: Math.atan2(d[2], Math.hypot(d[0], d[1])) / RAD, azimuth: (azimuth + 360) % 360};
  }

  /** XYZ [cd m-2] along the middle of a pixel, by the table's own cubics; null where it sees nothing. */
  xyz(x, y) {
    const d = this.#view.through(x, y), sun = this.#sun;
    if (d === null) return null;
    const {sunElevation, change} = this.state, cosine = clamp(dot(d, sun), -1, 1);
    this.exact ??= this.table.under(sunElevation, change);
    const [elevation, turn] = seen(d, this.state.sunAzimuth * RAD), c = cross(d, sun);
    const found = this.table.colour(this.exact, elevation, turn, cosine);
    const square = cosine > 0 ? dot(c, c) / Math.sin(this.table.header.sun_radius) ** 2 : Infinity;
    const light = this.table.header.sun_radius > 0 ? this.table.disk(square, elevation, change) : null;
    return light ? found.map((value, k) => value + light[k]) : found;
  }
}
