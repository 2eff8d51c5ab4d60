// Layouts of one's own: items on a grid of twelve columns, made here and kept as NAME.layout.toml.

import { button, el, labelled, select, setText } from "./dom.js";
import { Axis } from "./hydraulics.js";
import { makeItem } from "./items.js";
import { COLUMNS, arrange, move, resize } from "./grid.js";
import { AddForm } from "./layout_form.js";

const MACHINE = "(this machine)";

export class LayoutView {
  constructor(root, model) {
    this.model = model;
    this.layout = { title: "", bench: "", items: [] };
    this.items = [];
    this.isEdited = false;
    this.names = select([], { "aria-label": "layout", onchange: () => this.open(this.names.value) });
    this.edit = button("Edit", () => this.setEdited(!this.isEdited), { "aria-pressed": "false" });
    this.name = el("input", { maxlength: 61, "aria-label": "name of the layout", placeholder: "name" });
    this.replaces = el("input", { type: "checkbox" });
    this.add = new AddForm(model, (content) => this.insert(content));
    this.said = el("span", { class: "quiet", role: "status" });
    this.problem = el("p", { class: "problem", role: "alert" });
    this.tools = el("div", { class: "toolbar", hidden: true }, this.add.root,
      el("form", { class: "row", onsubmit: (event) => this.save(event) }, this.name, labelled("replace", this.replaces), el("button", { type: "submit", class: "primary" }, "Save")));
    this.grid = el("div", { class: "grid" });
    root.append(el("div", { class: "toolbar" }, labelled("layout", this.names), this.edit, this.said), this.tools, this.problem, this.grid);
  }

  async begin() {
    try {
      const found = await this.model.request("layouts");
      this.bench = found.bench;
      this.names.replaceChildren(...[MACHINE, ...found.names].map((name) => el("option", { value: name }, name)));
      if (found.names.includes(this.opened)) await this.open(this.opened);
      else if (found.first) this.openFirst(found);
      else await this.open(MACHINE);
    } catch (error) {
      setText(this.problem, error.message);
    }
  }

  // Units have been chosen anew.
  changeUnits() {
    if (this.model.hello) this.build();
  }

  show() {
    this.isShown = true;
    this.build();
  }

  hide() {
    this.isShown = false;
    for (const { item } of this.items) item.hide?.();
  }

  // Open the layout of --layout, which may be in another folder.
  openFirst({ first: { path, layout }, names }) {
    const name = path.replace(/^.*[\\/]/, "").replace(/\.layout\.toml$/, "");
    if (!names.includes(name)) this.names.append(el("option", { value: "", disabled: true }, path));
    this.names.value = names.includes(name) ? name : "";
    this.name.value = name;
    this.take(layout, path);
    if (!this.opened) this.offer?.();
    this.opened = name;
  }

  async open(name) {
    this.opened = name;
    try {
      if (name === MACHINE) this.take(this.standard(), "");
      else this.take(await this.model.request("layout", { name }), name);
    } catch (error) {
      setText(this.problem, error.message);
      return;
    }
    this.names.value = name;
    this.name.value = name === MACHINE ? "" : name;
  }

  take(layout, from) {
    this.layout = layout;
    const isOther = layout.bench && this.bench && layout.bench !== this.bench;
    setText(this.problem, isOther ? `${from}: is a layout of ${layout.bench}; this bench is ${this.bench}` : "");
    setText(this.said, layout.title || from);
    this.build();
  }

  // Return a layout for any machine: its first axis, the plots of its kind, and the others' values.
  standard() {
    const axes = Object.keys(this.model.hello?.machines ?? {}).map((name) => new Axis(this.model, name));
    const items = [];
    if (axes.length) {
      items.push({ kind: "machine", column: 1, row: 1, width: 6, height: 10, axis: axes[0].name });
      items.push({ kind: "plot", column: 7, row: 1, width: 6, height: 10, channels: axes[0].plots.slice(0, 12) });
    }
    axes.slice(1, 25).filter((axis) => axis.headline).forEach((axis, n) =>
      items.push({ kind: "value", column: 1 + 3 * (n % 4), row: 11 + 2 * Math.floor(n / 4), width: 3, height: 2, channel: axis.headline }));
    return { title: "", bench: "", items };
  }

