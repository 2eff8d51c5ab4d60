// The connection to the panel: lines in, requests out, and again and again where it is lost.

const RETRY = 1000; // [ms]
const PATIENCE = 150_000; // with an answer [ms]; a test may take a while

export class Link {
  constructor() {
    this.takers = new Map();
    this.open = new Map();
    this.number = 0;
    this.bytes = 0;
    this.heard = performance.now(); // anything at all
    this.socket = null;
    this.isRefused = false;
    this.token = "";
  }

  on(type, take) {
    this.takers.set(type, [...(this.takers.get(type) ?? []), take]);
  }

  tell(type, message) {
    for (const take of this.takers.get(type) ?? []) take(message);
  }

  connect(token) {
    this.token = token;
    this.isRefused = false;
    const socket = new WebSocket(`ws://${location.host}/feed`);
    socket.binaryType = "arraybuffer";
    const decoder = new TextDecoder();
    socket.onopen = () => socket.send(JSON.stringify({ token }));
    socket.onmessage = (event) => {
      this.bytes += event.data.byteLength;
      this.heard = performance.now();
      for (const line of decoder.decode(event.data).split("\n")) {
        if (line) this.take(JSON.parse(line));
      }
    };
    socket.onclose = () => this.lose(socket);
    this.socket = socket;
  }

  lose(socket) {
    if (socket !== this.socket) return;
    for (const { refuse } of this.open.values()) refuse(new Error("the connection is lost"));
    this.open.clear();
    this.tell("lost", {});
    if (!this.isRefused) setTimeout(() => this.connect(this.token), RETRY);
  }

  take(message) {
    if (message.type === "answer") {
      const waiting = this.open.get(message.id);
      this.open.delete(message.id);
      if (!waiting) return;
      clearTimeout(waiting.timer);
      if ("error" in message) waiting.refuse(new Error(message.error));
      else waiting.accept(message.value);
      return;
    }
    if (message.type === "refused") this.isRefused = true;
    this.tell(message.type, message);
  }

  // Send the panel a body, and return the file that it makes of it.
  async post(path, body) {
    const answer = await fetch(path, { method: "POST", headers: { Authorization: `Bearer ${this.token}` }, body });
    if (!answer.ok) throw new Error(await answer.text());
    return answer.blob();
  }

  request(action, fields = {}) {
    return new Promise((accept, refuse) => {
      if (this.socket?.readyState !== WebSocket.OPEN) {
        refuse(new Error("the panel is not connected"));
        return;
      }
      const id = ++this.number;
      this.asked?.(action, fields);
      const timer = setTimeout(() => {
        this.open.delete(id);
        refuse(new Error("no answer"));
      }, PATIENCE);
      this.open.set(id, { accept, refuse, timer });
      this.socket.send(JSON.stringify({ id, do: action, ...fields }));
    });
  }
}
