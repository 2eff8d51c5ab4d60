// Parts of the page for work: margins of requirements, their distribution, a search, runs that failed.

import { button, el, setText, svg } from "./dom.js";
import { ticks } from "./picture.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, BASE] = [620, 170, 72, 26, 24];
const percent = (share) => `${Number((100 * share).toPrecision(3))} %`.replace("-", "\u2212");

// The margin of each requirement so far: a bar that is red where it is used up.
export class Margins {
  constructor() {
    this.body = el("tbody");
    this.root = el("table", { class: "margins", hidden: true },
      el("thead", {}, el("tr", {}, ...["requirement", "so far", "margin", "", ""].map((text) => el("th", { scope: "col" }, text)))), this.body);
  }

  show(margins) {
    this.root.hidden = margins.length === 0;
    this.body.replaceChildren(...margins.map(({ id, verdict, margin, text }) => {
      const isBad = verdict === "failed" || (margin !== null && margin < 0);
      const word = verdict || (margin === null ? "open" : isBad ? "violated" : "holds");
      return el("tr", { class: isBad ? "loud" : "" }, el("th", { scope: "row" }, id), el("td", { class: isBad ? "word bad" : "word" }, word),
        el("td", { class: "figure" }, margin === null ? "" : percent(margin)), el("td", {}, bar(id, margin)), el("td", {}, text));
    }));
  }
}

function bar(id, margin) {
  if (margin === null) return null;
  const width = Math.max(4, 50 * Math.min(1, Math.abs(margin))); // a small violation is seen, too
  const x = margin < 0 ? 50 - width : 50;
  return svg("svg", { viewBox: "0 0 100 12", class: "margin-bar", role: "img", "aria-label": `margin of ${id}: ${percent(margin)} of the tolerance` },
    svg("rect", { x, width, y: 2, height: 8, class: margin < 0 ? "bar-bad" : "bar-good" }), svg("line", { x1: 50, x2: 50, y1: 0, y2: 12, class: "scale" }));
}

// Histograms of margins: what lies beyond the bins stands beside them, in words and as a bar.
export class Histograms {
  constructor() {
    this.root = el("div", {});
  }

  show(histograms) {
    this.root.replaceChildren(...histograms.map((each) => el("figure", {}, el("figcaption", {}, `${each.name}: margins of ${total(each)} runs`), this.draw(each))));
  }

  draw({ name, low, high, counts, below, above }) {
    const bins = [...(below ? [[below, true]] : []), ...counts.map((count, i) => [count, low + (i * (high - low)) / counts.length < -1e-9]), ...(above ? [[above, false]] : [])];
    const most = Math.max(1, ...bins.map(([count]) => count));
    const width = (WIDTH - LEFT - RIGHT) / bins.length;
    const y = (count) => HEIGHT - BASE - ((HEIGHT - BASE - 12) * count) / most;
    const place = (share) => LEFT + width * ((below ? 1 : 0) + ((share - low) / (high - low)) * counts.length);
    const bars = bins.map(([count, isBad], i) => {
      const isBeyond = (below && i === 0) || (above && i === bins.length - 1);
      const height = count ? Math.max(3, HEIGHT - BASE - y(count)) : 0; // one run of thousands is seen, too
      return svg("rect", { x: LEFT + i * width + 1, width: Math.max(1, width - 2), y: HEIGHT - BASE - height, height, class: `${isBad ? "bar-bad" : "bar-good"}${isBeyond ? " beyond" : ""}` });
    });
    const numbers = ticks(low, high, 6).map((share) => label(place(share), HEIGHT - 6, percent(share)));
    const heights = ticks(0, most, 3).filter(Number.isInteger).map((count) => label(LEFT - 6, y(count) + 4, String(count), "end"));
    const ends = [below ? label(LEFT, 12, `${below} below ${percent(low)}`, "start") : null, above ? label(WIDTH - RIGHT, 12, `${above} above ${percent(high)}`, "end") : null];
    return svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "chart", role: "img", "aria-label": `distribution of the margins of ${name}, in % of the tolerance` },
      bars, svg("line", { x1: place(0), x2: place(0), y1: 0, y2: HEIGHT - BASE, class: "scale" }), numbers, heights, ends);
  }
}

