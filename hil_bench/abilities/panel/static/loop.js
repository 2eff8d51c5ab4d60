// The loop: how late ticks were, how long they worked, and which overran.

import { el, setText, svg } from "./dom.js";

const PERIOD = 1000; // between two looks [ms]
const BARS = 48;

export class LoopView {
  constructor(root, model) {
    this.model = model;
    this.body = el("tbody");
    this.words = el("p", {});
    this.charts = { lateness: new Histogram("Lateness"), work: new Histogram("Work") };
    this.lookedAt = 0;
    root.append(
      el("table", {}, el("thead", {}, el("tr", {}, ...["", "p50", "p99", "p99.9", "max"].map((text) => el("th", { scope: "col" }, text)))), this.body),
      this.words,
      el("div", { class: "columns" }, ...Object.values(this.charts).map((chart) => chart.root)),
    );
  }

  draw() {
    const now = performance.now();
    if (now - this.lookedAt < PERIOD) return;
    this.lookedAt = now;
    const { health } = this.model;
    const rows = ["lateness", "work"].filter((name) => health[name]).map((name) =>
      el("tr", {}, el("th", { scope: "row" }, name), ...["p50_us", "p99_us", "p999_us", "max_us"].map((key) => el("td", { class: "figure" }, `${health[name][key].toFixed(0)} µs`))));
    this.body.replaceChildren(...rows);
    const parts = [["ticks", "ticks"], ["overruns", "overran"], ["skipped", "skipped"], ["received", "frames in"], ["sent", "frames out"], ["syncs", "SYNCs"], ["lost", "messages lost on the way from the loop"]];
    setText(this.words, parts.filter(([key]) => health[key] !== undefined).map(([key, text]) => `${health[key]} ${text}`).join(" · ") + ` · this page draws ${window.hilBench.frames.rate.toFixed(0)} pictures a second`);
    this.model.request("histograms").then((found) => {
      for (const [name, chart] of Object.entries(this.charts)) chart.show(found?.[name] ?? [], this.model.hello?.tick_s);
    }).catch(() => {});
  }
}

// Counts over duration, both logarithmic.
class Histogram {
  constructor(title) {
    this.bars = svg("g");
    this.scale = svg("g");
    this.root = el("figure", {}, el("figcaption", {}, `${title} [µs], counts on a logarithmic scale`),
      svg("svg", { viewBox: "-25 0 570 220", class: "chart", role: "img", "aria-label": `histogram of ${title.toLowerCase()}` }, this.bars, this.scale));
  }

  show(bins, tick = 1e-3) {
    const top = Math.max(...bins.map(([edge]) => edge), tick * 1e6, 10);
    const decades = Math.log10(top);
    const counts = new Array(BARS).fill(0);
    for (const [edge, count] of bins) {
      counts[Math.min(BARS - 1, Math.max(0, Math.floor((BARS * Math.log10(Math.max(edge, 1))) / decades)))] += count;
    }
    const most = Math.log10(Math.max(...counts, 1) + 1);
    this.bars.replaceChildren(...counts.map((count, i) => {
      const height = (180 * Math.log10(count + 1)) / most;
      return svg("rect", { x: 10 + (i * 500) / BARS, y: 190 - height, width: 500 / BARS - 1, height, class: "bar" });
    }));
    const marks = [];
    for (let decade = 0; decade < decades - 0.2; decade += 1) {
      const text = svg("text", { x: 10 + (500 * decade) / decades, y: 210, "text-anchor": "middle" });
      text.textContent = String(10 ** decade);
      marks.push(text);
    }
    const x = 10 + (500 * Math.log10(tick * 1e6)) / decades;
    const label = svg("text", { x: x - 4, y: 14, "text-anchor": "end" });
    label.textContent = "a tick";
    this.scale.replaceChildren(...marks, svg("line", { x1: x, x2: x, y1: 4, y2: 190, class: "limit" }), label);
  }
}
