// Faults: each kind with its keys, what is active, loads, and marks.

import { button, el, labelled, select, setText } from "./dom.js";
import { shown } from "./units.js";

export class FaultsView {
  constructor(root, model) {
    this.model = model;
    this.kinds = el("div", { class: "kinds", role: "group", "aria-label": "kind of fault" });
    this.target = select([], { onchange: () => this.offerKeys() });
    this.keys = el("div", { class: "keys" });
    this.problem = el("p", { class: "problem", role: "alert" });
    this.body = el("tbody");
    this.loads = el("div", { class: "stack" });
    this.mark = el("input", { maxlength: 200, placeholder: "what for", "aria-label": "text of the mark" });
    this.done = el("p", { class: "quiet", role: "status" });
    root.append(
      el("div", { class: "columns" },
        el("div", {}, el("h2", {}, "Break something"), this.kinds,
          el("form", { class: "stack", onsubmit: (event) => this.begin_fault(event) },
            labelled("target", this.target), this.keys,
            el("button", { type: "submit", class: "danger" }, "Begin the fault")),
          this.problem, this.done),
        el("div", {}, el("h2", {}, "Active"),
          el("table", {}, el("thead", {}, el("tr", {}, ...["no.", "fault", "since", "until", ""].map((text) => el("th", { scope: "col" }, text)))), this.body),
          button("Clear all faults", () => this.act("clear_fault", {}, "all faults cleared"), { class: "wide" }),
          el("h2", {}, "Loads and supply"), this.loads,
          el("h2", {}, "Mark"), el("form", { class: "row", onsubmit: (event) => this.set_mark(event) }, this.mark, el("button", { type: "submit" }, "Mark this moment")),
          el("h2", {}, "The run"), button("End the run", () => this.end_run(), { class: "danger" }))),
    );
  }

  begin(hello) {
    this.choices = hello.fault_kinds ?? {};
    const kinds = Object.keys(this.choices).filter((kind) => Object.keys(this.choices[kind]).length);
    this.kinds.replaceChildren(...kinds.map((kind) => button(kind.replaceAll("_", " "), () => this.choose(kind), { "data-kind": kind, "aria-pressed": "false" })));
    this.shownFaults = null;
    if (kinds.length) this.choose(kinds.includes(this.kind) ? this.kind : kinds[0]);
    this.loads.replaceChildren(...Object.entries(hello.axes).flatMap(([axis, influences]) => influences.map((influence) => this.load(axis, influence))));
  }

  choose(kind) {
    this.kind = kind;
    for (const each of this.kinds.children) each.setAttribute("aria-pressed", String(each.dataset.kind === kind));
    const before = this.target.value;
    const targets = Object.keys(this.choices[kind]);
    this.target.replaceChildren(...targets.map((name) => el("option", { value: name }, name)));
    if (targets.includes(before)) this.target.value = before;
    this.offerKeys();
  }

  offerKeys() {
    const keys = this.choices[this.kind][this.target.value] ?? [];
    this.fields = keys.map((key) => {
      const isAmount = !key.choices && key.name !== "can_id" && key.name !== "for_s" && key.default === null;
      const needed = key.is_needed || isAmount;
      const field = key.choices
        ? select([["", "(default)"], ...key.choices.map((each) => [each, each])])
        : el("input", { type: "number", step: "any", required: needed, value: needed ? (key.default ?? 10) : "", placeholder: key.name === "for_s" ? "until cleared" : (key.default ?? "") });
      return { key, field, row: labelled(`${key.name}${key.unit === "-" ? "" : ` [${key.unit}]`}`, field) };
    });
    this.keys.replaceChildren(...this.fields.map(({ row }) => row));
  }

  begin_fault(event) {
    event.preventDefault();
    const keys = {};
    for (const { key, field } of this.fields) {
      if (field.value !== "") keys[key.name] = key.choices ? field.value : Number(field.value);
    }
    this.act("fault", { kind: this.kind, target: this.target.value, keys }, `${this.kind} ${this.target.value} has begun`);
  }

  load(axis, { name, unit, low, high }) {
    const { symbol, factor } = shown(unit);
    const field = el("input", { type: "number", step: "any", min: low / factor, max: high / factor, required: true });
    return el("form", { class: "row", onsubmit: (event) => {
      event.preventDefault();
      this.act("set_plant", { axis, quantity: name, value: Number(field.value) * factor }, `${axis}.${name} is ${field.value} ${symbol}`);
    } }, labelled(`${axis}.${name} [${symbol}]`, field), el("button", { type: "submit" }, "Set"));
  }

  set_mark(event) {
    event.preventDefault();
    this.act("mark", { text: this.mark.value || "mark" }, "marked");
  }

  end_run() {
    if (confirm("End the run of this bench?")) this.act("stop", {}, "the bench ends");
  }

  async act(action, fields, words) {
    try {
      await this.model.request(action, fields);
      setText(this.problem, "");
      setText(this.done, words);
    } catch (error) {
      setText(this.done, "");
      setText(this.problem, error.message);
    }
  }

  draw() {
    const { faults } = this.model.state;
    if (faults === this.shownFaults) return;
    this.shownFaults = faults;
    const rows = faults.map(({ number, kind, target, begins, ends }) =>
      el("tr", {}, el("td", { class: "figure" }, String(number)), el("td", {}, `${kind} ${target}`),
        el("td", { class: "figure" }, `${begins.toFixed(3)} s`), el("td", { class: "figure" }, ends === null ? "cleared" : `${ends.toFixed(3)} s`),
        el("td", {}, button("Clear", () => this.act("clear_fault", { number }, `fault ${number} cleared`), { "aria-label": `clear fault ${number}, ${kind} ${target}` }))));
    this.body.replaceChildren(...(rows.length ? rows : [el("tr", {}, el("td", { colspan: 5, class: "quiet" }, "no fault"))]));
  }
}
