// What is known of the bench, for all views.

import { Store } from "./store.js";

const MOST_FRAMES = 5000;
const MOST_MARKS = 200;

export class Model {
  constructor(link) {
    this.link = link;
    this.store = new Store();
    this.hello = null;
    this.benches = [];
    this.state = { nodes: {}, ecus: {}, faults: [] };
    this.health = {};
    this.missed = 0;
    this.missedAt = -Infinity; // by the page's clock [ms]
    this.frames = [];
    this.senders = new Map();
    this.commands = [];
    this.spans = [];
    this.emcy = {};
    this.events = [];
    link.on("rows", ({ rows }) => rows.forEach((row) => this.store.push(row)));
    link.on("state", (state) => this.takeState(state));
    link.on("health", (health) => {
      this.health = health;
    });
    link.on("frames", ({ frames }) => this.takeFrames(frames));
    link.on("event", (event) => this.takeEvent(event));
    link.on("command", (command) => this.takeCommand(command));
    link.on("missed", ({ messages }) => {
      this.missed += messages;
      this.missedAt = performance.now();
    });
  }

  begin(hello) {
    this.hello = hello;
    this.store.begin(hello.channels);
    this.state = { nodes: {}, faults: [] };
    this.health = {};
    this.frames = [];
    this.senders = new Map();
    this.commands = [];
    this.spans = [];
    this.emcy = {};
    this.events = [];
    this.missed = 0;
  }

  get time() {
    return Math.max(this.store.last, this.state.time ?? 0, this.health.time ?? 0);
  }

  get marks() {
    return this.commands.filter((command) => command.do === "mark").slice(-MOST_MARKS);
  }

  unit(channel) {
    return this.store.channels[this.store.number(channel)]?.unit ?? "";
  }

  takeState(state) {
    for (const [name, node] of Object.entries(state.nodes)) {
      const before = this.state.nodes[name];
      for (const code of node.errors) {
        if (!before || before.errors.includes(code)) continue; // older than this page: since when, it does not know
        this.emcy[name] = { code, time: state.time };
        this.note("emcy", state.time);
      }
      if (before && (before.state !== node.state || before.device !== node.device)) this.note("state", state.time);
    }
    this.state = state;
    for (const fault of state.faults) this.openSpan(fault.kind, fault.target, fault.begins);
  }

  takeEvent(event) {
    if (event.what !== "fault") return;
    if (event.begins) this.openSpan(event.kind, event.target, event.time);
    else {
      const span = this.spans.findLast(
        (each) => each.end === null && each.kind === event.kind && each.target === event.target,
      );
      if (span) span.end = event.time;
    }
  }

  openSpan(kind, target, begin) {
    const isKnown = this.spans.some(
      (span) => span.kind === kind && span.target === target && Math.abs(span.begin - begin) < 1e-6,
    );
    if (!isKnown) {
      this.spans.push({ kind, target, begin, end: null });
      this.note("fault", begin);
    }
    if (this.spans.length > MOST_MARKS) this.spans.shift();
  }

  takeCommand(command) {
    if (this.commands.some((each) => each.entry === command.entry)) return;
    this.commands.push(command);
    if (command.do === "mark") this.note("mark", command.time);
    if (this.commands.length > MOST_FRAMES) this.commands.shift();
  }

  // Keep what a trigger may wait for.
  note(what, time) {
    this.events.push({ what, time });
    if (this.events.length > MOST_MARKS) this.events.shift();
  }

  takeFrames(frames) {
    for (const [time, bus, way, id, data, isExtended, isRemote, fd] of frames) {
      const frame = { time, bus, way, id, data, isExtended, isRemote, fd };
      this.frames.push(frame);
      const key = `${bus}:${id}:${way}:${isExtended}:${fd > 0}`;
      const sender = this.senders.get(key) ?? { count: 0, times: [], frame };
      sender.count += 1;
      sender.frame = frame;
      sender.times.push(time);
      if (sender.times.length > 20) sender.times.shift();
      this.senders.set(key, sender);
    }
    if (this.frames.length > 2 * MOST_FRAMES) this.frames = this.frames.slice(-MOST_FRAMES);
    if (this.senders.size > 4096) this.senders.clear(); // a flood of identifiers
  }

  request(action, fields) {
    return this.link.request(action, fields);
  }

  // Return the parts of the header's line, each with true where it is bad.
  brief() {
    if (!this.hello) return [];
    const parts = [];
    const { lateness, overruns, bus_load: load } = this.health;
    const { work } = this.state;
    const tick = this.hello.tick_s * 1e6;
    if (work?.total) parts.push([`${work.done} of ${work.total} ${work.unit ?? ""}`.trim()]);
    if (lateness) parts.push([`late p99 ${timeText(lateness.p99_us)}`, lateness.p99_us > tick]);
    if (overruns !== undefined) parts.push([`${overruns} overran`, overruns > 1e-3 * (this.health.ticks ?? Infinity)]);
    if (load !== undefined) parts.push([`bus ${(load * 100).toFixed(1)} %`, load > 0.9]);
    const count = this.state.faults.length;
    const isBench = !this.hello.work || this.hello.work.is_bench;
    if (isBench) parts.push([count === 0 ? "no fault" : count === 1 ? "1 fault" : `${count} faults`]);
    if (this.state.recording) parts.push([`records since ${this.state.recording.begins.toFixed(1)} s`]);
    if (this.missed) parts.push([`this page missed ${this.missed} messages`, true]);
    return parts;
  }
}

function timeText(us) {
  return us < 1000 ? `${us.toFixed(0)} µs` : `${(us / 1000).toFixed(1)} ms`;
}
