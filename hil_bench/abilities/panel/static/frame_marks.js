// The frames that the scope marks, faults and marks: as triangles, and as a list with what they say.

import { Decoder, hex } from "./decode.js";
import { button, el, setText } from "./dom.js";

const MOST = 500;
const SHOWN = 60;

export class FrameMarks {
  constructor(model, { onopen }) {
    this.model = model;
    this.onopen = onopen;
    this.decoder = new Decoder();
    this.marks = [];
    this.opened = null;
    this.drawn = "";
    this.body = el("tbody");
    this.summary = el("summary", {}, "Events in this window");
    const head = ["time [s]", "what", "identifier", "data", "meaning"].map((text) => el("th", { scope: "col" }, text));
    this.root = el("details", { class: "events", open: true }, this.summary,
      el("div", { class: "scroller short", tabindex: "0", role: "region", "aria-label": "events in this window" },
        el("table", {}, el("thead", {}, el("tr", {}, head)), this.body)));
    model.link.on("frame_marks", ({ frames }) => this.take(frames));
  }

  begin(hello) {
    this.decoder.begin(hello);
    this.marks = [];
    this.opened = null;
  }

  take(frames) {
    for (const [time, bus, way, id, data, isExtended, isRemote] of frames) {
      const frame = { time, bus, way, id, data, isExtended, isRemote };
      const use = this.decoder.use(frame);
      this.marks.push({ time, frame, use, meaning: this.decoder.meaning(frame), colour: use.endsWith("EMCY") ? "danger" : "accent" });
    }
    if (this.marks.length > MOST) this.marks.splice(0, this.marks.length - MOST);
  }

  // Open a mark: its row is shown and read out.
  open(mark) {
    this.opened = mark;
    this.root.open = true;
    this.drawn = "";
    this.draw(...this.window);
    const row = this.body.querySelector("[aria-current]");
    row?.scrollIntoView({ block: "nearest" });
    row?.querySelector("button").focus({ preventScroll: true });
  }

  draw(begin, end, faults, lines) {
    this.window = [begin, end, faults, lines];
    const isInside = ({ time }) => time >= begin && time <= end;
    const rows = [
      ...this.marks.filter(isInside),
      ...faults.filter((each) => each.begin >= begin).map(({ begin: time, text }) => ({ time, use: "fault", meaning: text })),
      ...lines.map(({ time, text }) => ({ time, use: "mark", meaning: text })),
    ].sort((a, b) => b.time - a.time);
    const state = JSON.stringify([rows.map(({ time, use, meaning }) => [time, use, meaning]), this.opened?.time]);
    if (state === this.drawn) return;
    this.drawn = state;
    setText(this.summary, `Events in this window: ${rows.length}`);
    this.body.replaceChildren(...rows.slice(0, SHOWN).map((mark) => this.row(mark)));
  }

  row(mark) {
    const { time, frame, use, meaning } = mark;
    const bus = frame?.bus ? `${frame.bus}:` : "";
    const cells = [frame ? bus + hex(frame.id, 3) : "", frame?.data.match(/../g)?.join(" ") ?? "", meaning];
    const isOpen = mark === this.opened;
    return el("tr", { class: use.endsWith("EMCY") || use === "fault" ? "loud" : "", "aria-current": isOpen ? "true" : null },
      el("td", { class: "figure" }, button(time.toFixed(4), () => this.onopen(mark), { title: "put cursor A there" })),
      el("td", {}, use), ...cells.map((text) => el("td", {}, text)));
  }
}
