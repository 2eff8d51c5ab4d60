// The bus: frames in words, who sends what how often, and the load over time.

import { Decoder, hex } from "./decode.js";
import { button, el, labelled, setText, svg } from "./dom.js";

const ROWS = 120;
const PERIOD = 200; // between two drawings [ms]
const LOADS = 300;

export class BusView {
  constructor(root, model) {
    this.model = model;
    this.decoder = new Decoder();
    this.isPaused = false;
    this.drawn = 0;
    this.loads = [];
    this.filter = el("input", { type: "search", placeholder: "filter: valve, EMCY, 0x181 ...", "aria-label": "filter frames" });
    this.pauseButton = button("Pause", () => this.toggle(), { title: "space", "aria-pressed": "false" });
    this.count = el("span", { class: "quiet figure" });
    this.trace = el("tbody");
    this.senders = el("tbody");
    this.findings = el("div", { class: "findings", role: "region", "aria-label": "what is wrong on the bus" });
    this.line = svg("polyline", { class: "load-line", points: "" });
    this.loadText = el("span", { class: "figure" });
    const head = (...texts) => el("thead", {}, el("tr", {}, ...texts.map((text) => el("th", { scope: "col" }, text))));
    root.append(
      el("div", { class: "toolbar" }, this.pauseButton, labelled("filter", this.filter), this.count,
        el("span", { class: "row" }, "load", svg("svg", { viewBox: `0 0 ${LOADS} 40`, class: "load", role: "img", "aria-label": "bus load over the last 30 s" }, this.line), this.loadText)),
      this.findings,
      el("div", { class: "bus" },
        el("div", { class: "scroller", tabindex: "0", role: "region", "aria-label": "frames" }, el("table", {}, head("time [s]", "", "identifier", "use", "data", "meaning"), this.trace)),
        el("div", { class: "scroller", tabindex: "0", role: "region", "aria-label": "who sends what" }, el("h2", {}, "Who sends what"), el("table", {}, head("identifier", "use", "frames", "per second", "last"), this.senders))),
    );
    model.link.on("health", ({ bus_load: load }) => {
      if (load === undefined) return;
      this.loads.push(load);
      if (this.loads.length > LOADS) this.loads.shift();
    });
    model.link.on("state", (state) => this.learn(state));
    model.link.on("findings", ({ findings }) => this.drawFindings(findings));
  }

  begin(hello) {
    this.decoder.begin(hello);
    this.states = "";
    this.loads = [];
    this.findings.replaceChildren();
    if (this.isShown) this.show();
  }

  // Read the mappings again when a node has changed its state: only then can they change.
  learn(state) {
    if (this.model.hello) this.decoder.takeAddresses(this.model.hello, state.ecus);
    const states = JSON.stringify(Object.values(state.nodes).map((node) => node.state));
    if (states === this.states) return;
    this.states = states;
    if (this.isShown) this.readPdos();
  }

  async readPdos() {
    try {
      this.decoder.takePdos(await this.model.request("pdos"));
    } catch {
      this.states = ""; // again with the next state
    }
  }

  show() {
    this.isShown = true;
    this.findings.replaceChildren(); // of frames before those that come now
    for (const sender of this.model.senders.values()) sender.times = []; // nobody counted meanwhile
    this.model.request("want", { frames: true }).catch(() => {});
    this.readPdos();
  }

  hide() {
    this.isShown = false;
    this.model.request("want", { frames: false }).catch(() => {});
  }

  toggle() {
    this.isPaused = !this.isPaused;
    this.held = this.model.frames;
    if (this.isPaused) this.held = [...this.model.frames];
    setText(this.pauseButton, this.isPaused ? "Go on" : "Pause");
    this.pauseButton.setAttribute("aria-pressed", String(this.isPaused));
  }

  key(event) {
    if (event.key !== " " || event.target.tagName === "BUTTON") return false;
    this.toggle();
    return true;
  }

  draw() {
    const now = performance.now();
    if (now - this.drawn < PERIOD) return;
    this.drawn = now;
    this.drawTrace();
    this.drawSenders();
    const most = Math.max(0.05, ...this.loads);
    this.line.setAttribute("points", this.loads.map((load, i) => `${i},${(39 - (38 * load) / most).toFixed(1)}`).join(" "));
    setText(this.loadText, this.loads.length ? `${(this.loads.at(-1) * 100).toFixed(1)} %; scale to ${(most * 100).toFixed(0)} %` : "");
  }

  // The causes that `hil-bench explain` finds in the frames since somebody has opened this view.
  drawFindings(findings) {
    const begins = new Map(findings.map(({ bus, since }) => [bus, since]));
    const times = [...begins].map(([bus, since]) => el("p", { class: "quiet" }, `${bus ? `bus ${bus}: ` : ""}the times below count from ${since.toFixed(3)} s`));
    this.findings.replaceChildren(...times, ...findings.map(({ bus, title, text, advice, clause, leads_to: leads }) => el(
      "details", { class: "finding" },
      el("summary", {}, `${bus ? `bus ${bus}: ` : ""}${title}: ${text}`),
      el("p", { class: "quiet" }, `${advice} (${clause})`),
      ...leads.map((effect) => el("p", {}, `so: ${effect}`)),
    )));
  }

  drawTrace() {
    const frames = this.isPaused ? this.held : this.model.frames;
    const words = this.filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    const rows = [];
    for (let i = frames.length - 1; i >= 0 && rows.length < ROWS; i -= 1) {
      const cells = this.cells(frames[i]);
      const text = cells.join(" ").toLowerCase();
      if (words.every((word) => text.includes(word))) {
        const isLoud = cells[3].includes("EMCY");
        rows.push(el("tr", { class: isLoud ? "loud" : "" }, ...cells.map((cell, n) => el("td", { class: n === 5 ? "" : "figure" }, cell))));
      }
    }
    this.trace.replaceChildren(...rows);
    setText(this.count, `${rows.length} of the last ${frames.length} frames, the newest first`);
  }

  cells(frame) {
    const { decoder } = this;
    const data = frame.data.match(/../g)?.join(" ") ?? "";
    const bus = frame.bus ? `${frame.bus}:` : "";
    return [frame.time.toFixed(4), frame.way === "in" ? "→ bench" : "bench →", bus + hex(frame.id, frame.isExtended ? 8 : 3), decoder.use(frame), data, decoder.meaning(frame)];
  }

  drawSenders() {
    const rows = [...this.model.senders.values()].sort((a, b) => a.frame.id - b.frame.id).slice(0, ROWS).map(({ count, times, frame }) => {
      const lasts = times.at(-1) - times[0];
      const isOld = this.model.time - frame.time > 2;
      const rate = isOld ? "–" : lasts > 0 ? ((times.length - 1) / lasts).toFixed(1) : "";
      const [, , identifier, use, , meaning] = this.cells(frame);
      return el("tr", {}, ...[identifier, use, count, rate, meaning || frame.data].map((cell, n) => el("td", { class: n === 4 ? "" : "figure" }, String(cell))));
    });
    this.senders.replaceChildren(...rows);
  }
}
