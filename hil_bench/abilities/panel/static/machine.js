// The machine: all axes small and one large with valve, lines and supply; plots beside it; what each
// element shows, and the faults that it may have.

import { AxisPicture } from "./axis_picture.js";
import { button, el, setText } from "./dom.js";
import { ActiveFaults, FaultButtons, actionWords, influenceForm } from "./fault_form.js";
import { Axis } from "./hydraulics.js";
import { Overview } from "./overview.js";
import { Plots } from "./plots.js";
import { valueWithUnit } from "./units.js";

const SPAN = 10; // of the plots [s]

export class MachineView {
  constructor(root, model) {
    this.model = model;
    const act = (...words) => this.act(...words);
    this.overview = new Overview(model, (name) => this.choose(name));
    this.picture = new AxisPicture(model, (id, title) => this.inspect(id, title));
    this.sensors = el("tbody");
    this.sensorTable = el("table", { class: "sensors" }, this.sensors);
    this.inspector = new Inspector(model, act);
    this.active = new ActiveFaults(model, act);
    this.problem = el("p", { class: "problem", role: "alert" });
    this.plots = new Plots(model, { height: 132 });
    root.append(
      this.overview.root,
      el("div", { class: "machine" },
        this.picture.root,
        this.plots.root,
        el("div", { class: "stack" }, el("h2", {}, "Sensors"), this.sensorTable, this.problem,
          el("h2", {}, "Active faults"), this.active.root,
          button("Clear all faults", () => this.act("clear_fault", {}))),
        this.inspector.root),
    );
  }

  begin(hello) {
    const names = Object.keys(hello.machines ?? {});
    this.axes = names.map((name) => new Axis(this.model, name));
    this.overview.begin(this.axes);
    this.active.seen = null;
    this.choose(names.includes(this.axis?.name) ? this.axis.name : (names[0] ?? ""));
  }

  show() {
    this.plots.resize();
  }

  choose(name) {
    this.axis = this.axes.find((each) => each.name === name) ?? null;
    this.acts = [];
    if (!this.axis) {
      this.picture.say("This bench has no plant to show; see the scope.");
      this.sensors.replaceChildren();
      this.plots.choose([]);
      this.inspector.root.hidden = true;
      return;
    }
    this.inspector.root.hidden = false;
    this.overview.light(name);
    this.picture.show(this.axis);
    this.offerSensors();
    this.plots.choose(this.axis.plots);
    this.inspect("plant", name);
  }

  inspect(id, title) {
    this.picture.light(id);
    this.inspector.show(this.axis, id, title);
  }

  offerSensors() {
    const { axis, model } = this;
    const rows = axis.sensors.map((name) => {
      const value = el("td", { class: "figure" });
      const channel = `${name}.measured`;
      const unit = model.unit(channel);
      this.acts.push(() => {
        setText(value, valueWithUnit(model.store.latest(channel), unit));
      });
      const quick = axis.quick(name).map(([kind, target]) =>
        button(actionWords(kind), () => this.act("fault", { kind, target, keys: {} }), { "aria-label": `${actionWords(kind)}: ${name}` }));
      const more = button("…", () => this.inspect(name, name), { "aria-label": `all faults of ${name}`, title: "all faults" });
      return el("tr", {}, el("th", { scope: "row" }, name), value, el("td", {}, el("div", { class: "row" }, ...quick, more)));
    });
    this.sensors.replaceChildren(...(rows.length ? rows : [el("tr", {}, el("td", { class: "quiet" }, "no device of this bench measures it"))]));
  }

  async act(action, fields) {
    try {
      await this.model.request(action, fields);
      setText(this.problem, "");
    } catch (error) {
      setText(this.problem, error.message);
    }
  }

  draw() {
    this.active.draw();
    const { last } = this.model.store;
    const begin = Math.max(0, last - SPAN);
    this.plots.show(begin, begin + SPAN, last);
    this.overview.draw();
    this.picture.draw();
    for (const act of this.acts ?? []) act();
    this.inspector.draw();
  }
}

// The chosen element: what it shows, what acts on it, and its faults.
class Inspector {
  constructor(model, act) {
    this.model = model;
    this.act = act;
    this.title = el("h2", {});
    this.state = el("p", { class: "quiet" });
    this.values = el("dl", { class: "values figure" });
    this.loads = el("div", { class: "stack" });
    this.faults = new FaultButtons(act);
    this.root = el("section", { class: "inspector stack", "aria-label": "chosen element" },
      this.title, this.state, this.values, this.loads, this.faults.root);
  }

  show(axis, id, title) {
    const isSensor = !["plant", "valve", "supply"].includes(id);
    const channels = isSensor ? [`${id}.measured`] : axis.channels(id);
    this.node = isSensor ? axis.node(id) : id === "valve" ? axis.valve : "";
    setText(this.title, { plant: `Plant ${title}`, valve: `Valve ${title}`, supply: `Supply ${title}` }[id] ?? `Sensor ${title}`);
    this.rows = channels.filter((name) => this.model.store.number(name) >= 0).map((name) => ({ name, value: el("dd", {}) }));
    this.values.replaceChildren(...this.rows.flatMap(({ name, value }) => [el("dt", {}, name.split(".").at(-1).replaceAll("_", " ")), value]));
    const isOf = { plant: (name) => name !== "supply_pressure", supply: (name) => name === "supply_pressure" }[id];
    const influences = isOf ? (this.model.hello.axes[axis.name] ?? []).filter(({ name }) => isOf(name)) : [];
    this.loads.replaceChildren(...influences.map((influence) => influenceForm(axis.name, influence, this.act)));
    this.faults.offer(axis.faults(id));
    this.draw();
  }

  draw() {
    for (const { name, value } of this.rows ?? []) {
      const unit = this.model.unit(name);
      setText(value, valueWithUnit(this.model.store.latest(name), unit));
    }
    const node = this.model.state.nodes[this.node];
    setText(this.state, node ? [node.state, node.device].filter(Boolean).join(", ") : "");
  }
}
