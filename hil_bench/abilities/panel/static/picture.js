// The scope as a picture that stands alone: title, legend, units, cursors, faults, bands, as SVG or PNG.

import { colour, svg } from "./dom.js";
import { isDashed } from "./plots.js";
import { shown, valueText } from "./units.js";

const [WIDTH, LEFT, RIGHT] = [1200, 84, 24];
const [TITLE, LEGEND, PANE, GAP, LINE] = [64, 26, 200, 14, 22];
const INNER = WIDTH - LEFT - RIGHT;
const COLOURS = 8;
const COLUMNS = 900; // pixel columns of a curve
const LETTER = 7.6; // width of a letter of a legend [px]

// Return the plots as they are, as an SVG element.
export function drawPicture(plots, { title, foot }) {
  const { begin, end } = plots;
  const x = (time) => LEFT + (INNER * (time - begin)) / (end - begin);
  const parts = [text(LEFT, 28, title, { "font-size": 19, "font-weight": 600 })];
  parts.push(text(LEFT, 50, `${begin.toFixed(3)} s to ${end.toFixed(3)} s of bench time`, { fill: colour("quiet") }));
  let top = TITLE;
  for (const pane of plots.panes) {
    const legend = legendOf(plots, pane);
    top += LEGEND * legend.rows;
    parts.push(...legend.draw(top));
    parts.push(...drawPane(plots, pane, x, top, pane === plots.panes.at(-1)));
    top += PANE + GAP;
  }
  top += 30;
  for (const line of foot) {
    parts.push(text(LEFT, (top += LINE), line, { fill: colour("quiet") }));
  }
  return svg("svg", {
    xmlns: "http://www.w3.org/2000/svg", viewBox: `0 0 ${WIDTH} ${top + 16}`, width: WIDTH, height: top + 16,
    "font-family": "system-ui, 'DejaVu Sans', sans-serif", "font-size": 13,
  }, el("title", title), rect(0, 0, WIDTH, top + 16, { fill: colour("back") }), parts);
}

export function svgFile(picture) {
  return new Blob([new XMLSerializer().serializeToString(picture)], { type: "image/svg+xml" });
}

// Return the picture as a PNG file of twice its size.
export async function pngFile(picture) {
  const url = URL.createObjectURL(svgFile(picture));
  try {
    const image = new Image();
    image.src = url;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [2 * image.width, 2 * image.height];
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((done) => canvas.toBlob(done));
  } finally {
    URL.revokeObjectURL(url);
  }
}