function total({ counts, below, above }) {
  return counts.reduce((sum, count) => sum + count, below + above);
}

function label(x, y, words, anchor = "middle") {
  return svg("text", { x, y, class: "tick", "text-anchor": anchor }, words);
}

// The best margin so far of a search, as steps over its runs.
export class Courses {
  constructor() {
    this.root = el("div", {});
  }

  show(courses) {
    this.root.replaceChildren(...courses.map((each) => {
      const [, best] = each.points.at(-1);
      return el("figure", {}, el("figcaption", {}, `${each.name}: best so far ${percent(best)} of the tolerance`), this.draw(each));
    }));
  }

  draw({ name, points }) {
    const margins = points.map(([, margin]) => margin);
    const [low, high] = [Math.min(0, ...margins), Math.max(0, ...margins) || 1];
    const last = Math.max(1, points.at(-1)[0]);
    const x = (run) => LEFT + ((WIDTH - LEFT - RIGHT) * run) / last;
    const y = (margin) => HEIGHT - BASE - ((HEIGHT - BASE - 12) * (margin - low)) / (high - low || 1);
    const steps = points.map(([run, margin], i) => (i ? `H${x(run)}V${y(margin)}` : `M${x(run)} ${y(margin)}`)).join("");
    const numbers = ticks(0, last, 5).map((run) => label(x(run), HEIGHT - 6, String(run)));
    const heights = ticks(low, high, 4).map((margin) => label(LEFT - 6, y(margin) + 4, percent(margin), "end"));
    return svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "chart", role: "img", "aria-label": `best margin of ${name} so far over runs` },
      svg("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y(0), y2: y(0), class: "limit" }), svg("path", { d: steps, class: "load-line" }), numbers, heights);
  }
}

// The runs that failed, the worst first; a button plays one again and shows what went wrong.
export class Failures {
  constructor(model) {
    this.model = model;
    this.body = el("tbody");
    this.shown = el("div", { role: "status", class: "result" });
    this.table = el("table", {}, el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "run that failed"), el("th", { scope: "col" }, "why"), el("th", { scope: "col" }, "again"))), this.body);
    this.root = el("div", { hidden: true }, el("h2", {}, "Failures, the worst first"),
      el("div", { class: "scroller short", tabindex: "0", role: "region", "aria-label": "runs that failed" }, this.table), this.shown);
    this.listed = "";
  }

  begin() {
    this.shown.replaceChildren();
  }

  show(failures) {
    this.root.hidden = failures.length === 0;
    const keys = failures.map(({ key }) => key).join();
    if (keys === this.listed) return;
    this.listed = keys;
    const canReplay = Boolean(this.model.hello?.work?.again?.length);
    this.body.replaceChildren(...failures.map((failure) => el("tr", {}, el("th", { scope: "row" }, failure.name), el("td", {}, failure.text),
      el("td", {}, canReplay ? button("Replay", () => this.replay(failure), { title: failure.command }) : el("code", {}, failure.command)))));
  }

  async replay({ key, name, command }) {
    this.shown.replaceChildren(el("p", {}, `${name} is played again ...`));
    try {
      const { run, picture } = await this.model.request("replay", { key });
      const findings = run.verdicts.map(({ id, outcome, reason }) => el("p", { class: outcome === "failed" ? "bad" : "" }, `${id} ${outcome}: ${reason}`));
      const image = picture ? el("img", { src: picture, class: "wide", alt: `the requirement of ${name} with the smallest margin, over time` }) : null;
      this.shown.replaceChildren(el("h3", {}, name), ...[run.problem].filter(Boolean).map((text) => el("p", { class: "problem" }, text)), ...findings, image ?? "", el("p", { class: "quiet" }, `again in a shell: ${command}`));
    } catch (error) {
      this.shown.replaceChildren(el("p", { class: "problem" }, error.message));
    }
  }
}

// Return a time in words: 95 s as 1 min 35 s.
export function timeText(seconds) {
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

export function showProgress(element, { total, done, unit, left }) {
  const count = total ? `${done} of ${total} ${unit}`.trim() : "";
  setText(element, [count, left ? `about ${timeText(left)} left` : ""].filter(Boolean).join(" · "));
}
