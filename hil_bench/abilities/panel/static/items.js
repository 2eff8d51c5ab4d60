// The items of a layout: each with an element, and what it draws.

import { AxisPicture } from "./axis_picture.js";
import { BusView } from "./bus.js";
import { button, el, setText, svg } from "./dom.js";
import { actionWords } from "./fault_form.js";
import { Axis } from "./hydraulics.js";
import { Plots } from "./plots.js";
import { shown, valueText, valueWithUnit } from "./units.js";

const SPAN = 10; // of a plot [s]
const ROW = 46; // height of a row of the grid and its gap [px]
const HEAD = 58; // of a plot: what is above and below the curves [px]

export const KINDS = {
  plot: PlotItem, value: ValueItem, gauge: GaugeItem, button: ButtonItem, slider: SliderItem,
  text: TextItem, bus: BusItem, verdicts: VerdictsItem, machine: MachineItem,
};

// Return an item: { root, draw, show, hide }; one whose signal is not there says so in a line.
export function makeItem(content, model, act) {
  const missing = problemOf(content, model);
  if (missing) return { root: el("p", { class: "problem" }, missing), draw() {} };
  return KINDS[content.kind](content, model, act);
}

function problemOf({ channel, channels, axis, quantity, target, fault }, model) {
  const lost = [channel, ...(channels ?? [])].find((name) => name !== undefined && model.store.number(name) < 0);
  if (lost !== undefined) return `${lost}: this bench has no such channel`;
  if (axis !== undefined && !Object.hasOwn(model.hello.machines ?? {}, axis)) return `${axis}: this bench has no such axis`;
  if (quantity !== undefined && !influenceOf(model, axis, quantity)) return `${axis}.${quantity}: nothing of this bench is set so`;
  const kinds = model.hello.fault_kinds ?? {};
  if (fault !== undefined && !Object.hasOwn(kinds[fault] ?? {}, target)) return `${fault} ${target}: this bench has no such fault`;
  return "";
}

function influenceOf(model, axis, quantity) {
  return (model.hello.axes?.[axis] ?? []).find(({ name }) => name === quantity);
}

function PlotItem({ channels, seconds = SPAN, height }, model) {
  const panes = new Set(channels.map((name) => model.unit(name))).size;
  const plots = new Plots(model, { height: Math.max(60, (height * ROW - 16) / panes - HEAD) });
  plots.choose(channels);
  const draw = () => {
    const { last } = model.store;
    const begin = Math.max(0, last - seconds);
    plots.show(begin, begin + seconds, last);
  };
  return { root: plots.root, draw, show: () => plots.resize() };
}

function ValueItem({ channel }, model) {
  const value = el("span", { class: "figure item-value" });
  const unit = model.unit(channel);
  const draw = () => setText(value, valueWithUnit(model.store.latest(channel), unit));
  return { root: el("div", { class: "item-column" }, el("span", { class: "quiet" }, channel), value), draw };
}

function GaugeItem({ channel, low_si: low, high_si: high }, model) {
  const unit = model.unit(channel);
  const value = el("span", { class: "figure item-value" });
  const needle = svg("path", { class: "gauge-needle", d: "M 50 50 L 50 14" });
  const ends = [low, high].map((each, number) => {
    const text = svg("text", { x: 12 + 76 * number, y: 62, class: "middle" });
    setText(text, valueText(each, unit));
    return text;
  });
  const dial = svg("svg", { viewBox: "0 0 100 66", class: "gauge", role: "img", "aria-label": `gauge of ${channel}` },
    svg("path", { d: "M 12 50 A 38 38 0 0 1 88 50", class: "gauge-arc" }), needle, ...ends);
  const draw = () => {
    const present = model.store.latest(channel);
    const share = Math.min(1, Math.max(0, (present - low) / (high - low)));
    needle.classList.toggle("unknown", !Number.isFinite(share));
    if (Number.isFinite(share)) needle.setAttribute("transform", `rotate(${(180 * share - 90).toFixed(1)} 50 50)`);
    dial.classList.toggle("bad", present < low || present > high);
    setText(value, valueWithUnit(present, unit));
  };
  return { root: el("div", { class: "item-column" }, el("span", { class: "quiet" }, channel), dial, value), draw };
}

function ButtonItem({ text, fault, target, keys = {} }, model, act) {
  const isActive = () => model.state.faults.find((each) => each.kind === fault && each.target === target);
  const toggle = () => {
    const active = isActive();
    act(active ? "clear_fault" : "fault", active ? { number: active.number } : { kind: fault, target, keys });
  };
  const root = button(text, toggle, { class: "danger item-button", "aria-pressed": "false", title: `${actionWords(fault)}: ${target}` });
  return { root, draw: () => root.setAttribute("aria-pressed", String(Boolean(isActive()))) };
}

function SliderItem({ axis, quantity, low_si: low, high_si: high }, model, act) {
  const { unit } = influenceOf(model, axis, quantity);
  const { symbol, factor } = shown(unit);
  const name = `${axis}: ${quantity.replaceAll("_", " ")}`;
  const value = el("span", { class: "figure" }, "not set here");
  const send = () => act("set_plant", { axis, quantity, value: Number(field.value) * factor });
  const show = () => setText(value, valueWithUnit(Number(field.value) * factor, unit));
  const field = el("input", { type: "range", min: low / factor, max: high / factor, step: "any", value: Math.min(high, Math.max(low, 0)) / factor, "aria-label": `${name} [${symbol}]`, oninput: show, onchange: send });
  return { root: el("div", { class: "item-column" }, el("span", { class: "row" }, el("span", { class: "quiet" }, name), value), field), draw() {} };
}

function TextItem({ text }) {
  return { root: el("p", { class: "item-text" }, text), draw() {} };
}

function BusItem(_content, model) {
  const root = el("div", { class: "item-bus" });
  const view = new BusView(root, model);
  view.begin?.(model.hello);
  return { root, draw: () => view.draw(), show: () => view.show?.(), hide: () => view.hide?.() };
}

function VerdictsItem(_content, model) {
  const body = el("tbody");
  const empty = el("p", { class: "quiet" }, "no scenario is running");
  let seen = null;
  const draw = () => {
    const items = model.state.work?.items ?? [];
    if (items === seen) return;
    seen = items;
    empty.hidden = items.length > 0;
    body.replaceChildren(...items.map(({ name, verdict, text }) =>
      el("tr", {}, el("th", { scope: "row" }, name), el("td", { class: verdict === "failed" ? "word bad" : "word" }, verdict ?? ""), el("td", {}, text ?? ""))));
  };
  return { root: el("div", {}, empty, el("table", {}, body)), draw };
}

function MachineItem({ axis }, model) {
  const picture = new AxisPicture(model);
  picture.show(new Axis(model, axis));
  picture.root.prepend(el("h3", { class: "item-title" }, axis));
  return { root: picture.root, draw: () => picture.draw() };
}
