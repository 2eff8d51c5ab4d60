// The devices: a card a node with its states, words bit by bit, last EMCY and its objects; and those
// on J1939.

import { emcyText, hex } from "./decode.js";
import { button, chips, el, labelled, setText, svg } from "./dom.js";
import { EcuCard } from "./ecus.js";
import { Binding, readPicture } from "./bound.js";

const NMT_STATES = ["OFF", "INITIALISING", "PRE-OPERATIONAL", "OPERATIONAL", "STOPPED"];
const VALVE_STATES = ["INIT", "DISABLED", "HOLD", "ACTIVE", "FAULT_REACTION", "FAULT_HOLD", "FAULT_DISABLED", "FAULT_INIT"];
const BITS = {
  "0x6040.00": ["control word", ["D initialise", "H hold", "M active", "R reset"]],
  "0x6041.00": ["status word", ["D initialised", "H hold or active", "M active", "R ready"]],
};
const PERIOD = 250; // between two looks at the words [ms]

export class DevicesView {
  constructor(root, model) {
    this.model = model;
    this.root = el("div", { class: "cards" });
    this.cards = new Map();
    root.append(this.root);
  }

  begin(hello) {
    this.cards = new Map(hello.nodes.map((name) => [name, new Card(name, hello.devices?.[name] ?? {}, this.model)]));
    for (const [name, device] of Object.entries(hello.ecus ?? {})) this.cards.set(name, new EcuCard(name, device, this.model));
    this.root.replaceChildren(...[...this.cards.values()].map((card) => card.root));
  }

  draw() {
    for (const card of this.cards.values()) card.draw();
  }
}

class Card {
  constructor(name, device, model) {
    this.name = name;
    this.model = model;
    this.isValve = device.kind === "valve_408";
    this.nmt = chips(NMT_STATES);
    this.device = chips(this.isValve ? VALVE_STATES : []);
    this.words = this.isValve ? Object.entries(BITS).map(([object, [title, names]]) => new Word(object, title, names)) : [];
    this.errors = el("p", {});
    this.browser = new ObjectBrowser(name, model);
    this.lookedAt = 0;
    const picture = this.picture(device.page?.svg);
    const about = [device.node_id === undefined ? "" : `node-ID ${device.node_id}`, device.kind, device.axis].filter(Boolean);
    this.root = el("article", { class: "card" },
      el("h2", {}, name, el("span", { class: "quiet" }, ` ${about.join(" · ")}`)), picture,
      el("h3", {}, "NMT state"), this.nmt.root,
      ...(this.isValve ? [el("h3", {}, "Device state"), this.device.root, ...this.words.map((word) => word.root)] : []),
      el("h3", {}, "Errors"), this.errors,
      this.browser.root);
  }

  // Return the picture that the kind of the device brings, if it does.
  picture(text) {
    const found = text ? readPicture(text) : null;
    if (!found) return null;
    if (typeof found === "string") return el("p", { class: "problem" }, found);
    const image = svg("svg", { viewBox: found.box.join(" "), role: "img", "aria-label": `picture of ${this.name}` }, found.root);
    this.binding = new Binding(found.root, this.model, this.name);
    return el("div", { class: "drawing small" }, image);
  }

  draw() {
    this.binding?.draw();
    const node = this.model.state.nodes[this.name];
    if (!node) return;
    this.nmt.light(node.state);
    this.device.light(node.device);
    const last = this.model.emcy[this.name];
    const active = node.errors.map(emcyText).join(", ") || "none active";
    const seen = last ? `; last EMCY ${emcyText(last.code)}, seen at ${last.time.toFixed(3)} s` : "";
    const twice = node.foreign ? `; node-ID twice on the bus: ${node.foreign} frames of another device` : "";
    setText(this.errors, active + seen + twice);
    this.errors.classList.toggle("problem", node.errors.length > 0 || Boolean(node.foreign));
    const now = performance.now();
    if (this.words.length && now - this.lookedAt > PERIOD) {
      this.lookedAt = now;
      for (const word of this.words) node.state === "OFF" ? word.show(null) : word.look(this.name, this.model);
    }
  }
}

