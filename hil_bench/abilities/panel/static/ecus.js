// The J1939 devices: a card each with its address claim, its trouble codes, and its signals.

import { chips, el, setText } from "./dom.js";
import { valueText } from "./units.js";

const CLAIM_STATES = ["off", "claiming", "claimed", "cannot claim"];
const PERIOD = 500; // between two looks at the signals [ms]

export class EcuCard {
  constructor(name, device, model) {
    this.name = name;
    this.model = model;
    this.isValve = device.kind === "auxiliary_valve"; // its signals are parts of the full flow
    this.claim = chips(CLAIM_STATES);
    this.title = el("h3", {}, "Address claim");
    this.codes = el("p", {});
    this.problem = el("p", { class: "problem", role: "alert" });
    this.signals = Object.entries(device.signals).map(([signal, { unit, is_settable: isSettable }]) => this.signal(signal, unit, isSettable));
    this.lookedAt = 0;
    const about = ["J1939", device.kind, device.axis].filter(Boolean);
    this.root = el("article", { class: "card" },
      el("h2", {}, name, el("span", { class: "quiet" }, ` ${about.join(" · ")}`)),
      this.title, this.claim.root,
      el("h3", {}, "Trouble codes"), this.codes,
      el("h3", {}, "Signals"), this.problem,
      el("table", { class: "signals" }, el("tbody", {}, ...this.signals.map(({ root }) => root))));
  }

  draw() {
    const ecu = this.model.state.ecus?.[this.name];
    if (!ecu) return;
    this.claim.light(ecu.state);
    setText(this.title, ecu.address < 254 ? `Address claim: ${ecu.address}` : "Address claim: no address");
    setText(this.codes, ecu.codes.map(([spn, fmi]) => `SPN ${spn} FMI ${fmi}`).join(", ") || "none active");
    this.codes.classList.toggle("problem", ecu.codes.length > 0);
    const now = performance.now();
    if (now - this.lookedAt < PERIOD) return;
    this.lookedAt = now;
    for (const { look } of this.signals) look();
  }

  signal(name, unit, isSettable) {
    const value = el("span", { class: "figure" });
    const symbol = unit === "-" ? "" : ` ${unit}`;
    const words = this.isValve ? (found) => `${valueText(found, "-")} %` : (found) => `${Number(found.toPrecision(6))}${symbol}`;
    const field = isSettable ? el("input", { type: "number", step: "any", size: 8, "aria-label": `new value of ${this.name}.${name}` }) : null;
    const look = async () => {
      try {
        const found = await this.model.request("get_object", { node: this.name, name });
        setText(value, found === null ? "no value" : words(found));
      } catch {
        setText(value, "not read");
      }
    };
    const set = async (event) => {
      event.preventDefault();
      try {
        await this.model.request("set_object", { node: this.name, name, value: Number(field.value) });
        setText(this.problem, "");
        await look();
      } catch (error) {
        setText(this.problem, error.message);
      }
    };
    const form = field ? el("form", { class: "row", onsubmit: set }, field, el("button", { type: "submit", "aria-label": `set ${this.name}.${name}` }, "set")) : null;
    const root = el("tr", {}, el("th", { scope: "row" }, name), el("td", {}, value), el("td", {}, form));
    return { root, look };
  }
}
