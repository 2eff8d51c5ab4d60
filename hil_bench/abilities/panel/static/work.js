// Work that is no running bench, or a scenario on one: what is done, its limits, live values, stop.

import { button, el, setText } from "./dom.js";
import { Plots } from "./plots.js";
import { shown, valueText } from "./units.js";
import { Courses, Failures, Histograms, Margins, showProgress } from "./work_parts.js";

const SPAN = 20; // of the plots [s]
const LONGEST = 120; // of a scenario that is plotted whole [s]
const MOST_PLOTTED = 8;
const NEAR = 0.1; // share of the range beside a limit

export class WorkView {
  constructor(root, model) {
    this.model = model;
    this.title = el("p", { class: "quiet" });
    this.now = el("p", { class: "work-now", role: "status" });
    this.detail = el("p", {});
    this.bar = el("progress", { "aria-label": "parts that are done" });
    this.count = el("span", { class: "figure" });
    this.counts = el("ul", { class: "chips" });
    this.stop = button("Stop", () => this.act("stop", {}, "stop was asked for"), { class: "danger stop" });
    this.text = el("input", { maxlength: 200, placeholder: "what for", "aria-label": "text of the mark" });
    this.said = el("p", { class: "problem", role: "alert" });
    this.values = el("tbody");
    this.valuesTable = el("table", { class: "values" }, head("channel", "value", "low", "", "high"), this.values);
    this.items = el("tbody");
    this.margins = new Margins();
    this.histograms = new Histograms();
    this.courses = new Courses();
    this.failures = new Failures(model);
    this.plots = new Plots(model, { height: 130 });
    root.append(
      el("div", { class: "work" },
        el("div", {}, this.title, this.now, this.detail,
          el("div", { class: "row" }, this.bar, this.count), this.counts),
        el("div", { class: "stack" }, this.stop,
          el("form", { class: "row", onsubmit: (event) => this.mark(event) }, this.text, el("button", { type: "submit" }, "Mark")),
          this.said)),
      this.margins.root,
      el("div", { class: "columns" },
        el("div", { class: "scroller", tabindex: "0", role: "region", "aria-label": "parts and findings" },
          el("table", {}, head("part", "verdict", ""), this.items)),
        el("div", {}, this.courses.root, this.histograms.root, this.plots.root, this.valuesTable)),
      this.failures.root,
    );
  }

  begin(hello) {
    this.shownWork = null;
    this.failures.begin();
    setText(this.title, hello.work ? `${hello.work.verb}: ${hello.work.title}` : "");
    setText(this.said, "");
    const channels = hello.channels.filter(([name]) => name !== "step");
    this.rows = channels.map(([name, unit]) => {
      const cells = { value: figure(), low: figure(), high: figure(), meter: el("meter", { "aria-label": `${name} between its limits`, hidden: true }) };
      const row = el("tr", {}, el("th", { scope: "row" }, `${name} [${shown(unit).symbol}]`), cells.value, cells.low, el("td", {}, cells.meter), cells.high);
      return { name, unit, row, ...cells };
    });
    this.values.replaceChildren(...this.rows.map(({ row }) => row));
    this.valuesTable.hidden = this.rows.length === 0;
    this.listPlotted(channels);
  }

  // Plot what requirements are about first, then the first channels.
  listPlotted(channels = this.model.hello.channels.filter(([name]) => name !== "step")) {
    const wanted = new Set((this.model.state.work?.margins ?? []).flatMap(({ bands }) => bands.map(({ channel }) => channel)));
    const sorted = [...channels.filter(([name]) => wanted.has(name)), ...channels.filter(([name]) => !wanted.has(name))];
    this.plotted = [...wanted].join();
    this.plots.choose(sorted.slice(0, MOST_PLOTTED).map(([name]) => name));
  }

  show() {
    this.plots.resize();
  }

  draw() {
    const { work } = this.model.state;
    if (work && work !== this.shownWork) this.describe(work);
    const { store } = this.model;
    for (const { name, unit, row, value, meter } of this.rows) {
      const present = store.latest(name);
      setText(value, Number.isFinite(present) ? valueText(present, unit) : "–");
      const limits = work?.limits[name];
      if (!limits || !Number.isFinite(present)) {
        row.classList.remove("loud");
        continue;
      }
      const margin = NEAR * (limits[1] - limits[0]);
      row.classList.toggle("loud", present < limits[0] + margin || present > limits[1] - margin);
      meter.value = present;
    }
    const whole = work?.unit === "s" && work.total <= LONGEST ? work.total : 0; // of a scenario, all of it
    const end = Math.max(whole || SPAN, store.last);
    this.plots.show(whole ? 0 : Math.max(0, store.last - SPAN), end, store.last);
  }

  describe(work) {
    this.shownWork = work;
    setText(this.now, work.verdict ? `${work.now || "done"}: ${work.verdict}` : work.now);
    setText(this.detail, work.detail);
    this.bar.hidden = !work.total;
    this.bar.max = work.total || 1;
    this.bar.value = work.done;
    showProgress(this.count, work);
    this.margins.show(work.margins ?? []);
    this.histograms.show(work.histograms ?? []);
    this.courses.show(work.courses ?? []);
    this.failures.show(work.failures ?? []);
    const wanted = new Set((work.margins ?? []).flatMap(({ bands }) => bands.map(({ channel }) => channel)));
    if ([...wanted].join() !== this.plotted) this.listPlotted();
    this.counts.replaceChildren(...Object.entries(work.counts).map(([name, count]) => el("li", { class: `chip ${look(name)}` }, `${count} ${name}`)));
    this.items.replaceChildren(...work.items.map(({ name, verdict, text }) =>
      el("tr", { class: verdict ? "" : "quiet" }, el("th", { scope: "row" }, name), el("td", { class: `word ${look(verdict)}` }, verdict), el("td", {}, text))));
    for (const { name, unit, low, high, meter } of this.rows) {
      const limits = work.limits[name];
      setText(low, limits ? valueText(limits[0], unit) : "");
      setText(high, limits ? valueText(limits[1], unit) : "");
      meter.hidden = !limits;
      if (limits) [meter.min, meter.max] = limits;
    }
  }

  mark(event) {
    event.preventDefault();
    this.act("mark", { text: this.text.value || "mark" }, "marked");
  }

  async act(action, fields, words) {
    try {
      await this.model.request(action, fields);
      setText(this.said, words);
    } catch (error) {
      setText(this.said, error.message);
    }
  }
}

function head(...names) {
  return el("thead", {}, el("tr", {}, ...names.map((text) => (text ? el("th", { scope: "col" }, text) : el("td", {})))));
}

function figure() {
  return el("td", { class: "figure" });
}

// Return how a verdict looks: good, bad, or neither.
function look(verdict) {
  if (["passed", "follows"].includes(verdict)) return "good";
  return ["failed", "stopped", "differs", "crashed", "timed out", "beyond a limit"].includes(verdict) ? "bad" : "";
}
