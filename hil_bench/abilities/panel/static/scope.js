// The scope: channels against time, live or paused, with zoom, trigger, cursors and export.

import { button, el, labelled, select, setText } from "./dom.js";
import { FrameMarks } from "./frame_marks.js";
import { Plots } from "./plots.js";
import { ScopeFiles } from "./scope_files.js";
import { Trigger } from "./trigger.js";
import { shown, valueText } from "./units.js";

const SPANS = [0.5, 1, 2, 5, 10, 30, 60, 120];
const MOST_LISTED = 300; // channels in the list at a time
const FIRST = ["position", "P_A", "P_B", "spool_setpoint", "spool_position"];

export class ScopeView {
  constructor(root, model) {
    this.model = model;
    this.isLive = true;
    this.behind = 0; // how far a window that goes on is behind the newest row [s]
    this.span = 10;
    this.begin_s = 0;
    this.end_s = 10;
    this.marks = new FrameMarks(model, { onopen: (mark) => this.openMark(mark) });
    this.plots = new Plots(model, {
      height: 210,
      onzoom: (begin, end) => this.look(begin, end),
      markers: () => (this.wantsMarks.checked ? this.marks.marks : []),
      onmarker: (mark) => this.openMark(mark),
    });
    this.plots.root.id = "scope-plots";
    this.search = el("input", { type: "search", placeholder: "search channels", "aria-label": "search channels", oninput: () => this.filter() });
    this.list = el("div", { class: "channel-list" });
    this.more = el("p", { class: "quiet" });
    this.wantsMarks = el("input", { type: "checkbox", checked: true, onchange: () => this.wantMarks() });
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
    this.files = new ScopeFiles(this);
    this.trigger = new Trigger(model, (time) => this.pauseAround(time));
    root.append(
      el("div", { class: "toolbar" }, this.pauseButton,
        button("◀", () => this.pan(-0.25), { "aria-label": "earlier", title: "arrow left" }),
        button("▶", () => this.pan(0.25), { "aria-label": "later", title: "arrow right" }),
        labelled("show", this.spans), this.scroll,
        button("PNG", () => this.files.savePicture("png"), { title: "save the picture with title, legend, units and cursors" }),
        button("SVG", () => this.files.savePicture("svg"), { title: "save the same picture as a drawing" }),
        button("CSV", () => this.files.saveTable(), { title: "save the rows that are shown, in the units that are shown" }),
        button("MF4", () => this.files.saveMeasurement(), { title: "save the rows that are shown as measured data, in SI units" }),
        this.recordButton, this.said),
      el("div", { class: "scope" },
        el("aside", { class: "stack" },
          el("h2", {}, "Channels"), this.search, this.list, this.more,
          labelled("mark EMCY, NMT and changes of state", this.wantsMarks),
          el("h2", {}, "Cursors"),
          el("div", { class: "row" }, labelled("A", this.cursorA), button("set A", () => this.setCursor("A"), { title: "key a: at the pointer" })),
          el("div", { class: "row" }, labelled("B", this.cursorB), button("set B", () => this.setCursor("B"), { title: "key b: at the pointer" })),
          this.difference,
          el("details", {}, el("summary", {}, "Trigger"), this.trigger.root)),
        el("div", {},
          this.plots.root,
          el("table", { class: "cursor-table", hidden: true },
            el("thead", {}, el("tr", {}, ...["channel", "at A", "at B", "B \u2212 A", "unit"].map((text) => el("th", { scope: "col" }, text)))), this.table),
          this.marks.root)),
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
    this.listChannels(hello);
    this.marks.begin(hello);
    this.plots.cursors = {};
    this.goLive();
    if (this.isShown) this.wantMarks();
  }

  // Show all in other units; the window and the cursors stay.
  changeUnits(hello) {
    if (hello) this.listChannels(hello);
  }

  listChannels(hello) {
    const names = hello.channels.map(([name]) => name);
    const kept = (this.plots.names ?? []).filter((name) => names.includes(name));
    const first = names.filter((name) => FIRST.includes(name.split(".").slice(1).join(".")) || name.endsWith(".measured"));
    this.chosen = new Set(kept.length ? kept : (first.length ? first : names).slice(0, 8));
    this.trigger.begin(hello);
    this.filter();
    this.rechoose();
  }

  rechoose() {
    const names = (this.model.hello?.channels ?? []).map(([name]) => name);
    this.plots.choose(names.filter((name) => this.chosen.has(name)));
    this.refresh();
  }

  // List the channels that fit the search: those that are shown first where there are too many.
  filter() {
    const words = this.search.value.toLowerCase().split(/\s+/);
    const found = (this.model.hello?.channels ?? []).filter(([name]) => words.every((word) => name.toLowerCase().includes(word)));
    const isMany = found.length > MOST_LISTED;
    const listed = isMany ? [...found.filter(([name]) => this.chosen.has(name)), ...found.filter(([name]) => !this.chosen.has(name))] : found;
    this.list.replaceChildren(...listed.slice(0, MOST_LISTED).map(([name, unit]) => this.channelRow(name, unit)));
    this.more.hidden = !isMany;
    setText(this.more, isMany ? `${found.length - MOST_LISTED} more channels; search for them` : "");
  }

  channelRow(name, unit) {
    const box = el("input", { type: "checkbox", value: name, onchange: () => {
      if (box.checked) this.chosen.add(name);
      else this.chosen.delete(name);
      this.rechoose();
    } });
    box.checked = this.chosen.has(name);
    return el("label", { class: "channel" }, box, el("span", {}, name), el("span", { class: "quiet" }, shown(unit).symbol));
  }

  show() {
    this.isShown = true;
    this.plots.resize();
    this.refresh();
    this.wantMarks();
  }

  hide() {
    this.isShown = false;
    this.wantMarks();
  }

  // Ask for the frames that are marked only while somebody sees them.
  wantMarks() {
    const wants = this.isShown && this.wantsMarks.checked;
    this.model.request("want", { marks: wants }).catch(() => {});
    this.refresh();
  }

  // Show what a mark says, with cursor A at its time.
  openMark(mark) {
    const half = (this.end_s - this.begin_s) / 2;
    const isInside = mark.time >= this.begin_s && mark.time <= this.end_s;
    if (isInside) this.look(this.begin_s, this.end_s);
    else this.look(mark.time - half, mark.time + half);
    this.moveCursor("A", mark.time);
    this.marks.open(mark);
  }

  refresh() {
    this.isDrawn = false;
  }

  goLive() {
    this.isLive = true;
    this.behind = 0;
    this.showPause();
  }

  // A pause is drawn at once, so that nothing that comes later gets into the picture.
  toggle() {
    if (this.isLive) this.look(this.begin_s, this.end_s);
    else this.goLive();
    this.draw();
  }

  showPause() {
    setText(this.pauseButton, this.isLive ? "Pause" : "Live");
    setText(this.said, this.isLive && this.behind ? `${this.behind.toFixed(1)} s behind, and goes on` : "");
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

  // Move the window; one that goes on goes on from there, so many seconds behind.
  pan(share) {
    const step = share * (this.end_s - this.begin_s);
    if (!this.isLive) {
      this.look(this.begin_s + step, this.end_s + step);
      return;
    }
    this.fallBehind(this.behind - step);
  }

  fallBehind(time) {
    const { first, last } = this.model.store;
    this.behind = Math.min(Math.max(0, time), Math.max(0, last - first - this.span));
    this.showPause();
  }

  scrollTo(share) {
    const { first, last } = this.model.store;
    if (share >= 1) {
      this.goLive();
      return;
    }
    const span = this.end_s - this.begin_s;
    const end = first + Math.min(span, last - first) + share * Math.max(0, last - first - span);
    if (this.isLive) this.fallBehind(last - end);
    else this.look(end - span, end);
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
      this.begin_s = Math.max(0, store.last - this.behind - this.span);
      this.end_s = this.begin_s + this.span;
    }
    if (!this.isLive && this.isDrawn) return;
    this.plots.show(this.begin_s, this.end_s, this.isLive ? Math.min(store.last, this.end_s) : (this.pointer ?? this.end_s));
    this.isDrawn = !this.isLive && this.pointer == null;
    const room = store.last - store.first - (this.end_s - this.begin_s);
    if (document.activeElement !== this.scroll) {
      this.scroll.value = (this.isLive && !this.behind) || room <= 0 ? 1000 : (1000 * (this.begin_s - store.first)) / room;
    }
    this.drawCursors();
    this.marks.draw(this.begin_s, this.end_s, this.plots.faults(), this.model.marks.filter(({ time }) => time >= this.begin_s && time <= this.end_s).map(({ time, fields }) => ({ time, text: fields.text })));
  }

  drawCursors() {
    const { A: a = null, B: b = null } = this.plots.cursors;
    this.table.closest("table").hidden = a === null && b === null;
    setText(this.difference, a !== null && b !== null ? `B \u2212 A = ${((b - a) * 1e3).toFixed(2)} ms` : "");
    if (a === null && b === null) return;
    const rows = this.plots.names.map((name) => {
      const unit = this.model.unit(name);
      const [va, vb] = [a, b].map((time) => (time === null ? NaN : this.model.store.at(name, time)));
      const cells = [va, vb, vb - va].map((value) => (Number.isFinite(value) ? valueText(value, unit) : "–"));
      return el("tr", {}, el("th", { scope: "row" }, name), ...cells.map((text) => el("td", { class: "figure" }, text)), el("td", {}, shown(unit).symbol));
    });
    this.table.replaceChildren(...rows);
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
}
