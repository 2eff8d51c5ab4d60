// The trigger of the scope: a channel that crosses a level or is beyond it, or something that happens.

import { el, labelled, select } from "./dom.js";
import { shown } from "./units.js";

const EVENTS = [["fault", "a fault begins"], ["emcy", "an EMCY comes"], ["state", "a node changes its state"], ["mark", "a mark is set"]];
const CONDITIONS = [["rises", "rises above"], ["falls", "falls below"], ["above", "is above"], ["below", "is below"]];

// Stops the scope when a channel crosses a level or is beyond it, or when something happens.
export class Trigger {
  constructor(model, fire) {
    this.model = model;
    this.fire = fire;
    this.seen = 0;
    this.channel = select([], { "aria-label": "channel of the trigger" });
    this.condition = select(CONDITIONS, { "aria-label": "condition of the trigger" });
    this.level = el("input", { type: "number", step: "any", value: 0, "aria-label": "level, in the unit shown" });
    this.armed = el("input", { type: "checkbox", onchange: () => this.arm() });
    this.root = el("div", { class: "stack" }, this.channel, this.condition, this.level, labelled("armed", this.armed));
  }

  begin(hello) {
    const names = [...EVENTS.map(([what, text]) => [`:${what}`, text]), ...hello.channels.map(([name, unit]) => [name, `${name} [${shown(unit).symbol}]`])];
    this.channel.replaceChildren(...names.map(([value, text]) => el("option", { value }, text)));
    this.armed.checked = false;
  }

  arm() {
    this.seen = this.model.store.last;
  }

  look(isLive) {
    const isEvent = this.channel.value.startsWith(":");
    this.condition.disabled = this.level.disabled = isEvent;
    if (!this.armed.checked || !isLive) return;
    const what = this.channel.value.slice(1);
    const time = isEvent ? this.model.events.find((each) => each.what === what && each.time > this.seen)?.time : this.crossing();
    if (!isEvent) this.seen = this.model.store.last;
    if (time === undefined) return;
    this.armed.checked = false;
    this.fire(time);
  }

  crossing() {
    const { store } = this.model;
    const number = store.number(this.channel.value);
    const level = Number(this.level.value) * shown(this.model.unit(this.channel.value)).factor;
    const sign = ["rises", "above"].includes(this.condition.value) ? 1 : -1;
    const isEdge = ["rises", "falls"].includes(this.condition.value);
    const column = store.columns[number];
    for (let row = Math.max(1, store.find(this.seen)); row < store.count; row += 1) {
      const isBeyond = sign * (column[row] - level) > 0;
      if (isBeyond && !(isEdge && sign * (column[row - 1] - level) > 0)) return store.times[row];
    }
    return undefined;
  }
}
