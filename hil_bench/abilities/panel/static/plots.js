// A stack of plots with one time axis: a plot a unit, lowest and highest value a pixel column.

import { colour, el } from "./dom.js";
import { shown, valueText } from "./units.js";

const COLOURS = 8;

export class Plots {
  constructor(model, { height = 200, onzoom = null } = {}) {
    this.model = model;
    this.height = height;
    this.onzoom = onzoom;
    this.cursors = {};
    this.begin = 0;
    this.end = 1;
    this.panes = [];
    this.names = [];
    this.root = el("div", { class: "plots" });
    new ResizeObserver(() => this.resize()).observe(this.root);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.choose(this.names));
  }

  choose(names) {
    this.names = names.filter((name) => this.model.store.number(name) >= 0);
    for (const pane of this.panes) pane.plot.destroy();
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
      const value = el("output", { class: "figure" });
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
          { ...axis, show: isLast, size: 36, values: (_, splits) => splits.map((each) => `${Number(each.toFixed(4))} s`) },
          { ...axis, size: 60, values: (_, splits) => splits.map((each) => String(Number(each.toFixed(6)))) },
        ],
        hooks: {
          drawClear: [(u) => this.shade(u)],
          draw: [(u) => this.drawLimits(u), (u) => this.drawMarks(u)],
          setSelect: [(u) => this.zoom(u)],
        },
      },
      [[], ...channels.map(() => [])],
      holder,
    );
    return { root, plot, legend, unit, factor, numbers: channels.map((name) => this.model.store.number(name)) };
  }

  zoom(plot) {
    const { left, width } = plot.select;
    if (width < 4 || !this.onzoom) return;
    const begin = plot.posToVal(left, "x");
    const end = plot.posToVal(left + width, "x");
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.onzoom(begin, end);
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

  shade(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.fillStyle = colour("shade");
    for (const { begin, end } of this.model.spans) {
      const last = end ?? this.model.time;
      if (last < this.begin || begin > this.end) continue;
      const left = plot.valToPos(Math.max(begin, this.begin), "x", true);
      const right = plot.valToPos(Math.min(last, this.end), "x", true);
      ctx.fillRect(left, bbox.top, Math.max(2, right - left), bbox.height);
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
    const levels = new Set((pane?.legend ?? []).flatMap(({ name }) => limits[name] ?? []));
    for (const level of levels) {
      const y = plot.valToPos(level / pane.factor, "y", true);
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  }

  drawMarks(plot) {
    const lines = this.model.marks.map(({ time, fields }) => [time, fields.text, "quiet"]);
    for (const [name, time] of Object.entries(this.cursors)) lines.push([time, name, "accent"]);
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.font = `${13 * devicePixelRatio}px system-ui, sans-serif`;
    for (const [time, text, name] of lines) {
      if (time === null || time < this.begin || time > this.end) continue;
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
function isDashed(name) {
  return name.includes("setpoint") || name.endsWith("_twin");
}
