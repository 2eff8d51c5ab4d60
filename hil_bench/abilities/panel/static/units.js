// In which units values are shown: the table comes from the bench's program, the choice is kept here.

import { button, el, labelled, select, setText } from "./dom.js";

const KEPT = "hil-bench units";
const OTHER = { factor: 1, digits: 3, least: 1e-3 };
const UNKNOWN = "no value";
const NOTHING = { quantities: {}, sets: {}, chosen: {}, units: {} };

let table = NOTHING;
let chosen = {};

// Take the table of a greeting; what was chosen on this page before stays chosen.
export function takeUnits(content) {
  table = content ?? NOTHING;
  chosen = { ...table.chosen };
  for (const [quantity, word] of Object.entries(kept())) {
    if (table.quantities[quantity]?.includes(word)) chosen[quantity] = word;
  }
}

// Return how a quantity of an SI unit is shown: symbol, factor, digits, least span of a plot.
export function shown(unit) {
  const entry = table.units[unit];
  return entry?.shown[entry.quantity && chosen[entry.quantity]] ?? { symbol: unit, ...OTHER };
}

export function valueText(value, unit) {
  if (value == null || !Number.isFinite(value)) return UNKNOWN;
  const { factor, digits } = shown(unit);
  const text = (value / factor).toFixed(digits);
  return Number(text) === 0 ? (0).toFixed(digits) : text; // no -0.0
}

export function valueWithUnit(value, unit) {
  const text = valueText(value, unit);
  return text === UNKNOWN ? text : `${text} ${shown(unit).symbol}`;
}

// Return the control of the choice; `changed` is called after each change.
export class UnitsControl {
  constructor(changed) {
    this.changed = changed;
    this.summary = el("summary", {});
    this.fields = el("div", { class: "stack" });
    this.root = el("details", { class: "units", hidden: true }, this.summary, this.fields);
    this.root.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.root.open = false;
    });
  }

  begin() {
    this.root.hidden = Object.keys(table.quantities).length === 0;
    const sets = Object.entries(table.sets).map(([name, choice]) => button(name, () => this.choose(choice)));
    this.selects = Object.entries(table.quantities).map(([quantity, words]) =>
      select(words, { "aria-label": `unit of ${quantity}`, onchange: (event) => this.choose({ [quantity]: event.target.value }) }));
    const rows = Object.keys(table.quantities).map((quantity, i) => labelled(quantity, this.selects[i]));
    this.fields.replaceChildren(el("div", { class: "row" }, ...sets), ...rows);
    this.show();
  }

  show() {
    Object.keys(table.quantities).forEach((quantity, i) => {
      this.selects[i].value = chosen[quantity];
    });
    const { pressure, length, flow } = chosen;
    setText(this.summary, `Units: ${[pressure, length, flow].filter(Boolean).join(" · ")}`);
  }

  choose(choice) {
    chosen = { ...chosen, ...choice };
    try {
      localStorage.setItem(KEPT, JSON.stringify(chosen));
    } catch {
      // A browser that keeps nothing shows them all the same.
    }
    this.show();
    this.changed();
  }
}

function kept() {
  try {
    const content = JSON.parse(localStorage.getItem(KEPT) ?? "{}");
    return content && typeof content === "object" ? content : {};
  } catch {
    return {};
  }
}
