// A small plot of a spectrum with its error, as SVG.

const NS = "http://www.w3.org/2000/svg", WIDTH = 300, HEIGHT = 146, LEFT = 44, BOTTOM = 34, TOP = 8, RIGHT = 8;

function shape(kind, attributes, text) {
  const node = document.createElementNS(NS, kind);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

/** Round steps that divide a range into two to five parts. */
export function steps(most) {
  const size = 10 ** Math.floor(Math.log10(most / 2)), step = [5, 2, 1].map(f => f * size).find(s => most / s >= 2) ?? size;
  return Array.from({ length: Math.floor(most / step + 1e-9) + 1 }, (_, k) => k * step);
}

/** The plot of {wavelengths [nm], radiance, error [W m-2 sr-1 nm-1]}. */
export function plot(spectrum) {
  const { wavelengths, radiance, error, kind } = spectrum, last = wavelengths.length - 1;
  const most = Math.max(...radiance.map((value, k) => value + error[k])) || 1;
  const x = nm => LEFT + (nm - wavelengths[0]) / (wavelengths[last] - wavelengths[0]) * (WIDTH - LEFT - RIGHT);
  const y = value => HEIGHT - BOTTOM - Math.max(value, 0) / (1.05 * most) * (HEIGHT - BOTTOM - TOP);
  const point = (k, value) => `${x(wavelengths[k]).toFixed(1)},${y(value).toFixed(1)}`;
  const indices = wavelengths.map((_, k) => k);
  const worst = Math.max(...radiance.map((value, k) => value > 0 ? error[k] / value : 0));
  const said = `Spectral radiance from ${wavelengths[0]} to ${wavelengths[last]} nm, at most ${most.toPrecision(3)} W m-2 sr-1 nm-1, ${kind} at most ${(100 * worst).toPrecision(2)} %`;
  const svg = shape("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": said });
  const axes = shape("g", { class: "axes" });
  const power = Math.floor(Math.log10(most)), scale = 10 ** power;
  for (const value of steps(most)) {
    axes.append(shape("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y(value), y2: y(value) }));
    axes.append(shape("text", { x: LEFT - 5, y: y(value) + 3, "text-anchor": "end" }, String(+(value / scale).toPrecision(2))));
  }
  for (const nm of [400, 500, 600, 700]) axes.append(shape("text", { x: x(nm), y: HEIGHT - BOTTOM + 14, "text-anchor": "middle" }, nm));
  axes.append(shape("text", { x: WIDTH - RIGHT, y: HEIGHT - 2, "text-anchor": "end" }, "wavelength, nm"));
  const band = [...indices.map(k => point(k, radiance[k] + error[k])), ...indices.reverse().map(k => point(k, radiance[k] - error[k]))];
  svg.append(axes, shape("polygon", { class: "error", points: band.join(" ") }));
  svg.append(shape("polyline", { class: "line", points: wavelengths.map((_, k) => point(k, radiance[k])).join(" ") }));
  return { svg, caption: `10${superscript(power)} W m⁻² sr⁻¹ nm⁻¹; band: ${kind}, at most ${(100 * worst).toPrecision(2)} %` };
}

/** A whole number as an exponent. */
export function superscript(number) {
  return String(number).replace(/./g, c => c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]);
}
