// The machine: cylinder, valve and supply as a drawing that moves, of any other plant a table of its
// quantities; and sensors to break beside it.

import { button, colour, el, select, setText, svg } from "./dom.js";
import { Plots } from "./plots.js";
import { shown, valueText } from "./units.js";

const LEFT = 150; // inner end of the barrel
const TOP = 60;
const HEIGHT = 120;
const PISTON = 26;
const WIDE = { width: 400, rod: 380, ticks: [-0.75, -0.5, -0.25, 0, 0.25, 0.5, 0.75], view: "110 0 910 434" };
const NARROW = { width: 290, rod: 270, ticks: [-0.75, 0, 0.75], view: "130 -24 650 466" }; // with larger text
const SPOOL = 34; // travel of the spool on the drawing, each way
const SPAN = 10; // of the plots below [s]

export class MachineView {
  constructor(root, model) {
    this.model = model;
    this.axis = "";
    this.flow = 0;
    this.axes = select([], { "aria-label": "axis", hidden: true, onchange: () => this.choose(this.axes.value) });
    this.drawing = el("div", { class: "drawing" });
    this.sensors = el("div", { class: "stack" });
    this.active = el("ul", { class: "active-faults" });
    this.problem = el("p", { class: "problem", role: "alert" });
    this.plots = new Plots(model, { height: 120 });
    this.narrow = matchMedia("(max-width: 480px)");
    this.narrow.addEventListener("change", () => this.machine && this.build());
    root.append(
      el("div", { class: "machine" },
        el("div", {}, this.axes, this.drawing),
        el("aside", { class: "stack" },
          el("h2", {}, "Break a sensor"), this.sensors,
          el("h2", {}, "Active faults"), this.active,
          button("Clear all faults", () => this.act("clear_fault", {}), { class: "wide" }),
          this.problem)),
      this.plots.root,
    );
  }

  begin(hello) {
    const names = Object.keys(hello.machines ?? {});
    this.axes.replaceChildren(...names.map((name) => el("option", { value: name }, name)));
    this.axes.hidden = names.length < 2;
    this.choose(names[0] ?? "");
    this.shownFaults = null;
  }

  show() {
    this.plots.resize();
  }

  choose(axis) {
    this.axis = axis;
    this.machine = this.model.hello.machines?.[axis];
    if (!this.machine) {
      this.drawing.replaceChildren("This bench has no plant to show; see the scope.");
      this.sensors.replaceChildren();
      this.plots.choose([]);
      return;
    }
    this.build();
    this.offer();
    const measured = this.nodes().map((node) => `${node}.measured`);
    if (!this.isDrawn) {
      this.plots.choose([...this.quantities(), ...measured]);
      return;
    }
    const names = ["position", "spool_setpoint", "spool_position"].map((name) => `${axis}.${name}`);
    const seen = [...names, ...measured].filter((name) => this.model.unit(name) === "m" || name.includes("spool"));
    this.plots.choose([...seen, `${axis}.P_S`]); // which a plant with a supply unit has
  }

  get isDrawn() {
    return "half_stroke_m" in this.machine;
  }

  // Return the channels of the plant itself.
  quantities() {
    return this.model.store.channels.map(({ name }) => name).filter((name) => name.startsWith(`${this.axis}.`) && !name.slice(this.axis.length + 1).includes("."));
  }

  nodes() {
    const { devices, fault_targets: targets } = this.model.hello;
    const sensors = targets?.sensors ?? [];
    if (this.isDrawn) return sensors.filter((name) => devices?.[name]?.axis === this.axis);
    // Beside them the signals of devices that belong to no axis, such as objects bound to the plant.
    return sensors.filter((name) => [this.axis, null].includes(devices?.[this.node(name)]?.axis ?? null));
  }

  // Return the node of a fault target such as NODE.SIGNAL.
  node(target) {
    const names = Object.keys(this.model.hello.devices ?? {});
    return names.find((name) => target === name || target.startsWith(`${name}.`)) ?? target;
  }

