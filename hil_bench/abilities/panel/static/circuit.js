// The hydraulics of an axis as a drawing: the picture of its plant, lines, valve and supply unit, in
// the symbols of ISO 1219. Each element that one may break is a part that can be chosen.

import { svg } from "./dom.js";
import { readPicture } from "./bound.js";

const WIDTH = 440;
const MIDDLE = WIDTH / 2;
const [A, B] = [MIDDLE - 14, MIDDLE + 14]; // ports of the valve
const BOX = 56; // of the valve: width and height of a position
const PLANT_GAP = 58; // from the picture to the valve

const path = (d, name, more = {}) => svg("path", { d, class: name, ...more });
const text = (x, y, content, name = "", more = {}) => svg("text", { x, y, class: name, ...more }, content);
const bound = (x, y, quantity, label, name = "") => svg("text", { x, y, class: name, "data-text": quantity, "data-label": label });

// Return the drawing of an axis and its parts: [{ id, title, element }]; the parts are chosen by who
// knows their faults. `about`: circuit, picture text, name of the valve, of the supply and of sensors.
export function drawAxis(axis, about) {
  const picture = about.svg ? readPicture(about.svg) : null;
  if (typeof picture === "string") return { problem: picture };
  const parts = [];
  const height = picture ? picture.box[3] : 0;
  const content = [];
  const circuit = about.circuit;
  const scale = picture ? Math.min(1, WIDTH / picture.box[2]) : 1;
  const ports = picture ? portsOf(picture, scale) : {};
  const top = height * scale + PLANT_GAP;
  if (about.valve) {
    if (ports.A && ports.B) content.push(...lines(ports, top, circuit));
    const valve = part(parts, "valve", about.valve, drawValve(top, circuit));
    content.push(valve);
  }
  if (picture) {
    const [x, y] = picture.box;
    const plant = svg("g", { transform: `scale(${scale.toFixed(4)}) translate(${-x} ${-y})` }, picture.root);
    content.push(part(parts, "plant", axis, [hit(0, 0, WIDTH, height * scale - 8), plant]));
  }
  let bottom = about.valve ? top + BOX + 44 : height * scale;
  if (about.valve && circuit) {
    content.push(part(parts, "supply", about.supply || `supply of ${axis}`, drawSupply(bottom, circuit)));
    bottom += supplyHeight(circuit);
  }
  return { parts, box: [0, 0, WIDTH, bottom], content };
}

// Return a group that takes clicks, and whose first element, its outline, is the button for keys.
function part(parts, id, title, content) {
  const outline = content[0];
  for (const [name, value] of Object.entries({ role: "button", tabindex: "0", "aria-pressed": "false", "aria-label": title })) {
    outline.setAttribute(name, value);
  }
  const element = svg("g", { class: "part" }, ...content);
  parts.push({ id, title, element, outline });
  return element;
}

// What takes the pointer, and shows the focus.
function hit(x, y, width, height) {
  return svg("rect", { x, y, width, height, rx: 6, class: "hit" });
}

function portsOf({ root, box }, scale) {
  const found = {};
  for (const port of root.querySelectorAll("[data-port]")) {
    found[port.dataset.port] = [scale * (port.getAttribute("cx") - box[0]), scale * (port.getAttribute("cy") - box[1])];
  }
  return found;
}

function lines({ A: [ax, ay], B: [bx, by] }, top, circuit) {
  // Whichever port is to the left goes to the left at the lower level, so that lines do not cross.
  const low = top - 34;
  const high = top - 46;
  const full = circuit?.pressure ?? 1e7;
  const [la, lb] = ax <= bx ? [low, high] : [high, low];
  const line = (x, y, to, level) => `M ${x.toFixed(1)} ${y.toFixed(1)} V ${level} H ${to} V ${top}`;
  const one = (name, d, sign) => [
    path(d, "pipe", { "data-stroke": `P_${name} 0 ${full}` }),
    path(d, "flow", { "data-flow": `speed ${sign * fullSpeed(circuit, name)}` }),
  ];
  const marks = [["a", ax, ay], ["b", bx, by]].flatMap(([side, x, y]) => guard(side, x, y, circuit));
  return [
    ...one("A", line(ax, ay, A, la), -1), ...one("B", line(bx, by, B, lb), 1), ...marks,
    bound(A - 16, top - 10, "P_A", "A", "big right"), bound(B + 16, top - 10, "P_B", "B", "big"),
  ];
}

// A speed at which dashes move fastest: 20 l/min through the port.
function fullSpeed(circuit, name) {
  const swept = name === "A" ? circuit?.swept_a : circuit?.swept_b;
  return swept > 0 ? 20e-3 / 60 / swept : 0.1;
}

// A counterbalance valve sits at the port; a hose is a wavy mark there.
function guard(side, x, y, circuit) {
  if (!circuit?.counterbalance.includes(side)) return [];
  const box = svg("rect", { x: x - 8, y: y + 5, width: 16, height: 16, class: "body" });
  return [box, path(`M ${x} ${y + 8} v 10 m -3 -4 l 3 4 l 3 -4`, "thin"), svg("title", {}, `counterbalance valve at port ${side.toUpperCase()}`)];
}

