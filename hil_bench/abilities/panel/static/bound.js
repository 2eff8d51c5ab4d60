// Pictures with bound attributes: an SVG as a kind of plant or device brings it, of which only shapes
// and texts are taken, and what in it follows a quantity.
//
// data-text="QUANTITY"                    its value with the unit, after the text of data-label
// data-x, -y, -turn, -stretch, -width, -height, -opacity="QUANTITY LOW HIGH FROM TO"
// data-fill, data-stroke="QUANTITY LOW HIGH"    the colour of a pressure between two
// data-flow="QUANTITY FULL"               dashes that move with it
// data-number="VALUE UNIT"                a constant in the unit that is chosen

import { setText, svg } from "./dom.js";
import { valueWithUnit } from "./units.js";

const MOST = 2000; // elements
const SHAPES = new Set(["g", "path", "rect", "circle", "ellipse", "line", "polyline", "polygon", "text", "tspan", "title"]);
const PLAIN = new Set([
  "class", "transform", "d", "x", "y", "width", "height", "r", "rx", "ry", "cx", "cy", "x1", "x2", "y1", "y2", "points",
  "text-anchor", "font-size", "fill", "stroke", "stroke-width", "stroke-dasharray", "opacity", "viewBox",
]);
const BOUND = ["text", "x", "y", "turn", "stretch", "width", "height", "opacity", "fill", "stroke", "flow", "number"];
const KEPT = new Set(["label", "port", ...BOUND].map((name) => `data-${name}`));
const CALM = matchMedia("(prefers-reduced-motion: reduce)");

// Return the picture of a text, or a text that says why there is none.
export function readPicture(text) {
  const root = new DOMParser().parseFromString(text, "image/svg+xml").documentElement;
  if (root.localName !== "svg" || root.querySelector("parsererror")) return "the picture of this kind is not SVG";
  const box = (root.getAttribute("viewBox") ?? "").trim().split(/[\s,]+/).map(Number);
  if (box.length !== 4 || !box.every(Number.isFinite) || box[2] <= 0 || box[3] <= 0) return "the picture of this kind has no viewBox";
  if (root.getElementsByTagName("*").length > MOST) return `the picture of this kind has more than ${MOST} elements`;
  return { box, root: copy(root, svg("g")) };
}

function copy(from, to) {
  for (const { name, value } of from.attributes) {
    if (KEPT.has(name) || (PLAIN.has(name) && !/url\s*\(|:/i.test(value))) to.setAttribute(name, value);
  }
  for (const child of from.childNodes) {
    if (child.nodeType === Node.TEXT_NODE && child.textContent.trim()) to.append(child.textContent);
    else if (SHAPES.has(child.localName)) to.append(copy(child, svg(child.localName)));
  }
  return to;
}

// Makes the bound attributes of a drawing follow the quantities of an owner (an axis or a node).
export class Binding {
  constructor(root, model, owner) {
    this.model = model;
    this.acts = [];
    const bound = [root, ...root.querySelectorAll("*")].filter((each) => each.attributes);
    for (const element of bound) {
      for (const name of BOUND) {
        const words = element.getAttribute(`data-${name}`)?.trim().split(/\s+/);
        const act = words && this.act(element, name, words, owner);
        if (act) this.acts.push(act);
      }
    }
  }

  draw() {
    for (const act of this.acts) act();
  }

  act(element, name, [quantity, ...words], owner) {
    const numbers = words.map(Number);
    if (name === "number") {
      setText(element, `${element.dataset.label ?? ""}${valueWithUnit(Number(quantity), words[0])}`);
      return null;
    }
    const channel = `${owner}.${quantity}`;
    if (this.model.store.number(channel) < 0) {
      if (name === "text") element.remove();
      return null;
    }
    const latest = () => this.model.store.latest(channel);
    if (name === "text") return textAct(element, latest, this.model.unit(channel));
    if (!numbers.every(Number.isFinite)) return null;
    const act = this.shape(element, name, latest, numbers);
    return () => {
      element.classList.toggle("unknown", !Number.isFinite(latest()));
      act();
    };
  }

  shape(element, name, latest, numbers) {
    if (name === "fill" || name === "stroke") return colourAct(element, name, latest, numbers);
    if (name === "flow") return flowAct(element, latest, numbers[0]);
    return placeAct(element, name, latest, numbers);
  }
}

function textAct(element, latest, unit) {
  const label = element.dataset.label ? `${element.dataset.label} ` : "";
  return () => setText(element, label + valueWithUnit(latest(), unit));
}

function colourAct(element, name, latest, [low, high]) {
  let before = "";
  return () => {
    const next = fluid((latest() - low) / (high - low));
    if (next === before) return;
    before = next;
    element.style[name] = next;
  };
}

// Return the colour of a pressure as a share of the highest.
export function fluid(part) {
  const share = Math.min(1, Math.max(0, part || 0));
  const [from, to, mixed] = share < 0.5 ? ["low", "middle", 2 * share] : ["middle", "high", 2 * share - 1];
  return `color-mix(in oklab, var(--${to}) ${(mixed * 100).toFixed(0)}%, var(--${from}))`;
}

function placeAct(element, name, latest, [low, high, from, to]) {
  const own = element.getAttribute("transform") ?? "";
  let before = "";
  return () => {
    const value = latest();
    let share = (value - low) / (high - low);
    if (!Number.isFinite(share)) return;
    if (name !== "turn") share = Math.min(1, Math.max(0, share));
    const at = (from + share * (to - from)).toFixed(2);
    if (at === before) return;
    before = at;
    if (name === "x") element.setAttribute("transform", `${own} translate(${at} 0)`);
    else if (name === "y") element.setAttribute("transform", `${own} translate(0 ${at})`);
    else if (name === "stretch") element.setAttribute("transform", `${own} scale(${at} 1)`);
    else if (name === "turn") element.setAttribute("transform", `${own} rotate(${at % 360})`);
    else element.setAttribute(name, name === "opacity" ? at : String(Math.max(0, at)));
  };
}

function flowAct(element, latest, full) {
  let offset = 0;
  let before = "";
  return () => {
    const share = Math.min(1, Math.max(-1, latest() / full || 0));
    offset = CALM.matches ? 0 : (offset - 3 * share) % 1000;
    const visible = Math.abs(share) > 0.002;
    const next = visible ? `${offset.toFixed(1)} ${(0.35 + 0.65 * Math.abs(share)).toFixed(2)}` : "";
    if (next === before) return;
    before = next;
    element.style.visibility = visible ? "visible" : "hidden";
    element.setAttribute("stroke-dashoffset", offset.toFixed(1));
    element.classList.toggle("back", share < 0);
  };
}
