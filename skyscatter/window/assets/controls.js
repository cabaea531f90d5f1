// The fields of the page: for each number a slider and a field beside it, made from their description.
import { NUMBERS, VIEWS, numberOf } from "./state.js";

let made = 0;

function element(kind, attributes = {}, ...children) {
  const node = document.createElement(kind);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

/** The fields of one window. */
export class Controls {
  /** `changed(name, value)` is called for whatever the user sets. */
  constructor(root, changed) {
    this.root = root;
    this.changed = changed;
    this.rows = {};
    this.field("place", "date", "Date", { type: "date", min: "1900-01-01", max: "2100-12-31" });
    this.views();
    this.box("air", "ownGround", "The model's own ground");
    this.box("exposure", "autoExposure", "Automatic exposure");
    for (const [name, spec] of Object.entries(NUMBERS)) this.number(name, spec);
    this.model = root.querySelector("[data-name=model]");
    this.model.addEventListener("change", () => changed("model", this.model.value));
  }

  group(name) { return this.root.querySelector(`[data-group=${name}]`); }

  number(name, spec) {
    const id = `window-${++made}`, title = spec.unit && spec.unit !== "×" ? `${spec.label}, ${spec.unit}` : spec.label;
    const label = element("label", { for: id }, title);
    const slider = element("input", { type: "range", id, min: spec.low, max: spec.high, step: spec.step, "data-name": name });
    const field = element("input", {
      type: "number", min: spec.least ?? spec.low, max: spec.most ?? spec.high, step: "any", "aria-label": `${title}, as a number`,
    });
    slider.addEventListener("input", () => { field.value = slider.value; this.changed(name, Number(slider.value)); });
    field.addEventListener("change", () => {
      const value = numberOf(name, field.value);
      if (Number.isNaN(value)) { field.value = slider.value; return; }
      slider.value = value;
      field.value = value;
      this.changed(name, value);
    });
    const row = element("p", { class: "row" }, label, slider, field);
    this.group(spec.group).append(row);
    this.rows[name] = { row, show: value => { slider.value = value; field.value = String(+Number(value).toPrecision(6)); }, slider, field };
  }

  box(group, name, text) {
    const box = element("input", { type: "checkbox", "data-name": name });
    box.addEventListener("change", () => this.changed(name, box.checked));
    const row = element("p", { class: "check" }, element("label", {}, box, ` ${text}`));
    this.group(group).append(row);
    this.rows[name] = { row, show: value => { box.checked = value; } };
  }

  field(group, name, text, attributes) {
    const id = `window-${++made}`, input = element("input", { id, "data-name": name, ...attributes });
    input.addEventListener("change", () => { if (input.value) this.changed(name, input.value); });
    const row = element("p", { class: "row" }, element("label", { for: id }, text), input);
    this.group(group).append(row);
    this.rows[name] = { row, show: value => { input.value = value; } };
  }

  views() {
    const choices = element("p", { class: "choices" }), buttons = {}, name = `window-view-${++made}`;
    for (const [view, text] of Object.entries(VIEWS)) {
      buttons[view] = element("input", { type: "radio", name, value: view, "data-name": "view" });
      buttons[view].addEventListener("change", () => this.changed("view", view));
      choices.append(element("label", {}, buttons[view], element("span", {}, text)));
    }
    this.group("view").append(choices);
    this.rows.view = { row: choices, show: value => { buttons[value].checked = true; } };
  }

  /** The models that can be chosen, and which of them is. */
  models(list, chosen) {
    const of = kind => list.filter(model => model.kind === kind)
      .map(model => element("option", { value: model.name }, model.title));
    const groups = [["Skies", "sky"], ["Nebulae", "nebula"]].filter(([, kind]) => list.some(model => model.kind === kind));
    this.model.replaceChildren(...groups.map(([label, kind]) => element("optgroup", { label }, ...of(kind))));
    this.model.value = chosen;
  }

  /** Show the values of a state. */
  show(state) {
    for (const [name, row] of Object.entries(this.rows)) row.show(state[name]);
    this.model.value = state.model;
  }

  /** Hide a row, or show it again. */
  offer(name, offered) { this.rows[name].row.hidden = !offered; }
}
