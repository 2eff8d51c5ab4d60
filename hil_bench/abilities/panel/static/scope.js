// The scope: channels against time, live or paused, with zoom, trigger, cursors and export.

import { button, download, el, labelled, select, setText } from "./dom.js";
import { Plots } from "./plots.js";
import { shown, valueText } from "./units.js";

const SPANS = [0.5, 1, 2, 5, 10, 30, 60, 120];
const FIRST = ["position", "P_A", "P_B", "spool_setpoint", "spool_position"];

export class ScopeView {
  constructor(root, model) {
    this.model = model;
    this.isLive = true;
    this.span = 10;
    this.begin_s = 0;
    this.end_s = 10;
    this.plots = new Plots(model, { height: 210, onzoom: (begin, end) => this.look(begin, end) });
    this.plots.root.id = "scope-plots";
    this.search = el("input", { type: "search", placeholder: "search channels", "aria-label": "search channels", oninput: () => this.filter() });
    this.list = el("div", { class: "channel-list" });
    this.pauseButton = button("Pause", () => this.toggle(), { title: "space", "aria-pressed": "false" });
    this.spans = select(SPANS.map((each) => [each, `${each} s`]), { "aria-label": "time shown", onchange: () => this.setSpan(Number(this.spans.value)) });
    this.spans.value = "10";
    this.scroll = el("input", { type: "range", min: 0, max: 1000, value: 1000, "aria-label": "scroll back", oninput: () => this.scrollTo(Number(this.scroll.value) / 1000) });
    this.cursorA = this.cursorField("A");
    this.cursorB = this.cursorField("B");
    this.table = el("tbody");
    this.difference = el("p", { class: "figure" });
    this.recordButton = button("Record", () => this.record(), { class: "danger", title: "key r: all channels and frames, each tick, into a file", "aria-pressed": "false" });
    this.said = el("span", { class: "quiet", role: "status" });
    this.trigger = new Trigger(model, (time) => this.pauseAround(time));
    root.append(
      el("div", { class: "toolbar" }, this.pauseButton,
        button("◀", () => this.pan(-0.25), { "aria-label": "earlier", title: "arrow left" }),
        button("▶", () => this.pan(0.25), { "aria-label": "later", title: "arrow right" }),
        labelled("show", this.spans), this.scroll,
        button("PNG", () => this.savePicture(), { title: "save the picture" }),
        button("CSV", () => this.saveTable(), { title: "save the rows that are shown, in SI units" }),
        button("MF4", () => this.saveMeasurement(), { title: "save the rows that are shown, as measured data" }),
        this.recordButton, this.said),
      el("div", { class: "scope" },
        el("aside", { class: "stack" },
          el("h2", {}, "Channels"), this.search, this.list,
          el("h2", {}, "Cursors"),
          el("div", { class: "row" }, labelled("A", this.cursorA), button("set A", () => this.setCursor("A"), { title: "key a: at the pointer" })),
          el("div", { class: "row" }, labelled("B", this.cursorB), button("set B", () => this.setCursor("B"), { title: "key b: at the pointer" })),
          this.difference,
          el("details", {}, el("summary", {}, "Trigger"), this.trigger.root)),
        el("div", {},
          el("table", { class: "cursor-table", hidden: true },
            el("thead", {}, el("tr", {}, ...["channel", "at A", "at B", "B - A", "unit"].map((text) => el("th", { scope: "col" }, text)))), this.table),
          this.plots.root)),
    );
    this.plots.root.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.plots.root.addEventListener("dblclick", () => this.goLive());
    this.plots.root.addEventListener("mousemove", (event) => {
      this.pointer = this.timeAt(event);
    });
    this.plots.root.addEventListener("mouseleave", () => {
      this.pointer = null;
    });
  }

  cursorField(name) {
    return el("input", { type: "number", step: "any", "aria-label": `time of cursor ${name} [s]`, onchange: (event) => this.moveCursor(name, event.target.value === "" ? null : Number(event.target.value)) });
  }

