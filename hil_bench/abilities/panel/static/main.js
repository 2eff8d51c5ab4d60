// The page: one model, one link, and a view a tab.

import { BusView } from "./bus.js";
import { DevicesView } from "./devices.js";
import { button, el, setText } from "./dom.js";
import { FaultsView } from "./faults.js";
import { showKeys } from "./help.js";
import { LayoutView } from "./layout.js";
import { Link } from "./link.js";
import { LoopView } from "./loop.js";
import { MachineView } from "./machine.js";
import { Model } from "./model.js";
import { Others } from "./others.js";
import { RecordView } from "./record.js";
import { ScopeView } from "./scope.js";
import { takeUnits, UnitsControl } from "./units.js";
import { WorkView } from "./work.js";

const STILL = 2000; // without a row, time stands still [ms]
const SILENT = 4000; // without a beat of the panel, which come each second, nothing is live [ms]
const LONGEST = 100; // between two drawings where no rows come [ms]

const link = new Link();
const model = new Model(link);
const banner = document.getElementById("banner");
const tabs = document.getElementById("tabs");
const main = document.getElementById("main");
let shown = null;
let words = "connecting ...";
let lastRow = performance.now();

const VIEWS = [
  ["machine", "Machine", MachineView],
  ["scope", "Scope", ScopeView],
  ["devices", "Devices", DevicesView],
  ["bus", "Bus", BusView],
  ["faults", "Faults", FaultsView],
  ["loop", "Loop", LoopView],
  ["record", "Record as a test", RecordView],
  ["layout", "Layout", LayoutView],
  ["work", "Work", WorkView],
];

const views = VIEWS.map(([id, title, View]) => {
  const tab = button(title, () => show(views.find((each) => each.id === id)), {
    id: `tab-${id}`,
    role: "tab",
    "aria-controls": `view-${id}`,
    "aria-selected": "false",
    tabindex: "-1",
  });
  const panel = el("section", {
    id: `view-${id}`,
    role: "tabpanel",
    "aria-labelledby": tab.id,
    tabindex: "0",
    hidden: true,
  });
  tabs.append(tab);
  main.append(panel);
  return { id, tab, panel, view: new View(panel, model) };
});

let offered = views;
const layout = views.find(({ id }) => id === "layout");
layout.view.offer = () => show(layout); // that of --layout comes first

function show(wanted) {
  if (shown) {
    shown.panel.hidden = true;
    shown.tab.setAttribute("aria-selected", "false");
    shown.tab.tabIndex = -1;
    shown.view.hide?.();
  }
  shown = wanted;
  shown.panel.hidden = false;
  shown.tab.setAttribute("aria-selected", "true");
  shown.tab.tabIndex = 0;
  shown.view.show?.();
}

document.addEventListener("keydown", (event) => {
  const inField = event.target.closest?.("input, select, textarea");
  if (inField || event.ctrlKey || event.altKey || event.metaKey) return;
  const wanted = offered[Number(event.key) - 1];
  if (event.key === "?") showKeys(offered);
  else if (document.querySelector("dialog[open]")) return;
  else if (wanted) {
    show(wanted);
    wanted.tab.focus();
  } else if (event.target.role === "tab" && ["ArrowRight", "ArrowLeft"].includes(event.key)) {
    const step = event.key === "ArrowRight" ? 1 : offered.length - 1;
    show(offered[(offered.indexOf(shown) + step) % offered.length]);
    shown.tab.focus();
  } else if (shown.view.key?.(event)) {
    event.preventDefault();
  }
});

function say(text) {
  words = text;
  drawBanner();
}

// Return why what is shown is not what the bench does now, and true where it stands still itself.
function trouble() {
  const [now, at] = [performance.now(), `${model.time.toFixed(3)} s`];
  if (words) return [words, false];
  if (now - link.heard > SILENT) return [`the panel has sent nothing since ${at} of bench time: it, or the network, is held up, and nothing here is live`, false];
  const isBench = model.hello && (!model.hello.work || model.hello.work.is_bench);
  if (!isBench || now - lastRow < STILL) return ["", false];
  if (now - model.missedAt < SILENT) return [`nothing newer than ${at} has come: this page, or the line to it, is too slow`, false];
  const cause = "syncs" in model.health ? "no SYNC comes, or its process is held up" : "its process is held up";
  return [`bench time stands still at ${at}: ${cause}`, true];
}

function drawBanner() {
  const [text, isStill] = trouble();
  banner.hidden = !text;
  if (banner.dataset.text !== text) {
    banner.dataset.text = text;
    banner.replaceChildren(text);
    for (const name of (text && !model.hello && model.benches) || []) {
      if (model.benches.length > 1) {
        banner.append(" ", button(name, () => model.link.request("choose", { bench: name })));
      }
    }
  }
  document.body.classList.toggle("is-away", Boolean(text) && !isStill);
}

