// The form that adds an item to a layout: its kind, and what it shows or does.

import { button, el, select, setText } from "./dom.js";
import { actionWords } from "./fault_form.js";

const SIZES = {
  plot: [6, 5], value: [3, 2], gauge: [3, 4], button: [3, 1], slider: [4, 2], text: [4, 1], bus: [12, 8], verdicts: [6, 4], machine: [6, 10],
};

export class AddForm {
  constructor(model, insert) {
    this.model = model;
    this.insert = insert;
    this.kind = select(Object.keys(SIZES), { "aria-label": "kind of item", onchange: () => this.offer() });
    this.what = el("select", { "aria-label": "what it shows" });
    this.text = el("input", { maxlength: 400, "aria-label": "text of the item", placeholder: "text" });
    this.said = el("span", { class: "problem" });
    this.root = el("div", { class: "row" }, this.kind, this.what, this.text, button("Add", () => this.add()), this.said);
  }

  begin() {
    this.offer();
  }

  offer() {
    const { hello } = this.model;
    const kind = this.kind.value;
    const channels = hello.channels.map(([name]) => name);
    const faults = Object.entries(hello.fault_kinds ?? {}).flatMap(([fault, targets]) => Object.keys(targets).map((target) => [`${fault} ${target}`, `${actionWords(fault)}: ${target}`]));
    const loads = Object.entries(hello.axes ?? {}).flatMap(([axis, all]) => all.map(({ name }) => [`${axis} ${name}`, `${axis}: ${name}`]));
    const offered = { plot: channels, value: channels, gauge: channels, button: faults, slider: loads, machine: Object.keys(hello.machines ?? {}) }[kind] ?? [];
    this.what.multiple = kind === "plot";
    this.what.size = kind === "plot" ? 4 : 0;
    this.what.hidden = !offered.length;
    this.text.hidden = kind !== "text" && kind !== "button";
    this.what.replaceChildren(...offered.map((each) => (Array.isArray(each) ? el("option", { value: each[0] }, each[1]) : el("option", { value: each }, each))));
    setText(this.said, "");
  }

  add() {
    const kind = this.kind.value;
    const [width, height] = SIZES[kind];
    const found = this.content(kind);
    if (!found) setText(this.said, "choose what it shows, and a text where it has one");
    else this.insert({ kind, width, height, ...found });
  }

  // Return the keys of an item of a kind; null where something is missing.
  content(kind) {
    const chosen = [...this.what.selectedOptions].map(({ value }) => value);
    const [one] = chosen;
    const text = this.text.value.trim();
    if (kind === "bus" || kind === "verdicts") return {};
    if (kind === "text") return text ? { text } : null;
    if (one === undefined) return null;
    if (kind === "plot") return { channels: chosen.slice(0, 16) };
    if (kind === "value") return { channel: one };
    if (kind === "machine") return { axis: one };
    if (kind === "gauge") return { channel: one, ...this.range(one) };
    const split = one.indexOf(" ");
    const [first, second] = [one.slice(0, split), one.slice(split + 1)];
    if (kind === "slider") return { axis: first, quantity: second, ...this.span(first, second) };
    return { text: text || `${actionWords(first)}: ${second}`, fault: first, target: second, keys: this.keys(first, second) };
  }

  // Return a round range about the present value of a channel.
  range(channel) {
    const present = Math.abs(this.model.store.latest(channel)) || 1;
    const most = 10 ** Math.ceil(Math.log10(2 * present));
    return { low_si: this.model.unit(channel) === "Pa" ? 0 : -most, high_si: most };
  }

  span(axis, quantity) {
    const { low, high } = this.model.hello.axes[axis].find(({ name }) => name === quantity);
    return { low_si: Math.max(low, -1e5), high_si: Math.min(high, quantity.includes("pressure") ? 4e7 : 1e5) };
  }

  // Return the amounts that a fault needs, as the Faults view offers them.
  keys(fault, target) {
    const keys = this.model.hello.fault_kinds[fault][target];
    const needed = keys.filter(({ name, choices, default: usual, is_needed: must }) => must || (!choices && usual === null && !["for_s", "can_id"].includes(name)));
    return Object.fromEntries(needed.map(({ name, default: usual }) => [name, Number(usual ?? 10)]));
  }
}
