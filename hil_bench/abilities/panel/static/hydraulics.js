// What the elements of an axis are: their channels, and the faults that each may have.

const OF_SUPPLY = new Set(["drop_supply", "wear_pump", "sag_relief", "lose_gas", "clog_filter"]);
const SUPPLIED = new Set(["P_S", "Q_S", "T_oil", "filter_drop"]);
const FIRST = ["break_wire", "freeze", "silence"];

export class Axis {
  constructor(model, name) {
    this.model = model;
    this.name = name;
    this.machine = model.hello.machines[name] ?? {};
    this.circuit = this.machine.circuit ?? null;
    this.supply = this.machine.supply ?? "";
    const { devices, ecus, fault_targets: targets = {} } = model.hello;
    this.devices = { ...devices, ...ecus };
    this.names = Object.keys(this.devices);
    this.targets = targets;
    this.valve = (targets.valves ?? []).find((each) => this.isOurs(each)) ?? "";
    this.sensors = (targets.sensors ?? []).filter((each) => this.isOurs(each) || (!this.circuit && this.isFree(each)));
  }

  isOurs(target) {
    return this.devices[this.node(target)]?.axis === this.name;
  }

  // Signals of devices that belong to no axis, such as objects bound to the plant.
  isFree(target) {
    return (this.devices[this.node(target)]?.axis ?? null) === null;
  }

  // Return the node of a fault target such as NODE.SIGNAL.
  node(target) {
    return this.names.find((name) => target === name || target.startsWith(`${name}.`)) ?? target;
  }

  // Return the channels of the plant itself.
  get quantities() {
    const begin = `${this.name}.`;
    return this.model.store.channels.map(({ name }) => name).filter((name) => name.startsWith(begin) && !name.slice(begin.length).includes("."));
  }

  // Return what is plotted at first: what its kind says, or all; and what its sensors measure.
  get plots() {
    const named = (this.machine.plots ?? []).map((each) => `${this.name}.${each}`).filter((name) => this.model.store.number(name) >= 0);
    const wanted = named.length ? named : this.quantities;
    const units = new Set(wanted.map((name) => this.model.unit(name)));
    const measured = this.sensors.map((each) => `${each}.measured`).filter((name) => !this.circuit || (units.has(this.model.unit(name)) && this.model.unit(name) !== "Pa"));
    return [...wanted, ...measured];
  }

  // Return the channels of an element: plant, valve or supply.
  channels(id) {
    const short = (name) => name.slice(this.name.length + 1);
    const spool = (name) => this.circuit && this.valve && short(name).startsWith("spool_");
    const pick = {
      plant: (name) => !SUPPLIED.has(short(name)) && !spool(name),
      valve: (name) => Boolean(spool(name)),
      supply: (name) => SUPPLIED.has(short(name)),
    };
    return this.quantities.filter(pick[id]);
  }

  // Return the faults of an element, each [kind, target, keys].
  faults(id) {
    const own = this.of(this.name);
    if (id === "supply") return [...(this.supply ? this.of(this.supply) : own)].filter(([kind]) => OF_SUPPLY.has(kind));
    const worn = own.filter(([kind]) => kind === "wear_spool");
    if (id === "valve") return [...this.of(this.valve), ...worn];
    if (id === "plant") return own.filter(([kind]) => (!OF_SUPPLY.has(kind) || !this.circuit) && (kind !== "wear_spool" || !this.valve));
    const node = this.node(id);
    return node === id ? this.of(id) : [...this.of(id), ...this.of(node)];
  }

  // Return the three faults of a sensor that a click causes, where it can have them.
  quick(sensor) {
    const all = this.faults(sensor);
    return FIRST.map((kind) => all.find((each) => each[0] === kind)).filter(Boolean);
  }

  of(target) {
    const kinds = Object.entries(this.model.hello.fault_kinds ?? {});
    return kinds.filter(([, targets]) => Object.hasOwn(targets, target)).map(([kind, targets]) => [kind, target, targets[target]]);
  }

  get hasFault() {
    const mine = (target) => target === this.name || (this.supply && target === this.supply) || this.isOurs(target);
    return this.model.state.faults.some(({ target }) => mine(target));
  }

  // Return the quantity that says most of it, for a small picture.
  get headline() {
    const names = this.quantities;
    return names.find((name) => /\.(position|angle)$/.test(name)) ?? names[0];
  }
}