  // Return what else of the axis may have faults: the plant itself and what commands it.
  others() {
    const { devices, fault_targets: targets } = this.model.hello;
    const valves = (targets?.valves ?? []).filter((name) => devices?.[this.node(name)]?.axis === this.axis);
    return [...(targets?.plants ?? []).filter((name) => name === this.axis), ...valves];
  }

  offer() {
    const rows = this.nodes().map((node) =>
      el("div", { class: "row" }, el("strong", {}, node),
        button("broken", () => this.fault("break_wire", node), { "aria-label": `broken: ${node}` }),
        button("frozen", () => this.fault("freeze", node), { "aria-label": `frozen: ${node}` }),
        button("silent", () => this.fault("silence", this.node(node)), { "aria-label": `silent: ${node}` })));
    const others = this.isDrawn ? [] : this.others();
    const more = others.length ? [el("p", { class: "quiet" }, `Faults of ${others.join(", ")}: under Faults.`)] : [];
    this.sensors.replaceChildren(...rows, ...more);
  }

  fault(kind, target) {
    return this.act("fault", { kind, target, keys: {} });
  }

  async act(action, fields) {
    try {
      await this.model.request(action, fields);
      setText(this.problem, "");
    } catch (error) {
      setText(this.problem, error.message);
    }
  }

  build() {
    this.parts = null;
    if (this.isDrawn) this.buildDrawing();
    else this.buildTable();
  }

  buildTable() {
    this.rows = this.quantities().map((name) => ({ name, unit: this.model.unit(name), value: el("td", { class: "figure" }) }));
    const head = ["quantity", "value", "unit"].map((text) => el("th", { scope: "col" }, text));
    this.drawing.replaceChildren(
      el("table", { "aria-label": `quantities of ${this.axis}` },
        el("thead", {}, el("tr", {}, ...head)),
        el("tbody", {}, ...this.rows.map(({ name, unit, value }) =>
          el("tr", {}, el("th", { scope: "row" }, name), value, el("td", {}, shown(unit).symbol))))));
  }

  drawTable() {
    for (const { name, unit, value } of this.rows) setText(value, valueText(this.model.store.latest(name), unit));
  }

