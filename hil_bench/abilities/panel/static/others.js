// A line where somebody else touches the bench: another page, a shell, a program.

import { el, setText } from "./dom.js";
import { describe } from "./record.js";

const LASTS = 8000; // [ms]
const TOUCHES = { set_plant: ["axis", "quantity"], set_object: ["node", "name"], begin_fault: ["kind", "target"], clear_fault: ["number"] };

export class Others {
  constructor(model) {
    this.model = model;
    this.own = [];
    this.line = el("p", { id: "others", role: "status", "aria-live": "polite", hidden: true });
    this.timer = null;
    model.link.asked = (action, fields) => this.ask(action === "fault" ? "begin_fault" : action, fields);
    model.link.on("command", (command) => this.take(command));
    model.link.on("hello", () => {
      this.own = [];
      this.begun = false;
    });
    model.link.on("rows", () => {
      this.begun = true; // what came before is history
    });
  }

  ask(action, fields) {
    if (!TOUCHES[action]) return;
    this.own.push(mark(action, fields));
    if (this.own.length > 100) this.own.shift();
  }

  take(command) {
    if (!TOUCHES[command.do] || !this.begun) return;
    const place = this.own.indexOf(mark(command.do, command.fields));
    if (place >= 0) {
      this.own.splice(place, 1);
      return;
    }
    setText(this.line, `somebody else, at ${command.time.toFixed(2)} s: ${describe(command)}`);
    this.line.hidden = false;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.line.hidden = true;
    }, LASTS);
  }
}

// Return what a request and its command have in common.
function mark(action, fields) {
  const value = action.startsWith("set_") ? fields.value : "";
  return JSON.stringify([action, ...TOUCHES[action].map((name) => fields[name] ?? null), value]);
}