  begin(hello) {
    const names = hello.channels.map(([name]) => name);
    const kept = (this.plots.names ?? []).filter((name) => names.includes(name));
    const first = names.filter((name) => FIRST.includes(name.split(".").slice(1).join(".")) || name.endsWith(".measured"));
    this.boxes = new Map(hello.channels.map(([name, unit]) => {
      const box = el("input", { type: "checkbox", value: name, onchange: () => this.rechoose() });
      box.checked = kept.length ? kept.includes(name) : first.slice(0, 8).includes(name);
      const row = el("label", { class: "channel" }, box, el("span", {}, name), el("span", { class: "quiet" }, shown(unit).symbol));
      return [name, { box, row }];
    }));
    this.list.replaceChildren(...[...this.boxes.values()].map(({ row }) => row));
    this.filter();
    this.rechoose();
    this.trigger.begin(hello);
    this.plots.cursors = {};
    this.goLive();
  }

  rechoose() {
    this.plots.choose([...this.boxes].filter(([, { box }]) => box.checked).map(([name]) => name));
    this.refresh();
  }

  filter() {
    const words = this.search.value.toLowerCase().split(/\s+/);
    for (const [name, { row }] of this.boxes ?? []) {
      row.hidden = !words.every((word) => name.toLowerCase().includes(word));
    }
  }

  show() {
    this.plots.resize();
    this.refresh();
  }

  refresh() {
    this.isDrawn = false;
  }

  goLive() {
    this.isLive = true;
    this.showPause();
  }

  toggle() {
    if (this.isLive) this.look(this.begin_s, this.end_s);
    else this.goLive();
  }

  showPause() {
    setText(this.pauseButton, this.isLive ? "Pause" : "Live");
    this.pauseButton.setAttribute("aria-pressed", String(!this.isLive));
    this.refresh();
  }

  // Stand still at a window of time.
  look(begin, end) {
    this.isLive = false;
    [this.begin_s, this.end_s] = [begin, end];
    this.showPause();
  }

  setSpan(span) {
    this.span = span;
    if (!this.isLive) this.look(this.end_s - span, this.end_s);
  }

  pauseAround(time) {
    this.look(time - 0.2 * this.span, time + 0.8 * this.span);
  }

  pan(share) {
    const step = share * (this.end_s - this.begin_s);
    this.look(this.begin_s + step, this.end_s + step);
  }

  scrollTo(share) {
    const { first, last } = this.model.store;
    if (share >= 1) {
      this.goLive();
      return;
    }
    const span = this.end_s - this.begin_s;
    const end = first + Math.min(span, last - first) + share * Math.max(0, last - first - span);
    this.look(end - span, end);
  }

  wheel(event) {
    const at = this.timeAt(event);
    if (at === null) return;
    event.preventDefault();
    const factor = event.deltaY > 0 ? 1.25 : 0.8;
    this.look(at + (this.begin_s - at) * factor, at + (this.end_s - at) * factor);
  }

  timeAt(event) {
    const over = event.target.closest?.(".u-over");
    if (!over) return null;
    const { left, width } = over.getBoundingClientRect();
    return this.begin_s + ((event.clientX - left) / width) * (this.end_s - this.begin_s);
  }

  key(event) {
    const acts = {
      " ": () => this.toggle(),
      a: () => this.setCursor("A"),
      b: () => this.setCursor("B"),
      ArrowLeft: () => this.pan(-0.1),
      ArrowRight: () => this.pan(0.1),
      l: () => this.goLive(),
      r: () => this.record(),
    };
    const isButton = event.target.tagName === "BUTTON" && event.key === " ";
    if (!acts[event.key] || isButton) return false;
    acts[event.key]();
    return true;
  }

  // Put a cursor at the pointer; without one in the plots, into the middle.
  setCursor(name) {
    if (this.isLive) this.look(this.begin_s, this.end_s);
    this.moveCursor(name, this.pointer ?? (this.begin_s + this.end_s) / 2);
  }

