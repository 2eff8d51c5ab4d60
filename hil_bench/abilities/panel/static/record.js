// Record as a test: what was clicked from a beginning to an end, with a requirement, as a scenario.

import { button, el, labelled, select, setText } from "./dom.js";
import { shown } from "./units.js";

export class RecordView {
  constructor(root, model) {
    this.model = model;
    const field = (attributes) => el("input", { required: true, ...attributes });
    this.from = field({ type: "number", step: "any", min: 0, value: 0 });
    this.to = field({ type: "number", step: "any", min: 0, required: false, placeholder: "now" });
    this.lead = field({ type: "number", step: "any", min: 0, value: 1 });
    this.file = field({ value: "recorded", pattern: "[A-Za-z0-9][A-Za-z0-9_\\-]{0,60}", title: "letters, digits, _ and -" });
    this.title = field({ value: "Recorded by hand" });
    this.id = field({ value: "REQ-1" });
    this.channel = select([], { "aria-label": "channel" });
    this.relation = select(["<", ">", "<=", ">="], { "aria-label": "relation" });
    this.limit = el("input", { type: "number", step: "any", value: 250, "aria-label": "limit" });
    this.that = field({ class: "wide" });
    this.controller = select([["", "nobody"], ["manual", "manual: devices set up, valve enabled"], ["position_control", "position_control: moves to 100 mm"]]);
    this.replaces = el("input", { type: "checkbox" });
    this.body = el("tbody");
    this.output = el("div", { role: "status", class: "result" });
    this.recordButton = button("Start recording", () => this.toggle(), { class: "danger", "aria-pressed": "false" });
    root.append(
      el("p", {}, "Start, break and set what you like on the other pages, come back and stop: the clicks are the steps of a test. It runs on the virtual bench, from power-on."),
      el("div", { class: "columns" },
        el("form", { class: "stack", onsubmit: (event) => this.run(event) },
          el("div", { class: "row" }, this.recordButton, labelled("from [s]", this.from), labelled("to [s]", this.to)),
          el("h2", {}, "Requirement"),
          labelled("id", this.id),
          el("div", { class: "row" }, "always", this.channel, this.relation, this.limit, button("use", () => this.compose())),
          labelled("in words of the language", this.that),
          el("h2", {}, "Test"),
          labelled("title", this.title), labelled("file name", this.file), labelled("who drives", this.controller),
          labelled("time for the controller before the first step [s]", this.lead),
          labelled("replace a file of this name", this.replaces),
          el("div", { class: "row" }, button("Preview", () => this.preview()), el("button", { type: "submit", class: "primary" }, "Save and run")),
          this.output),
        el("div", {}, el("h2", {}, "What was done"),
          el("div", { class: "scroller", tabindex: "0", role: "region", "aria-label": "what was done" }, el("table", {}, this.body)))),
    );
  }

  begin(hello) {
    this.channel.replaceChildren(...hello.channels.map(([name]) => el("option", { value: name }, name)));
    const pressure = hello.channels.find(([, unit]) => unit === "Pa");
    if (pressure) [this.channel.value] = pressure;
    this.isRecording = false;
    this.showRecording();
    this.listed = -1;
    this.compose();
  }

  compose() {
    const { symbol, factor } = shown(this.model.unit(this.channel.value));
    const value = symbol === "%" ? String(this.limit.value * factor) : `${this.limit.value} ${symbol}`;
    this.that.value = `always ${this.channel.value} ${this.relation.value} ${value}`;
  }

  toggle() {
    const now = this.model.time.toFixed(3);
    if (!this.isRecording) {
      this.from.value = now;
      this.to.value = "";
    } else this.to.value = now;
    this.isRecording = !this.isRecording;
    this.showRecording();
  }

  showRecording() {
    setText(this.recordButton, this.isRecording ? "Stop recording" : "Start recording");
    this.recordButton.setAttribute("aria-pressed", String(this.isRecording));
    document.body.classList.toggle("is-recording", this.isRecording);
  }

  form() {
    if (this.to.value === "") this.to.value = this.model.time.toFixed(3);
    return {
      file: this.file.value, title: this.title.value, begin_s: Number(this.from.value), end_s: Number(this.to.value),
      lead_s: Number(this.lead.value), controller: this.controller.value, requirement: this.id.value, that: this.that.value,
    };
  }

  async preview() {
    try {
      const { text, path, remarks } = await this.model.request("preview", this.form());
      this.output.replaceChildren(...remarks.map((line) => el("p", { class: "problem" }, line)), el("p", { class: "quiet" }, path), el("pre", { tabindex: "0" }, text));
    } catch (error) {
      this.output.replaceChildren(el("p", { class: "problem" }, error.message));
    }
  }

  async run(event) {
    event.preventDefault();
    if (this.isRecording) this.toggle();
    this.output.replaceChildren(el("p", {}, "the test runs ..."));
    try {
      const answer = await this.model.request("test", { ...this.form(), replaces: this.replaces.checked });
      this.output.replaceChildren(...this.lines(answer));
    } catch (error) {
      this.output.replaceChildren(...error.message.split("\n").map((line) => el("p", { class: "problem" }, line)));
    }
  }

  lines({ verdict, result, path, remarks }) {
    const findings = result.findings.map(({ id, that, judgement, text }) =>
      el("p", {}, `${id} ${judgement.outcome}: ${that}; ${text}`));
    const rest = [result.problem, result.ending, ...remarks].filter(Boolean).map((line) => el("p", { class: "problem" }, line));
    return [el("p", { class: `verdict ${verdict}` }, verdict), ...findings, ...rest, el("p", { class: "quiet" }, `written to ${path}; again: hil-bench test ${path}`)];
  }

  draw() {
    const { commands } = this.model;
    const from = Number(this.from.value || 0);
    if (commands.length === this.listed && from === this.listedFrom) return;
    [this.listed, this.listedFrom] = [commands.length, from];
    const rows = commands.slice(-200).map((command) => {
      const words = describe(command);
      return el("tr", { class: command.time >= from ? "" : "quiet" }, el("td", { class: "figure" }, `${command.time.toFixed(3)} s`), el("td", {}, words));
    });
    this.body.replaceChildren(...(rows.length ? rows.reverse() : [el("tr", {}, el("td", { class: "quiet" }, "nothing yet"))]));
  }
}

export function describe({ do: action, fields, number }) {
  const { kind, target, arguments: given = {}, axis, quantity, node, name, value, text } = fields;
  if (action === "begin_fault") return `fault ${number}: ${kind} ${target} ${Object.entries(given).map(([key, each]) => `${key}=${each}`).join(" ")}`;
  if (action === "clear_fault") return fields.number ? `fault ${fields.number} cleared` : "all faults cleared";
  if (action === "set_plant") return `${axis}.${quantity} = ${value}`;
  if (action === "set_object") return `${node}.${name} = ${typeof value === "object" ? value.hex : value}`;
  return `mark: ${text}`;
}
