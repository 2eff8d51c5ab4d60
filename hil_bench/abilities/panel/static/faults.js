// Faults: each kind with its keys, what is active, loads, and marks.

import { button, el, labelled, select, setText } from "./dom.js";
import { actionWords, faultFields, faultKeys, influenceForm, presentText } from "./fault_form.js";

export class FaultsView {
  constructor(root, model) {
    this.model = model;
    this.kinds = el("div", { class: "kinds", role: "group", "aria-label": "kind of fault" });
    this.target = select([], { onchange: () => this.offerKeys() });
    this.present = el("p", { class: "quiet figure" });
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
            labelled("target", this.target), this.present, this.keys,
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
    this.kinds.replaceChildren(...kinds.map((kind) => button(actionWords(kind), () => this.choose(kind), { "data-kind": kind, "aria-pressed": "false" })));
    this.shownFaults = null;
    if (kinds.length) this.choose(kinds.includes(this.kind) ? this.kind : kinds[0]);
    this.loads.replaceChildren(...Object.entries(hello.axes).flatMap(([axis, influences]) => influences.map((influence) => influenceForm(axis, influence, (...words) => this.act(...words)))));
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
    this.fields = faultFields(keys);
    this.keys.replaceChildren(...this.fields.map(({ row }) => row));
  }

  begin_fault(event) {
    event.preventDefault();
    this.act("fault", { kind: this.kind, target: this.target.value, keys: faultKeys(this.fields) }, `${this.kind} ${this.target.value} has begun`);
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
    setText(this.present, presentText(this.model, this.target.value));
    const { faults } = this.model.state;
    if (faults === this.shownFaults) return;
    this.shownFaults = faults;
    const rows = faults.map(({ number, kind, target, begins, ends, is_idle }) =>
      el("tr", {}, el("td", { class: "figure" }, String(number)), el("td", {}, `${kind} ${target}${is_idle ? ", has changed nothing so far" : ""}`),
        el("td", { class: "figure" }, `${begins.toFixed(3)} s`), el("td", { class: "figure" }, ends === null ? "no end" : `${ends.toFixed(3)} s`),
        el("td", {}, button("Clear", () => this.act("clear_fault", { number }, `fault ${number} cleared`), { "aria-label": `clear fault ${number}, ${kind} ${target}` }))));
    this.body.replaceChildren(...(rows.length ? rows : [el("tr", {}, el("td", { colspan: 5, class: "quiet" }, "no fault"))]));
  }
}