  setEdited(isEdited) {
    this.isEdited = isEdited;
    this.edit.setAttribute("aria-pressed", String(isEdited));
    this.tools.hidden = !isEdited;
    if (isEdited) this.add.begin();
    this.build();
  }

  // Make the items; only while they are shown, so that they cost nothing before.
  build() {
    if (!this.isShown || !this.model.hello) return;
    for (const { item } of this.items) item.hide?.();
    this.items = this.layout.items.map((content) => {
      const item = makeItem(content, this.model, (...words) => this.act(...words));
      const cell = el("div", { class: `cell cell-${content.kind}` }, ...(this.isEdited ? [this.handle(content)] : []), el("div", { class: "cell-body" }, item.root));
      this.place(cell, content);
      return { item, cell, content };
    });
    this.grid.replaceChildren(...sorted(this.items).map(({ cell }) => cell));
    this.grid.classList.toggle("edited", this.isEdited);
    for (const { item } of this.items) item.show?.();
  }

  place(cell, { column, row, width, height }) {
    cell.style.gridColumn = `${column} / span ${width}`;
    cell.style.gridRow = `${row} / span ${height}`;
    cell.style.setProperty("--rows", height);
  }

  // Return the bar of an item that is edited: dragged, or moved by the keys.
  handle(content) {
    const grip = el("button", { type: "button", class: "grip", "aria-label": `${content.kind}: arrows move it, with shift they size it, Delete removes it`, onkeydown: (event) => this.key(event, content), onpointerdown: (event) => this.drag(event, content, move) }, content.kind);
    const corner = el("span", { class: "corner", "aria-hidden": "true", onpointerdown: (event) => this.drag(event, content, resize) });
    return el("div", { class: "cell-head" }, grip, button("×", () => this.remove(content), { "aria-label": `remove ${content.kind}` }), corner);
  }

  key(event, content) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (event.key === "Delete") this.remove(content);
    else if (step) this.change(content, event.shiftKey ? resize : move, ...step);
    else return;
    event.preventDefault();
    event.stopPropagation();
    const same = this.items.find((each) => each.content === content);
    same?.cell.querySelector(".grip").focus();
  }

  drag(event, content, change) {
    event.preventDefault();
    const { width } = this.grid.getBoundingClientRect();
    const rows = parseFloat(getComputedStyle(this.grid).gridAutoRows) + parseFloat(getComputedStyle(this.grid).rowGap);
    const [x, y] = [event.clientX, event.clientY];
    const before = { ...content };
    const follow = (moved) => {
      Object.assign(content, before);
      change(content, Math.round(((moved.clientX - x) * COLUMNS) / width), Math.round((moved.clientY - y) / rows));
      this.place(this.items.find((each) => each.content === content).cell, content);
    };
    const end = () => {
      document.removeEventListener("pointermove", follow);
      arrange(this.layout.items, content);
      this.build();
    };
    document.addEventListener("pointermove", follow);
    document.addEventListener("pointerup", end, { once: true });
  }

  change(content, how, columns, rows) {
    how(content, columns, rows);
    arrange(this.layout.items, content);
    this.build();
  }

  insert(content) {
    const row = 1 + Math.max(0, ...this.layout.items.map((each) => each.row + each.height - 1));
    this.layout.items.push({ column: 1, row, ...content });
    this.build();
    this.items.at(-1).cell.scrollIntoView({ block: "nearest" });
  }

  remove(content) {
    this.layout.items = this.layout.items.filter((each) => each !== content);
    this.build();
  }

  async save(event) {
    event.preventDefault();
    const layout = { ...this.layout, bench: this.bench ?? "" };
    await this.act("save_layout", { name: this.name.value, layout, replaces: this.replaces.checked }, async ({ path }) => {
      this.opened = this.name.value;
      await this.begin();
      setText(this.said, `saved as ${path}`);
    });
  }

  async act(action, fields, then = () => {}) {
    try {
      const value = await this.model.request(action, fields);
      setText(this.problem, "");
      await then(value);
    } catch (error) {
      setText(this.problem, error.message);
    }
  }

  draw() {
    for (const { item } of this.items) item.draw();
  }
}

function sorted(items) {
  return [...items].sort((one, other) => one.content.row - other.content.row || one.content.column - other.content.column);
}