class Word {
  constructor(object, title, names) {
    this.object = object;
    this.title = el("h3", {}, title);
    this.text = title;
    this.bits = names.map((name, bit) => el("li", { class: "chip" }, `${bit} ${name}`)).reverse();
    this.root = el("div", {}, this.title, el("ul", { class: "chips" }, ...this.bits));
  }

  async look(node, model) {
    this.show(await model.request("get_object", { node, name: this.object }).catch(() => null));
  }

  show(value) {
    setText(this.title, value === null ? `${this.text}: not read` : `${this.text} ${hex(value, 4)}`);
    this.bits.forEach((chip, n) => chip.classList.toggle("lit", Boolean((value >> (this.bits.length - 1 - n)) & 1)));
  }
}

class ObjectBrowser {
  constructor(node, model) {
    this.node = node;
    this.model = model;
    this.filter = el("input", { type: "search", placeholder: "index or name", "aria-label": `search objects of ${node}`, oninput: () => this.narrow() });
    this.writes = el("input", { type: "checkbox", onchange: () => this.body.classList.toggle("writes", this.writes.checked) });
    this.body = el("tbody");
    this.problem = el("p", { class: "problem", role: "alert" });
    this.rows = [];
    this.root = el("details", { ontoggle: () => this.load() }, el("summary", {}, "Objects"),
      el("div", { class: "row" }, this.filter, button("Read all shown", () => this.readAll()), labelled("allow writing", this.writes)),
      this.problem,
      el("div", { class: "scroller short", tabindex: "0", role: "region", "aria-label": `objects of ${node}` }, el("table", {}, this.body)));
  }

  async load() {
    if (!this.root.open || this.rows.length) return;
    try {
      const objects = await this.model.request("objects", { node: this.node });
      this.rows = objects.map((object) => this.row(object));
      this.body.replaceChildren(...this.rows.map(({ root }) => root));
      this.narrow();
    } catch (error) {
      setText(this.problem, error.message);
    }
  }

  row(object) {
    const value = el("output", { class: "figure" });
    const field = el("input", { "aria-label": `new value of ${object.name}`, size: 8 });
    const read = () => this.read(object.name, value);
    const write = () => this.write(object, field.value, value);
    const root = el("tr", {},
      el("th", { scope: "row", class: "figure" }, object.name),
      el("td", {}, object.text, el("span", { class: "quiet" }, ` ${object.type} ${object.access}`)),
      el("td", {}, value),
      el("td", {}, button("read", read, { "aria-label": `read ${object.name}` }),
        object.is_writable ? el("span", { class: "write row" }, field, button("set", write, { "aria-label": `set ${object.name}` })) : null));
    return { root, object, read };
  }

  narrow() {
    const words = this.filter.value.toLowerCase().split(/\s+/);
    for (const { root, object } of this.rows) {
      const text = `${object.name} ${object.text}`.toLowerCase();
      root.hidden = !words.every((word) => text.includes(word));
    }
  }

  async readAll() {
    for (const { root, read } of this.rows) if (!root.hidden) await read();
  }

  async read(name, output) {
    try {
      const value = await this.model.request("get_object", { node: this.node, name });
      setText(output, value === null ? "no data" : typeof value === "object" ? `hex ${value.hex}` : typeof value === "number" && Number.isInteger(value) ? `${value} (${hex(value < 0 ? value + 2 ** 32 : value, 1)})` : String(value));
    } catch (error) {
      setText(output, error.message);
    }
  }

  async write(object, text, output) {
    const value = object.is_number ? Number(text) : text;
    if (object.is_number && (text.trim() === "" || Number.isNaN(value))) {
      setText(this.problem, `${object.name}: ${text || "nothing"} is not a number`);
      return;
    }
    try {
      await this.model.request("set_object", { node: this.node, name: object.name, value });
      setText(this.problem, "");
      await this.read(object.name, output);
    } catch (error) {
      setText(this.problem, error.message);
    }
  }
}