  moveCursor(name, time) {
    this.plots.cursors = { ...this.plots.cursors, [name]: time };
    const field = name === "A" ? this.cursorA : this.cursorB;
    field.value = time === null ? "" : time.toFixed(4);
    this.refresh();
  }

  draw() {
    const { store } = this.model;
    this.trigger.look(this.isLive);
    this.showRecording();
    if (this.isLive) {
      this.begin_s = Math.max(0, store.last - this.span);
      this.end_s = this.begin_s + this.span;
    }
    if (!this.isLive && this.isDrawn) return;
    this.plots.show(this.begin_s, this.end_s, this.isLive ? store.last : (this.pointer ?? this.end_s));
    this.isDrawn = !this.isLive && this.pointer == null;
    const room = store.last - store.first - (this.end_s - this.begin_s);
    if (document.activeElement !== this.scroll) {
      this.scroll.value = this.isLive || room <= 0 ? 1000 : (1000 * (this.begin_s - store.first)) / room;
    }
    this.drawCursors();
  }

  drawCursors() {
    const { A: a = null, B: b = null } = this.plots.cursors;
    this.table.closest("table").hidden = a === null && b === null;
    setText(this.difference, a !== null && b !== null ? `B - A = ${((b - a) * 1e3).toFixed(2)} ms` : "");
    if (a === null && b === null) return;
    const rows = this.plots.names.map((name) => {
      const unit = this.model.unit(name);
      const [va, vb] = [a, b].map((time) => (time === null ? NaN : this.model.store.at(name, time)));
      const cells = [va, vb, vb - va].map((value) => (Number.isFinite(value) ? valueText(value, unit) : "–"));
      return el("tr", {}, el("th", { scope: "row" }, name), ...cells.map((text) => el("td", { class: "figure" }, text)), el("td", {}, shown(unit).symbol));
    });
    this.table.replaceChildren(...rows);
  }

  savePicture() {
    const canvases = this.plots.panes.map(({ plot }) => plot.ctx.canvas);
    const whole = el("canvas", { width: Math.max(...canvases.map((each) => each.width)), height: canvases.reduce((sum, each) => sum + each.height, 0) });
    const context = whole.getContext("2d");
    context.fillStyle = getComputedStyle(document.body).backgroundColor;
    context.fillRect(0, 0, whole.width, whole.height);
    let top = 0;
    for (const canvas of canvases) {
      context.drawImage(canvas, 0, top);
      top += canvas.height;
    }
    whole.toBlob((blob) => download("scope.png", blob));
  }

  // Return the channels that are shown with their units, and the rows between the edges.
  shownRows() {
    const { store } = this.model;
    const channels = this.plots.names.map((name) => [name, this.model.unit(name)]);
    const columns = channels.map(([name]) => store.columns[store.number(name)]);
    return { channels, columns, from: store.find(this.begin_s), to: store.find(this.end_s + 1e-9) };
  }

  async saveMeasurement() {
    const { channels, columns, from, to } = this.shownRows();
    const width = 1 + channels.length;
    const rows = new Float64Array((to - from) * width);
    for (let row = from; row < to; row += 1) {
      const begin = (row - from) * width;
      rows[begin] = this.model.store.times[row];
      for (let i = 0; i < columns.length; i += 1) rows[begin + 1 + i] = columns[i][row];
    }
    const { name, bench } = this.model.hello ?? {};
    const head = `${JSON.stringify({ comment: `scope of ${name}, ${bench}`, channels })}\n`;
    try {
      download("scope.mf4", await this.model.link.post("mf4", new Blob([head, rows])));
      setText(this.said, "");
    } catch (error) {
      setText(this.said, error.message);
    }
  }

