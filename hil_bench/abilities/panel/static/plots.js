// A stack of plots with one time axis: a plot a unit, lowest and highest value a pixel column.

import { colour, el } from "./dom.js";
import { shown, valueText } from "./units.js";

const COLOURS = 8;
const NEAR = 8; // of a click to a marker [px]
const DIGIT = 8; // width of a digit of an axis [px]

export class Plots {
  constructor(model, { height = 200, onzoom = null, markers = () => [], onmarker = null } = {}) {
    this.model = model;
    this.height = height;
    this.onzoom = onzoom;
    this.markers = markers; // returns { time, colour } of each
    this.onmarker = onmarker;
    this.cursors = {};
    this.begin = 0;
    this.end = 1;
    this.gutter = 60;
    this.panes = [];
    this.names = [];
    this.root = el("div", { class: "plots" });
    new ResizeObserver(() => this.resize()).observe(this.root);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.choose(this.names));
  }

  choose(names) {
    this.names = names.filter((name) => this.model.store.number(name) >= 0);
    for (const pane of this.panes) pane.plot.destroy();
    this.gutter = 60;
    const groups = new Map();
    for (const name of this.names) {
      const unit = this.model.unit(name);
      groups.set(unit, [...(groups.get(unit) ?? []), name]);
    }
    this.panes = [...groups].map(([unit, channels], number) => this.pane(unit, channels, number === groups.size - 1));
    this.root.replaceChildren(...this.panes.map((pane) => pane.root));
  }

  pane(unit, channels, isLast) {
    const { symbol, factor, least } = shown(unit);
    const legend = channels.map((name, i) => {
      const value = el("span", { class: "figure legend-value" });
      const key = el("span", { class: isDashed(name) ? "key dashed" : "key", "data-colour": i % COLOURS });
      return { name, value, item: el("span", { class: "legend-item" }, key, name, value) };
    });
    const holder = el("div", { class: "plot" });
    const root = el("figure", {}, el("figcaption", {}, ...legend.map((each) => each.item), el("span", { class: "quiet" }, `[${symbol}]`)), holder);
    const axis = { stroke: colour("quiet"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("grid") }, font: "13px system-ui, sans-serif" };
    const plot = new uPlot(
      {
        width: Math.max(200, this.root.clientWidth),
        height: this.height + (isLast ? 30 : 0),
        padding: [10, 24, 4, 0],
        legend: { show: false },
        cursor: { sync: { key: `plots-${this.root.id}` }, drag: { x: Boolean(this.onzoom), y: false, setScale: false }, points: { show: false } },
        select: { show: Boolean(this.onzoom) },
        scales: {
          x: { time: false, range: () => [this.begin, this.end] },
          y: { range: (_, low, high) => spread(low, high, least) },
        },
        series: [{}, ...channels.map((name, i) => ({
          stroke: colour(`line-${i % COLOURS}`),
          width: 1.5,
          dash: isDashed(name) ? [6, 4] : undefined,
          points: { show: false },
          spanGaps: false,
        }))],
        axes: [
          // The grid is in all plots, the numbers are below the last one.
          { ...axis, size: isLast ? 36 : 6, values: (_, splits) => splits.map((each) => (isLast ? `${Number(each.toFixed(4))} s` : "")) },
          { ...axis, size: (_, values) => this.room(values), values: (_, splits) => splits.map((each) => String(Number(each.toFixed(6)))) },
        ],
        hooks: {
          drawClear: [(u) => this.shade(u), (u) => this.drawBands(u)],
          draw: [(u) => this.drawLimits(u), (u) => this.drawMarkers(u), (u) => this.drawMarks(u)],
          setSelect: [(u) => this.zoom(u)],
        },
      },
      [[], ...channels.map(() => [])],
      holder,
    );
    plot.over.addEventListener("click", (event) => this.pick(plot, event));
    return { root, plot, legend, unit, factor, symbol, numbers: channels.map((name) => this.model.store.number(name)) };
  }

  // Return the width of the value axes: that of the longest number so far, for all plots alike.
  room(values) {
    const longest = Math.max(0, ...(values ?? []).map((each) => each?.length ?? 0));
    this.gutter = Math.max(this.gutter, 18 + DIGIT * longest);
    return this.gutter;
  }

  zoom(plot) {
    const { left, width } = plot.select;
    if (width < 4 || !this.onzoom) return;
    const begin = plot.posToVal(left, "x");
    const end = plot.posToVal(left + width, "x");
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.onzoom(begin, end);
  }

  pick(plot, event) {
    if (!this.onmarker) return;
    const left = event.clientX - plot.over.getBoundingClientRect().left;
    const apart = ({ time }) => Math.abs(plot.valToPos(time, "x") - left);
    const nearest = this.markers().toSorted((a, b) => apart(a) - apart(b))[0];
    if (nearest && apart(nearest) < NEAR) this.onmarker(nearest);
  }

  // Show a window of time; `at` is the time whose values the legend shows.
  show(begin, end, at = end) {
    const { store } = this.model;
    [this.begin, this.end] = [begin, Math.max(end, begin + 1e-3)];
    for (const pane of this.panes) {
      const width = Math.max(100, Math.floor(pane.plot.bbox.width / devicePixelRatio));
      const factors = pane.numbers.map(() => pane.factor);
      pane.plot.setData(store.picture(pane.numbers, begin, end, width, factors));
      for (const { name, value } of pane.legend) {
        const text = valueText(store.at(name, at), pane.unit);
        if (value.textContent !== text) value.textContent = text;
      }
    }
  }

  resize() {
    const width = this.root.clientWidth;
    if (width < 50) return;
    for (const { plot } of this.panes) {
      if (plot.width !== width) plot.setSize({ width, height: plot.height });
    }
  }

  // Return the faults that are in the window: begin, end, words.
  faults() {
    return this.model.spans
      .map(({ kind, target, begin, end }) => ({ begin, end: end ?? this.model.time, text: `${kind} ${target}` }))
      .filter(({ begin, end }) => end >= this.begin && begin <= this.end);
  }

  // Return the bands that requirements have on the channels of a pane, in the unit that is shown.
  bands(pane) {
    const names = new Set(pane.legend.map(({ name }) => name));
    return (this.model.state.work?.margins ?? []).flatMap(({ id, margin, verdict, bands }) =>
      bands.filter(({ channel, begin, end }) => names.has(channel) && begin <= this.end && (end ?? Infinity) >= this.begin).map(({ channel, low, high, begin, end }) => ({
        id, channel,
        begin: Math.max(begin, this.begin),
        end: Math.min(end ?? Infinity, this.end),
        isBad: verdict === "failed" || (margin !== null && margin < 0),
        low: low === null ? null : low / pane.factor,
        high: high === null ? null : high / pane.factor,
      })));
  }

  shade(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.fillStyle = colour("shade");
    for (const { begin, end } of this.faults()) {
      const left = plot.valToPos(Math.max(begin, this.begin), "x", true);
      const right = plot.valToPos(Math.min(end, this.end), "x", true);
      ctx.fillRect(left, bbox.top, Math.max(2, right - left), bbox.height);
    }
    ctx.restore();
  }

  // Shade what requirements allow, and draw its edges with the name of the requirement.
  drawBands(plot) {
    const pane = this.panes.find((each) => each.plot === plot);
    if (!pane) return;
    const { ctx, bbox } = plot;
    const bottom = bbox.top + bbox.height;
    const within = (value) => Math.min(bottom, Math.max(bbox.top, plot.valToPos(value, "y", true)));
    ctx.save();
    ctx.textAlign = "left";
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    for (const { id, low, high, isBad, begin, end } of this.bands(pane)) {
      const [left, right] = [begin, end].map((time) => plot.valToPos(time, "x", true));
      const [top, base] = [high === null ? bbox.top : within(high), low === null ? bottom : within(low)];
      ctx.fillStyle = ctx.strokeStyle = colour(isBad ? "danger" : "good");
      ctx.globalAlpha = 0.1;
      ctx.fillRect(left, top, right - left, base - top);
      ctx.globalAlpha = 1;
      ctx.setLineDash([8 * devicePixelRatio, 6 * devicePixelRatio]);
      for (const [edge, isThere] of [[top, high !== null], [base, low !== null]]) {
        if (!isThere || edge <= bbox.top || edge >= bottom) continue;
        ctx.beginPath();
        ctx.moveTo(left, edge);
        ctx.lineTo(right, edge);
        ctx.stroke();
        ctx.fillText(id, left + 6 * devicePixelRatio, edge - 4 * devicePixelRatio);
      }
    }
    ctx.restore();
  }

  // Draw the limits of the channels of a plot, dashed.
  drawLimits(plot) {
    const pane = this.panes.find((each) => each.plot === plot);
    const limits = this.model.state.work?.limits ?? {};
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.strokeStyle = colour("danger");
    ctx.lineWidth = 2 * devicePixelRatio;
    ctx.setLineDash([8 * devicePixelRatio, 6 * devicePixelRatio]);
    for (const level of this.levels(pane, limits)) {
      const y = plot.valToPos(level, "y", true);
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  }

  levels(pane, limits = this.model.state.work?.limits ?? {}) {
    return new Set((pane?.legend ?? []).flatMap(({ name }) => limits[name] ?? []).map((level) => level / pane.factor));
  }

  // Draw a triangle at the top for each frame that is marked.
  drawMarkers(plot) {
    const { ctx, bbox } = plot;
    const half = 5 * devicePixelRatio;
    ctx.save();
    for (const { time, colour: name } of this.markers()) {
      if (time < this.begin || time > this.end) continue;
      const x = plot.valToPos(time, "x", true);
      ctx.fillStyle = colour(name);
      ctx.beginPath();
      ctx.moveTo(x - half, bbox.top);
      ctx.lineTo(x + half, bbox.top);
      ctx.lineTo(x, bbox.top + 2 * half);
      ctx.fill();
    }
    ctx.restore();
  }

  // Return the vertical lines of the window: marks and cursors.
  lines() {
    const lines = this.model.marks.map(({ time, fields }) => ({ time, text: fields.text, colour: "quiet" }));
    for (const [text, time] of Object.entries(this.cursors)) lines.push({ time, text, colour: "accent" });
    return lines.filter(({ time }) => time !== null && time >= this.begin && time <= this.end);
  }

  drawMarks(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.textAlign = "left";
    ctx.font = `${13 * devicePixelRatio}px system-ui, sans-serif`;
    for (const { time, text, colour: name } of this.lines()) {
      const x = Math.round(plot.valToPos(time, "x", true));
      ctx.fillStyle = colour(name);
      ctx.fillRect(x, bbox.top, devicePixelRatio, bbox.height);
      ctx.fillText(text, x + 4 * devicePixelRatio, bbox.top + 13 * devicePixelRatio);
    }
    ctx.restore();
  }
}

function spread(low, high, least) {
  if (low === null || high === null || !Number.isFinite(low)) return [0, least];
  const margin = Math.max((high - low) * 0.08, (least - (high - low)) / 2, 0);
  return [low - margin, high + margin];
}

// Set-points, and what a twin says, beside what is measured.
export function isDashed(name) {
  return name.includes("setpoint") || name.endsWith("_twin");
}