// Offer the views that what runs has something for.
function offerViews(hello) {
  const isBench = !hello.work || hello.work.is_bench;
  for (const { id, tab } of views) {
    tab.hidden = id === "work" ? !hello.work : !isBench && id !== "scope";
    if (id === "scope" && !hello.channels.length) tab.hidden = true;
    if (id === "work") setText(tab, hello.work ? capital(hello.work.verb) : "Work");
  }
  offered = views.filter(({ tab }) => !tab.hidden);
  offered.forEach(({ tab }, number) => {
    tab.title = `key ${number + 1}`;
  });
  if (shown.tab.hidden) show(offered.at(-1));
}

function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

const picker = document.getElementById("benches");
picker.addEventListener("change", () => link.request("choose", { bench: picker.value }));

function offerBenches({ bench, benches }) {
  picker.hidden = benches.length < 2 || !bench;
  picker.replaceChildren(...benches.map((name) => el("option", { value: name, selected: name === bench }, name)));
}

const units = new UnitsControl(() => model.hello && views.forEach(({ view }) => (view.changeUnits ?? view.begin)?.call(view, model.hello)));
document.getElementById("tabs").before(units.root);
banner.after(new Others(model).line);

link.on("panel", (status) => {
  model.benches = status.benches;
  if (!status.bench && model.hello) {
    shown.view.draw?.(); // what came last
    model.hello = null;
  }
  offerBenches(status);
  banner.dataset.text = "";
  say(status.bench ? "" : status.words);
});
link.on("hello", (hello) => {
  lastRow = performance.now();
  takeUnits(hello.units);
  units.begin();
  model.begin(hello);
  setText(document.getElementById("bench-name"), hello.name);
  document.title = `${hello.name} – hil-bench`;
  offerViews(hello);
  for (const { view } of views) view.begin?.(hello);
});
link.on("rows", () => {
  lastRow = performance.now();
});
link.on("lost", () => {
  if (link.isRefused) return;
  const ending = words.match(/^.* has ended/)?.[0];
  const silence = "the panel does not answer; it is asked again every second";
  say(ending ? `${ending}, and ${silence}` : `${silence}. Has hil-bench panel ended?`);
});
link.on("refused", (message) => {
  model.hello = null;
  if (message.words.includes("secret")) askForSecret(message.words);
  else {
    link.isRefused = false;
    say(message.words);
  }
});

function askForSecret(text) {
  const field = el("input", { type: "password", "aria-label": "password", autocomplete: "current-password" });
  const form = el("form", { onsubmit: (event) => { event.preventDefault(); say("connecting ..."); link.connect(field.value); } },
    field, el("button", { type: "submit" }, "Enter"));
  say(`${text}; open the address that hil-bench panel prints, or give the password`);
  banner.append(" ", form);
}

const brief = document.getElementById("brief");

// Show the health in the header: a part that is bad in the colour of danger.
function drawBrief() {
  const parts = model.brief();
  while (brief.children.length < parts.length) brief.append(el("span"));
  while (brief.children.length > parts.length) brief.lastChild.remove();
  parts.forEach(([text, isBad], number) => {
    setText(brief.children[number], text);
    brief.children[number].classList.toggle("bad", Boolean(isBad));
  });
}

// Stop what runs: at once where a machine may move, after a question where it is a bench alone.
const stop = document.getElementById("stop");
stop.addEventListener("click", async () => {
  const isBench = !model.hello?.work;
  if (isBench && !confirm("End the run of this bench?")) return;
  try {
    await link.request("stop", {});
  } catch (error) {
    say(error.message);
  }
});
document.getElementById("keys").addEventListener("click", () => showKeys(offered));

const FRAMES = { count: 0, begin: performance.now(), rate: 0, rows: 0, drawn: 0 };

function draw() {
  requestAnimationFrame(draw);
  FRAMES.count += 1;
  const now = performance.now();
  if (now - FRAMES.begin > 1000) {
    FRAMES.rate = (FRAMES.count * 1000) / (now - FRAMES.begin);
    FRAMES.count = 0;
    FRAMES.begin = now;
    drawBanner();
  }
  stop.disabled = !model.hello;
  setText(document.getElementById("clock"), model.hello ? `${model.time.toFixed(2)} s` : "–");
  drawBrief();
  const rows = model.store.count + model.store.shift;
  if (model.hello && (rows !== FRAMES.rows || now - FRAMES.drawn > LONGEST)) {
    FRAMES.rows = rows;
    FRAMES.drawn = now;
    shown.view.draw?.();
  }
}

window.hilBench = { model, link, views, frames: FRAMES };
show(views[0]);
offerViews({ channels: [[]] });
say("connecting ...");
link.connect(decodeURIComponent(location.hash.slice(1)));
requestAnimationFrame(draw);
window.addEventListener("hashchange", () => location.reload());
