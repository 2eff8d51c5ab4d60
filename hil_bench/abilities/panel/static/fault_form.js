// Faults and influences in words: what a click does, the fields of what it needs, and its request.

import { button, el, labelled, select } from "./dom.js";
import { shown, valueWithUnit } from "./units.js";

const ACTIONS = {
  freeze: "Freeze", offset: "Offset", drift: "Drift", noise: "Add noise", break_wire: "Break wire", slow: "Slow down",
  stick: "Make it stick", invert: "Invert", disable: "Switch off enable input", drop_supply: "Drop supply pressure",
  leak: "Leak", aerate: "Mix air into oil", wear_spool: "Wear spool edges", jam: "Jam", drop_load: "Drop load",
  wear_pump: "Wear pump", sag_relief: "Weaken relief valve", lose_gas: "Lose gas", clog_filter: "Clog filter",
  bind: "Bind spool", weaken: "Weaken spool drive", silence: "Silence", reset: "Reset", lose: "Lose frames",
  delay: "Delay frames", truncate: "Truncate frames", corrupt: "Corrupt frames", repeat: "Repeat frames",
  babble: "Babble", bit_error: "Bit errors", bus_off: "Go bus-off", stuck_dominant: "Hold bus dominant",
  no_acknowledge: "Withhold acknowledge", indicate: "Show error indicator", report: "Report trouble code", readdress: "Change address",
};

export function actionWords(kind) {
  return ACTIONS[kind] ?? kind.replaceAll("_", " ");
}

// Return the fields of a kind of fault at a target: each with its key, input and labelled row.
export function faultFields(keys) {
  return keys.map((key) => {
    const isAmount = !key.choices && key.name !== "can_id" && key.name !== "for_s" && key.default === null;
    const needed = key.is_needed || isAmount;
    const field = key.choices
      ? select([["", "(default)"], ...key.choices.map((each) => [each, each])])
      : el("input", { type: "number", step: "any", required: needed, value: needed ? (key.default ?? 10) : "", placeholder: key.name === "for_s" ? "until cleared" : (key.default ?? "") });
    const unit = !key.unit || key.unit === "-" ? "" : ` [${key.unit}]`;
    field.name = key.name;
    return { key, field, row: labelled(`${key.words ?? key.name}${unit}`, field) };
  });
}

// Return the keys that the fields of a fault hold.
export function faultKeys(fields) {
  const keys = {};
  for (const { key, field } of fields) {
    if (field.value !== "") keys[key.name] = key.choices ? field.value : Number(field.value);
  }
  return keys;
}

// Return a form that sets an influence on a plant; `act(action, fields, words)` does it.
export function influenceForm(axis, { name, unit, low, high }, act) {
  const { symbol, factor } = shown(unit);
  const field = el("input", { type: "number", step: "any", min: low / factor, max: high / factor, required: true });
  return el("form", { class: "row", onsubmit: (event) => {
    event.preventDefault();
    act("set_plant", { axis, quantity: name, value: Number(field.value) * factor }, `${axis}.${name} is ${field.value} ${symbol}`);
  } }, labelled(`${axis}: ${name.replaceAll("_", " ")} [${symbol}]`, field), el("button", { type: "submit" }, "Set"));
}

// Return what a target shows at present, in words; empty where it has no channel.
export function presentText(model, target) {
  const name = [`${target}.measured`, target].find((each) => model.store.number(each) >= 0);
  if (!name) return "";
  const unit = model.unit(name);
  return `now ${valueWithUnit(model.store.latest(name), unit)}`;
}

// The faults of one element: a button a kind, and a form for one that needs an amount.
export class FaultButtons {
  constructor(act) {
    this.act = act;
    this.form = el("form", { class: "stack", hidden: true, onsubmit: (event) => this.submit(event) });
    this.buttons = el("div", { class: "kinds" });
    this.root = el("div", { class: "stack" }, this.buttons, this.form);
  }

  // Offer faults, each [kind, target, keys]; `owner` is the name in their accessible names.
  offer(faults) {
    this.form.hidden = true;
    this.buttons.replaceChildren(...faults.map((fault) => {
      const [kind, target] = fault;
      return button(actionWords(kind), () => this.choose(fault), { "aria-label": `${actionWords(kind)}: ${target}` });
    }));
  }

  choose([kind, target, keys]) {
    this.fields = faultFields(keys);
    if (!this.fields.some(({ field }) => field.required)) {
      this.form.hidden = true;
      this.act("fault", { kind, target, keys: {} });
      return;
    }
    this.chosen = { kind, target };
    this.form.replaceChildren(...this.fields.map(({ row }) => row), el("button", { type: "submit", class: "danger" }, `${actionWords(kind)}: ${target}`));
    this.form.hidden = false;
    this.fields[0].field.focus();
  }

  submit(event) {
    event.preventDefault();
    this.act("fault", { ...this.chosen, keys: faultKeys(this.fields) });
    this.form.hidden = true;
  }
}

// The list of active faults, each with a button that ends it.
export class ActiveFaults {
  constructor(model, act) {
    this.model = model;
    this.act = act;
    this.root = el("ul", { class: "active-faults" });
  }

  draw() {
    const { faults } = this.model.state;
    if (faults === this.seen) return;
    this.seen = faults;
    const items = faults.map(({ kind, target, number }) =>
      el("li", {}, `${kind} ${target}`,
        button("clear", () => this.act("clear_fault", { number }), { "aria-label": `clear ${kind} ${target}` })));
    this.root.replaceChildren(...(items.length ? items : [el("li", { class: "quiet" }, "none")]));
  }
}