  buildDrawing() {
    const text = (x, y, anchor = "middle", kind = "") => svg("text", { x, y, "text-anchor": anchor, class: kind });
    const narrow = this.narrow.matches;
    this.shape = narrow ? NARROW : WIDE;
    const end = LEFT + this.shape.width;
    const middle = LEFT + this.shape.width / 2; // of the valve, too
    const p = (this.parts = {
      a: svg("rect", { x: LEFT, y: TOP, height: HEIGHT, class: "chamber" }),
      b: svg("rect", { y: TOP, height: HEIGHT, class: "chamber" }),
      piston: svg("rect", { y: TOP, width: PISTON, height: HEIGHT, class: "steel" }),
      rod: svg("rect", { y: TOP + HEIGHT / 2 - 13, height: 26, class: "steel" }),
      mass: svg("rect", { y: TOP + HEIGHT / 2 - 40, width: 60, height: 80, rx: 6, class: "mass" }),
      pa: narrow ? text(middle, 243, "middle", "big") : text(LEFT + 28, 270, "start", "big"),
      pb: narrow ? text(middle, 273, "middle", "big") : text(end - 28, 270, "end", "big"),
      pipeA: svg("path", { d: `M ${LEFT + 10} ${TOP + HEIGHT} V 290 H ${middle - 54} V 330`, class: "pipe" }),
      pipeB: svg("path", { d: `M ${end - 10} ${TOP + HEIGHT} V 290 H ${middle + 54} V 330`, class: "pipe" }),
      flowA: svg("path", { d: `M ${LEFT - 16} 286 V ${TOP + HEIGHT + 18}`, class: "flow" }),
      flowB: svg("path", { d: `M ${end + 16} ${TOP + HEIGHT + 18} V 286`, class: "flow" }),
      spool: svg("g", {},
        svg("rect", { x: middle - 94, y: 346, width: 188, height: 8, class: "steel" }),
        ...[-86, -16, 54].map((x) => svg("rect", { x: middle + x, y: 334, width: 32, height: 32, class: "steel" }))),
      supply: text(middle, narrow ? 432 : 424, "middle", ""),
      position: text(end + 8, 38, "end", "huge"),
      speed: text(end + (narrow ? 40 : 90), 38, "start", "big"),
      shares: text(middle + 128, narrow ? 334 : 342, "start", ""),
      setpoint: text(middle + 128, 362, "start", ""),
      state: text(middle + 128, narrow ? 392 : 368, "start", narrow ? "" : "big"),
      measured: text(LEFT - 8, narrow ? 2 : 38, "start", ""),
      needle: svg("path", { class: "needle" }),
    });
    const ticks = this.shape.ticks.map((share) => {
      const x = this.place(share * this.machine.half_stroke_m) + PISTON / 2;
      const label = text(x, TOP + HEIGHT + 34, "middle", "tick");
      label.textContent = valueText(share * this.machine.half_stroke_m, "m").replace(/\.0+$/, "");
      return svg("g", {}, svg("line", { x1: x, x2: x, y1: TOP + HEIGHT + 10, y2: TOP + HEIGHT + 18, class: "scale" }), label);
    });
    this.drawing.replaceChildren(
      svg("svg", { viewBox: this.shape.view, role: "img", "aria-label": `drawing of ${this.axis}: cylinder and valve` },
        svg("defs", {}, svg("marker", { id: "head", viewBox: "0 0 10 10", refX: 6, refY: 5, markerWidth: 4, markerHeight: 4, orient: "auto-start-reverse" },
          svg("path", { d: "M 0 0 L 10 5 L 0 10 z", class: "arrow-head" }))),
        p.pipeA, p.pipeB, p.flowA, p.flowB, p.a, p.b, p.rod, p.mass, p.piston,
        svg("rect", { x: LEFT - 8, y: TOP - 8, width: this.shape.width + 16, height: HEIGHT + 16, rx: 6, class: "barrel" }),
        ...ticks, p.needle, p.pa, p.pb,
        svg("rect", { x: middle - 110, y: 330, width: 220, height: 40, rx: 4, class: "body" }),
        p.spool,
        svg("path", { d: `M ${middle - 30} 370 V 400 H ${middle - 58} M ${middle + 30} 370 V 400 H ${middle + 58}`, class: "pipe thin" }),
        labelText(middle - 70, 405, "P", "end"), labelText(middle + 70, 405, "T", "start"),
        p.supply, p.position, p.speed, p.shares, p.setpoint, p.state, p.measured,
      ),
      el("p", { class: "quiet" }, `Colours: 0 to ${this.setPressure()} bar, the supply pressure as set`),
    );
  }

  setPressure() {
    return valueText(this.machine.supply_pressure_pa, "Pa");
  }

  // Return where the piston's left edge is for a position [m].
  place(position) {
    const { half_stroke_m: half } = this.machine;
    const share = Math.min(1, Math.max(0, (position + half) / (2 * half)));
    return LEFT + 20 + share * (this.shape.width - PISTON - 40);
  }

  draw() {
    this.drawFaults();
    const { last } = this.model.store;
    const begin = Math.max(0, last - SPAN);
    this.plots.show(begin, begin + SPAN, last);
    if (!this.machine) return;
    if (this.isDrawn) this.drawMachine();
    else this.drawTable();
  }

