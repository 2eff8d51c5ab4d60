// The keys of the page, in a dialogue.

import { button, el } from "./dom.js";

const KEYS = {
  "everywhere": [["Tab", "next control; parts of the drawing, too"], ["Enter", "press a button, choose a part of the drawing"], ["← →", "next view, on the tabs"], ["?", "this list"], ["Esc", "close it"]],
  "Scope": [["space", "pause, live"], ["l", "live"], ["← →", "earlier, later"], ["a, b", "cursor A, B at the pointer"], ["r", "record into a file, stop recording"]],
};

export function showKeys(views) {
  const open = document.querySelector("dialog[open]");
  if (open) {
    open.close();
    return;
  }
  const numbers = views.map(({ tab }, number) => [String(number + 1), tab.textContent]);
  const tables = Object.entries({ views: numbers, ...KEYS }).map(([title, rows]) =>
    el("div", {}, el("h3", {}, title), el("table", {}, el("tbody", {}, ...rows.map(([key, text]) =>
      el("tr", {}, el("th", { scope: "row" }, el("kbd", {}, key)), el("td", {}, text)))))));
  const dialog = el("dialog", { "aria-label": "keys of this page", onclose: () => dialog.remove() },
    el("div", { class: "columns" }, ...tables), button("Close", () => dialog.close(), { class: "wide" }));
  document.body.append(dialog);
  dialog.showModal();
}