// Return the rows that are shown as CSV in the units that are shown, each named in the head.
export function csvFile({ channels, columns, from, to, times }) {
  const quoted = (cell) => (/[",\r\n]|^[=+@-]/.test(cell) ? `"${cell.replaceAll('"', '""')}"` : cell);
  const ways = channels.map(([, unit]) => shown(unit));
  const lines = [["time [s]", ...channels.map(([name], i) => `${name} [${ways[i].symbol}]`)].map(quoted).join(",")];
  for (let row = from; row < to; row += 1) {
    // The page holds values in single precision: nine digits have all of it.
    const values = columns.map((column, i) => (Number.isFinite(column[row]) ? Number((column[row] / ways[i].factor).toPrecision(9)) : ""));
    lines.push([times[row].toFixed(6), ...values].join(","));
  }
  return new Blob([`${lines.join("\n")}\n`], { type: "text/csv" });
}

function legendOf(plots, pane) {
  const { A = null, B = null } = plots.cursors;
  const places = [];
  let [left, rows] = [LEFT, 1];
  const entries = pane.legend.map(({ name }, i) => {
    const at = (time) => valueText(plots.model.store.at(name, time), pane.unit);
    const values = [["A", A], ["B", B]].filter(([, time]) => time !== null).map(([cursor, time]) => `${cursor} ${at(time)}`);
    return { words: `${name} [${pane.symbol}]${values.length ? `  ${values.join(", ")}` : ""}`, number: i, dashed: isDashed(name) };
  });
  for (const entry of entries) {
    const width = 46 + LETTER * entry.words.length;
    if (left + width > WIDTH - RIGHT && left > LEFT) [left, rows] = [LEFT, rows + 1];
    places.push({ ...entry, left, row: rows });
    left += width;
  }
  const draw = (top) => places.flatMap(({ words, number, dashed, left: at, row }) => {
    const y = top - LEGEND * (rows - row) - 8;
    return [line(at, y - 4, at + 22, y - 4, { stroke: colour(`line-${number % COLOURS}`), "stroke-width": 3, "stroke-dasharray": dashed ? "6 4" : null }), text(at + 28, y, words)];
  });
  return { rows, draw };
}

function drawPane(plots, pane, x, top, isLast) {
  const { begin, end, model } = plots;
  const { min, max } = pane.plot.scales.y;
  const y = (value) => top + PANE - (PANE * (value - min)) / (max - min);
  const clamp = (value) => Math.min(top + PANE, Math.max(top, y(value)));
  const parts = [];
  for (const fault of plots.faults()) {
    const [left, right] = [x(Math.max(fault.begin, begin)), x(Math.min(fault.end, end))];
    parts.push(rect(left, top, Math.max(2, right - left), PANE, { fill: colour("danger"), "fill-opacity": 0.14 }, el("title", fault.text)));
    if (pane === plots.panes[0]) parts.push(text(left + 4, top + PANE - 6, fault.text, { fill: colour("danger"), "font-size": 12 }));
  }
  for (const { id, low, high, isBad, begin: from, end: to } of plots.bands(pane)) {
    const [above, below] = [high === null ? top : clamp(high), low === null ? top + PANE : clamp(low)];
    const paint = colour(isBad ? "danger" : "good");
    parts.push(rect(x(from), above, x(to) - x(from), Math.max(0, below - above), { fill: paint, "fill-opacity": 0.1 }));
    for (const limit of [low, high].filter((each) => each !== null && each > min && each < max)) {
      parts.push(line(x(from), y(limit), x(to), y(limit), { stroke: paint, "stroke-dasharray": "8 6" }), text(x(from) + 6, y(limit) - 4, id, { fill: paint, "font-size": 12 }));
    }
  }
  for (const value of ticks(min, max, 5)) {
    parts.push(line(LEFT, y(value), LEFT + INNER, y(value), { stroke: colour("grid") }));
    parts.push(text(LEFT - 8, y(value) + 4, String(Number(value.toFixed(9))).replace("-", "\u2212"), { "text-anchor": "end", fill: colour("quiet") }));
  }
  for (const time of ticks(begin, end, 8)) {
    parts.push(line(x(time), top, x(time), top + PANE, { stroke: colour("grid") }));
    if (isLast) parts.push(text(x(time), top + PANE + 20, `${Number(time.toFixed(6))} s`, { "text-anchor": "middle", fill: colour("quiet") }));
  }
  parts.push(rect(LEFT, top, INNER, PANE, { fill: "none", stroke: colour("edge") }));
  parts.push(text(0, 0, `[${pane.symbol}]`, { transform: `translate(20 ${top + PANE / 2}) rotate(-90)`, "text-anchor": "middle" }));
  for (const level of plots.levels(pane)) {
    if (level > min && level < max) parts.push(line(LEFT, y(level), LEFT + INNER, y(level), { stroke: colour("danger"), "stroke-width": 2, "stroke-dasharray": "8 6" }));
  }
  const [times, ...curves] = model.store.picture(pane.numbers, begin, end, COLUMNS, pane.numbers.map(() => pane.factor));
  curves.forEach((values, i) => {
    const attributes = { fill: "none", stroke: colour(`line-${i % COLOURS}`), "stroke-width": 1.5, "stroke-dasharray": isDashed(pane.legend[i].name) ? "6 4" : null };
    parts.push(svg("path", { d: path(times, values, (time) => Math.min(LEFT + INNER, Math.max(LEFT, x(time))), clamp), ...attributes }));
  });
  for (const { time, text: words, colour: name } of plots.lines()) {
    parts.push(line(x(time), top, x(time), top + PANE, { stroke: colour(name) }));
    if (pane === plots.panes[0]) parts.push(text(x(time) + 4, top + 13, words, { fill: colour(name) }));
  }
  for (const { time, colour: name, use, meaning } of plots.markers()) {
    if (time < begin || time > end) continue;
    parts.push(svg("path", { d: `M${x(time) - 5} ${top}h10l-5 9z`, fill: colour(name) }, el("title", `${use} ${meaning}`)));
  }
  return parts;
}

// Return the path of a curve; where a value is missing, it is interrupted.
function path(times, values, x, y) {
  let words = "";
  let isDown = false;
  values.forEach((value, i) => {
    if (value === null) {
      isDown = false;
      return;
    }
    words += `${isDown ? "L" : "M"}${x(times[i]).toFixed(1)} ${y(value).toFixed(1)}`;
    isDown = true;
  });
  return words;
}

// Return round numbers between two.
export function ticks(low, high, count) {
  const raw = (high - low) / count;
  if (!(raw > 0) || !Number.isFinite(raw)) return [];
  const size = 10 ** Math.floor(Math.log10(raw));
  const step = size * ([1, 2, 5].find((each) => each * size >= raw) ?? 10);
  const first = Math.ceil(low / step);
  return Array.from({ length: Math.max(0, Math.floor(high / step) - first + 1) }, (_, i) => (first + i) * step);
}

const el = (tag, words) => svg(tag, {}, words);
const text = (x, y, words, attributes = {}) => svg("text", { x, y, fill: colour("text"), ...attributes }, words);
const line = (x1, y1, x2, y2, attributes) => svg("line", { x1, y1, x2, y2, ...attributes });
const rect = (x, y, width, height, attributes, ...children) => svg("rect", { x, y, width, height, ...attributes }, ...children);