  drawMachine() {
    const value = (name) => this.model.store.latest(`${this.axis}.${name}`);
    const [position, speed, pa, pb] = ["position", "speed", "P_A", "P_B"].map(value);
    const spool = value("spool_position");
    const p = this.parts;
    const x = this.place(Number.isFinite(position) ? position : 0);
    const set = (element, attributes) => {
      for (const [name, each] of Object.entries(attributes)) element.setAttribute(name, each);
    };
    set(p.a, { width: x - LEFT });
    p.a.style.fill = this.fluid(pa);
    set(p.b, { x: x + PISTON, width: LEFT + this.shape.width - x - PISTON });
    p.b.style.fill = this.fluid(pb);
    set(p.piston, { x });
    set(p.rod, { x: x + PISTON, width: this.shape.rod });
    set(p.mass, { x: x + PISTON + this.shape.rod });
    p.pipeA.style.stroke = this.fluid(pa);
    p.pipeB.style.stroke = this.fluid(pb);
    setText(p.pa, `A ${valueText(pa, "Pa")} bar`);
    setText(p.pb, `B ${valueText(pb, "Pa")} bar`);
    setText(p.position, `${valueText(position, "m")} mm`);
    setText(p.speed, `${valueText(speed, "m/s")} mm/s`);
    set(p.needle, { d: `M ${x + PISTON / 2} ${TOP + HEIGHT + 8} l -6 12 h 12 z` });
    set(p.spool, { transform: `translate(${SPOOL * (Number.isFinite(spool) ? spool : 0)} 0)` });
    const texts = [`spool ${valueText(spool, "-")} %`, `set-point ${valueText(value("spool_setpoint"), "-")} %`];
    setText(p.shares, this.narrow.matches ? texts[0] : texts.join(", "));
    setText(p.setpoint, this.narrow.matches ? texts[1] : "");
    setText(p.state, this.valveState());
    const supply = value("P_S");
    const shown = Number.isFinite(supply) ? valueText(supply, "Pa") : `set to ${this.setPressure()}`;
    setText(p.supply, `supply ${shown} bar`);
    setText(p.measured, this.measuredText());
    this.drawFlow(speed);
  }

  drawFlow(speed) {
    const rate = Number.isFinite(speed) ? speed : 0;
    const strength = Math.min(1, Math.abs(rate) / 0.05);
    this.flow -= rate * 40;
    for (const path of [this.parts.flowA, this.parts.flowB]) {
      path.setAttribute("stroke-opacity", strength.toFixed(2));
      path.setAttribute("stroke-dashoffset", this.flow.toFixed(1));
      path.setAttribute("marker-end", rate > 1e-4 ? "url(#head)" : "");
      path.setAttribute("marker-start", rate < -1e-4 ? "url(#head)" : "");
      path.style.visibility = strength > 0.02 ? "visible" : "hidden";
    }
  }

  // Return the colour of a pressure: from 0 to that to which the supply is set.
  fluid(pressure) {
    const share = Math.min(1, Math.max(0, pressure / this.machine.supply_pressure_pa || 0));
    const [from, to, part] = share < 0.5 ? ["low", "middle", 2 * share] : ["middle", "high", 2 * share - 1];
    return `color-mix(in oklab, ${colour(to)} ${(part * 100).toFixed(0)}%, ${colour(from)})`;
  }

  valveState() {
    const { devices } = this.model.hello;
    const valve = Object.keys(devices ?? {}).find((name) => devices[name].axis === this.axis && devices[name].kind === "valve_408");
    const node = this.model.state.nodes[valve];
    return node ? `valve ${node.device ?? node.state}` : "";
  }

  measuredText() {
    const node = this.nodes().find((name) => this.model.unit(`${name}.measured`) === "m");
    if (!node) return "";
    const text = valueText(this.model.store.latest(`${node}.measured`), "m");
    return text === "no value" ? "sensor: no value" : `sensor: ${text} mm`;
  }

  drawFaults() {
    const { faults } = this.model.state;
    if (faults === this.shownFaults) return;
    this.shownFaults = faults;
    const items = faults.map((fault) =>
      el("li", {}, `${fault.kind} ${fault.target}`,
        button("clear", () => this.act("clear_fault", { number: fault.number }), { "aria-label": `clear ${fault.kind} ${fault.target}` })));
    this.active.replaceChildren(...(items.length ? items : [el("li", { class: "quiet" }, "none")]));
  }
}

function labelText(x, y, content, anchor) {
  const text = svg("text", { x, y, "text-anchor": anchor });
  text.textContent = content;
  return text;
}
