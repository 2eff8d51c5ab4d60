// All axes small, in groups of those that share a supply: a card each, with its picture and its first
// quantity; the chosen one is shown large.

import { el, setText, svg } from "./dom.js";
import { Binding, fluid, readPicture } from "./bound.js";
import { valueWithUnit } from "./units.js";

export class Overview {
  constructor(model, choose) {
    this.model = model;
    this.choose = choose;
    this.root = el("div", { class: "overview", role: "group", "aria-label": "axes", hidden: true });
  }

  begin(axes) {
    this.cards = axes.map((axis) => new Card(axis, this.model, () => this.choose(axis.name)));
    this.rails = [];
    this.root.hidden = axes.length < 2;
    const supplies = [...new Set(axes.map((axis) => axis.supply))];
    this.root.replaceChildren(...supplies.map((supply) => this.group(supply, this.cards.filter((card) => card.axis.supply === supply))));
  }

  group(supply, cards) {
    const head = supply ? [this.rail(supply, cards[0].axis)] : [];
    return el("div", { class: supply ? "axis-group shared" : "axis-group" }, ...head, el("div", { class: "axis-cards" }, ...cards.map((card) => card.root)));
  }

  // Return the line of a shared supply above its axes, in the colour of its pressure.
  rail(supply, axis) {
    const text = el("span", { class: "figure" });
    const bar = el("span", { class: "rail-bar" });
    this.rails.push({ axis, supply, text, bar });
    return el("div", { class: "rail" }, bar, text);
  }

  light(name) {
    for (const { axis, root } of this.cards) root.setAttribute("aria-pressed", String(axis.name === name));
  }

  draw() {
    if (this.root.hidden) return;
    for (const card of this.cards) card.draw();
    for (const { axis, supply, text, bar } of this.rails) {
      const pressure = this.model.store.latest(`${axis.name}.P_S`);
      const oil = this.model.store.latest(`${axis.name}.T_oil`);
      const warm = Number.isFinite(oil) ? `, oil ${oil.toFixed(1)} °C` : "";
      setText(text, `${supply}: ${valueWithUnit(pressure, "Pa")}${warm}`);
      bar.style.background = fluid(pressure / (axis.circuit?.pressure ?? 1));
    }
  }
}

class Card {
  constructor(axis, model, choose) {
    this.axis = axis;
    this.model = model;
    this.value = el("span", { class: "figure" });
    const picture = axis.machine.svg ? readPicture(axis.machine.svg) : null;
    const isDrawn = picture && typeof picture !== "string";
    this.binding = isDrawn ? new Binding(picture.root, model, axis.name) : null;
    const image = isDrawn ? [svg("svg", { viewBox: picture.box.join(" "), class: "mini", "aria-hidden": "true" }, picture.root)] : [];
    this.root = el("button", { type: "button", class: "axis-card", "aria-pressed": "false", onclick: choose },
      ...image, el("span", { class: "axis-name" }, axis.name), this.value);
  }

  draw() {
    this.binding?.draw();
    const name = this.axis.headline;
    const unit = name ? this.model.unit(name) : "";
    setText(this.value, name ? valueWithUnit(this.model.store.latest(name), unit) : "");
    this.root.classList.toggle("faulty", this.axis.hasFault);
  }
}
