// The picture of one axis: the drawing of its hydraulics, or a table of its quantities.

import { Binding } from "./bound.js";
import { drawAxis } from "./circuit.js";
import { el, setText, svg } from "./dom.js";
import { shown, valueText, valueWithUnit } from "./units.js";

export class AxisPicture {
  // `choose(id, title)` is called when a part is chosen; without it no part can be.
  constructor(model, choose = null) {
    this.model = model;
    this.choose = choose;
    this.parts = [];
    this.acts = [];
    this.drawing = el("div", { class: "drawing" });
    this.legend = el("p", { class: "pressure-legend quiet", hidden: true });
    this.root = el("div", { class: "machine-picture" }, this.drawing, this.legend);
  }

  say(text) {
    this.axis = null;
    [this.parts, this.acts] = [[], []];
    this.drawing.replaceChildren(text);
    this.legend.hidden = true;
  }

  show(axis) {
    this.axis = axis;
    this.acts = [];
    const found = drawAxis(axis.name, { svg: axis.machine.svg, circuit: axis.circuit, valve: axis.valve, supply: axis.supply });
    this.parts = found.parts ?? [];
    const table = !axis.machine.svg || found.problem ? [this.table()] : [];
    const note = found.problem ? [el("p", { class: "problem" }, found.problem)] : [];
    const picture = this.parts.length ? [this.image(found)] : [];
    this.drawing.replaceChildren(...note, ...table, ...picture);
    this.legend.hidden = !axis.circuit;
    if (!axis.circuit) return;
    const end = valueWithUnit(axis.circuit.pressure, "Pa");
    this.legend.replaceChildren("0", el("span", { class: "scale-bar" }), end, el("span", { class: "words" }, "dashes move with the flow"));
  }

  light(id) {
    for (const part of this.parts) part.outline.setAttribute("aria-pressed", String(part.id === id));
  }

  draw() {
    for (const act of this.acts) act();
  }

  image({ box, content }) {
    const { axis, model } = this;
    const image = svg("svg", { viewBox: box.map((each) => each.toFixed(1)).join(" "), role: "group", "aria-label": `drawing of ${axis.name}` }, ...content);
    const binding = new Binding(image, model, axis.name);
    this.acts.push(() => binding.draw());
    const state = image.querySelector(".valve-state");
    if (state) {
      this.acts.push(() => {
        const node = model.state.nodes[axis.valve];
        if (node) setText(state, node.device ?? node.state);
      });
    }
    for (const part of this.parts) this.offer(part);
    return image;
  }

  offer({ id, title, element, outline }) {
    if (!this.choose) {
      for (const name of ["role", "tabindex", "aria-pressed", "aria-label"]) outline.removeAttribute(name);
      return;
    }
    element.addEventListener("click", () => this.choose(id, title));
    element.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      event.stopPropagation();
      this.choose(id, title);
    });
  }

  table() {
    const { model, axis } = this;
    const head = ["quantity", "value", "unit"].map((text) => el("th", { scope: "col" }, text));
    const rows = axis.quantities.map((name) => {
      const cell = el("td", { class: "figure" });
      const unit = model.unit(name);
      this.acts.push(() => setText(cell, valueText(model.store.latest(name), unit)));
      return el("tr", {}, el("th", { scope: "row" }, name), cell, el("td", {}, shown(unit).symbol));
    });
    return el("table", { "aria-label": `quantities of ${axis.name}` }, el("thead", {}, el("tr", {}, ...head)), el("tbody", {}, ...rows));
  }
}