// A proportional valve with four ports and three positions, which move with the spool.
function drawValve(top, circuit) {
  const left = MIDDLE - 1.5 * BOX;
  const arrow = (x1, y1, x2, y2) => {
    const turn = Math.atan2(y2 - y1, x2 - x1);
    const tip = (side) => `${(x2 - 8 * Math.cos(turn + side)).toFixed(1)} ${(y2 - 8 * Math.sin(turn + side)).toFixed(1)}`;
    return path(`M ${x1} ${y1} L ${x2} ${y2} M ${tip(0.4)} L ${x2} ${y2} L ${tip(-0.4)}`, "thin");
  };
  const position = (number) => svg("rect", { x: left + number * BOX, y: top, width: BOX, height: BOX, class: "body" });
  const x = (number, offset) => left + (number + 0.5) * BOX + offset;
  const stub = (number, offset, y, to) => path(`M ${x(number, offset)} ${y} v ${to} m -5 0 h 10`, "thin");
  const bottom = top + BOX;
  const spool = svg("g", { "data-x": `spool_position -1 1 ${-BOX} ${BOX}` },
    position(0), position(1), position(2),
    arrow(x(0, -14), bottom, x(0, -14), top + 2), arrow(x(0, 14), top, x(0, 14), bottom - 2),
    ...[-14, 14].flatMap((offset) => [stub(1, offset, top, 14), stub(1, offset, bottom, -14)]),
    arrow(x(2, -14), bottom, x(2, 14), top + 2), arrow(x(2, -14), top, x(2, 14), bottom - 2),
    path(`M ${left} ${top - 4} H ${left + 3 * BOX} M ${left} ${bottom + 4} H ${left + 3 * BOX}`, "thin"));
  const full = circuit?.pressure ?? 0;
  return [
    hit(left - BOX, top - 6, 5 * BOX, BOX + 44),
    spool,
    path(`M ${A} ${bottom} v 44`, circuit?.pump ? "pipe" : "pipe set", { "data-stroke": `P_S 0 ${full}` }),
    path(`M ${B} ${bottom} v 44`, "pipe tank"),
    svg("text", { x: B + 30, y: bottom + 42, class: "valve-state" }),
    text(A - 10, bottom + 22, "P", "right"), text(B + 10, bottom + 22, "T"),
    bound(B + 30, bottom + 22, "spool_position", "spool", "value"),
    bound(A - 30, bottom + 22, "spool_setpoint", "set", "value right"),
  ];
}

// The supply unit: pump, filter, relief valve, accumulator and tank; or a constant pressure.
function drawSupply(top, circuit) {
  const colour = { "data-stroke": `P_S 0 ${circuit.pressure}` };
  const rail = top + (circuit.pump ? 50 : 34);
  const floor = top + supplyHeight(circuit) - 16;
  const parts = [
    hit(8, top + 2, WIDTH - 16, supplyHeight(circuit) - 4),
    path(`M ${B} ${top} V ${floor - 4}`, "pipe tank"), tank(B, floor),
    path(`M ${A} ${top} V ${rail}`, circuit.pump ? "pipe" : "pipe set", colour),
  ];
  if (!circuit.pump) {
    parts.push(path(`M ${A} ${rail - 12} l -10 18 h 20 z`, "sign"));
    parts.push(svg("text", { x: A - 22, y: rail + 4, class: "right", "data-number": `${circuit.pressure} Pa`, "data-label": "set to " }));
    return parts;
  }
  const [pump, relief, gas] = [60, 110, 156];
  const y = rail + 62;
  const fall = (x) => [path(`M ${x} ${y + 20} V ${floor - 4}`, "pipe tank"), tank(x, floor)];
  parts.push(
    path(`M ${A} ${rail} H ${pump} V ${y - 20}`, "pipe", colour), ...fall(pump),
    svg("circle", { cx: pump, cy: y, r: 20, class: "body" }), path(`M ${pump} ${y - 20} l -7 11 h 14 z`, "sign"),
    path(`M ${relief} ${rail} V ${y - 12}`, "pipe", colour), path(`M ${relief} ${y + 12} V ${floor - 4}`, "pipe tank"), tank(relief, floor),
    svg("rect", { x: relief - 12, y: y - 12, width: 24, height: 24, class: "body" }),
    path(`M ${relief - 4} ${y - 9} v 17 m -4 -6 l 4 6 l 4 -6`, "thin"),
    path(`M ${relief + 12} ${y} l 3 -5 l 4 10 l 4 -10 l 4 10 l 3 -5`, "thin"),
    path(`M ${relief} ${y - 24} H ${relief - 20} V ${y} H ${relief - 12}`, "dotted"),
  );
  if (circuit.pump !== "fixed") parts.push(path(`M ${pump - 20} ${y + 22} L ${pump + 22} ${y - 20} m -9 1 l 9 -1 l -2 9`, "thin"));
  if (circuit.has_filter) {
    parts.push(path(`M ${pump} ${rail + 6} l 13 13 l -13 13 l -13 -13 z`, "body"), path(`M ${pump - 13} ${rail + 19} h 26`, "dotted"));
  }
  if (circuit.accumulator > 0) {
    parts.push(path(`M ${gas} ${rail} v -6`, "pipe", colour), svg("rect", { x: gas - 11, y: rail - 48, width: 22, height: 42, rx: 11, class: "body" }));
    parts.push(path(`M ${gas - 11} ${rail - 24} h 22 M ${gas} ${rail - 42} l -5 9 h 10 z`, "thin"));
  }
  const x = B + 24;
  parts.push(
    bound(x, top + 30, "P_S", "P", "big"), bound(x, top + 54, "Q_S", "draws"), bound(x, top + 76, "T_oil", "oil"),
    bound(x, top + 98, "filter_drop", "filter"),
    svg("text", { x, y: top + 120, class: "quiet", "data-number": `${circuit.relief} Pa`, "data-label": "relief at " }),
  );
  return parts;
}

function supplyHeight(circuit) {
  return circuit.pump ? 160 : 66;
}

function tank(x, y) {
  return path(`M ${x - 14} ${y - 8} v 12 h 28 v -12`, "thin");
}