  async record() {
    const isRecording = Boolean(this.model.state.recording);
    const name = `recording-${new Date().toISOString().slice(0, 19).replaceAll(/[:T]/g, "-")}.mf4`;
    setText(this.said, isRecording ? "ends ..." : "begins ...");
    try {
      const found = await (isRecording ? this.model.request("stop_recording") : this.model.request("record", { file: name }));
      const lost = found.lost ? `, ${found.lost} messages left out` : "";
      setText(this.said, isRecording ? `${found.path}: ${found.rows} rows, ${found.frames} frames${lost} ${found.problem}` : found.path);
    } catch (error) {
      setText(this.said, error.message);
    }
  }

  showRecording() {
    const isRecording = Boolean(this.model.state.recording);
    setText(this.recordButton, isRecording ? "Stop recording" : "Record");
    this.recordButton.setAttribute("aria-pressed", String(isRecording));
  }

  saveTable() {
    const { store } = this.model;
    const { channels, columns, from, to } = this.shownRows();
    const quoted = (text) => (/[",\r\n]|^[=+@-]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const lines = [["time [s]", ...channels.map(([name, unit]) => `${name} [${unit}]`)].map(quoted).join(",")];
    for (let row = from; row < to; row += 1) {
      const values = columns.map((column) => column[row]);
      lines.push([store.times[row].toFixed(6), ...values.map((value) => (Number.isNaN(value) ? "" : value))].join(","));
    }
    download("scope.csv", new Blob([`${lines.join("\n")}\n`], { type: "text/csv" }));
  }
}

const EVENTS = [["fault", "a fault begins"], ["emcy", "an EMCY comes"], ["state", "a node changes its state"], ["mark", "a mark is set"]];
const CONDITIONS = [["rises", "rises above"], ["falls", "falls below"], ["above", "is above"], ["below", "is below"]];

// Stops the scope when a channel crosses a level or is beyond it, or when something happens.
class Trigger {
  constructor(model, fire) {
    this.model = model;
    this.fire = fire;
    this.seen = 0;
    this.channel = select([], { "aria-label": "channel of the trigger" });
    this.condition = select(CONDITIONS, { "aria-label": "condition of the trigger" });
    this.level = el("input", { type: "number", step: "any", value: 0, "aria-label": "level, in the unit shown" });
    this.armed = el("input", { type: "checkbox", onchange: () => this.arm() });
    this.root = el("div", { class: "stack" }, this.channel, this.condition, this.level, labelled("armed", this.armed));
  }

  begin(hello) {
    const names = [...EVENTS.map(([what, text]) => [`:${what}`, text]), ...hello.channels.map(([name, unit]) => [name, `${name} [${shown(unit).symbol}]`])];
    this.channel.replaceChildren(...names.map(([value, text]) => el("option", { value }, text)));
    this.armed.checked = false;
  }

  arm() {
    this.seen = this.model.store.last;
  }

  look(isLive) {
    const isEvent = this.channel.value.startsWith(":");
    this.condition.disabled = this.level.disabled = isEvent;
    if (!this.armed.checked || !isLive) return;
    const what = this.channel.value.slice(1);
    const time = isEvent ? this.model.events.find((each) => each.what === what && each.time > this.seen)?.time : this.crossing();
    if (!isEvent) this.seen = this.model.store.last;
    if (time === undefined) return;
    this.armed.checked = false;
    this.fire(time);
  }

  crossing() {
    const { store } = this.model;
    const number = store.number(this.channel.value);
    const level = Number(this.level.value) * shown(this.model.unit(this.channel.value)).factor;
    const sign = ["rises", "above"].includes(this.condition.value) ? 1 : -1;
    const isEdge = ["rises", "falls"].includes(this.condition.value);
    const column = store.columns[number];
    for (let row = Math.max(1, store.find(this.seen)); row < store.count; row += 1) {
      const isBeyond = sign * (column[row] - level) > 0;
      if (isBeyond && !(isEdge && sign * (column[row - 1] - level) > 0)) return store.times[row];
    }
    return undefined;
  }
}
