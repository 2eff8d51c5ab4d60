// What a CAN frame says: its use by CiA 301, the values of a PDO by the mapping of its node.

const NMT = { 1: "start", 2: "stop", 128: "enter pre-operational", 129: "reset node", 130: "reset communication" };
const STATES = { 0: "boot-up", 4: "STOPPED", 5: "OPERATIONAL", 127: "PRE-OPERATIONAL" };
const BROADCASTS = { 0x000: "NMT", 0x080: "SYNC", 0x100: "TIME", 0x7e4: "LSS answer", 0x7e5: "LSS request" };
const FUNCTIONS = {
  0x080: "EMCY", 0x180: "TPDO1", 0x200: "RPDO1", 0x280: "TPDO2", 0x300: "RPDO2", 0x380: "TPDO3", 0x400: "RPDO3",
  0x480: "TPDO4", 0x500: "RPDO4", 0x580: "SDO answer", 0x600: "SDO request", 0x700: "heartbeat",
};
const EMCY = [
  [0xffff, 0x0000, "error reset"], [0xffff, 0x8110, "CAN overrun"], [0xffff, 0x8120, "CAN error passive"],
  [0xffff, 0x8130, "heartbeat or life guard lost"], [0xffff, 0x8140, "recovered from bus-off"],
  [0xffff, 0x8150, "transmit COB-ID collision"], [0xffff, 0x8210, "PDO too short"], [0xffff, 0x8220, "PDO too long"],
  [0xffff, 0x8240, "unexpected SYNC length"], [0xffff, 0x8250, "RPDO time-out"], [0xff00, 0x1000, "generic error"],
  [0xf000, 0x2000, "current"], [0xf000, 0x3000, "voltage"], [0xf000, 0x4000, "temperature"], [0xf000, 0x5000, "hardware"],
  [0xf000, 0x6000, "software"], [0xf000, 0x7000, "additional modules"], [0xff00, 0x8100, "communication"],
  [0xff00, 0x8200, "protocol"], [0xf000, 0x8000, "monitoring"], [0xff00, 0x9000, "external error"],
  [0xff00, 0xf000, "additional functions"], [0xff00, 0xff00, "device-specific"],
];

export function hex(number, digits) {
  return `0x${number.toString(16).toUpperCase().padStart(digits, "0")}`;
}

export function emcyText(code) {
  const found = EMCY.find(([mask, value]) => (code & mask) === value);
  return `${hex(code, 4)} ${found?.[2] ?? "unknown code"}`;
}

export class Decoder {
  constructor() {
    this.pdos = new Map();
    this.names = new Map();
    this.ecus = new Map();
  }

  begin(hello) {
    this.pdos = new Map();
    this.takeAddresses(hello, hello.ecus);
    this.names = new Map(Object.entries(hello.devices ?? {}).map(([name, { bus, node_id: id }]) => [`${bus}:${id}`, name]));
  }

  takePdos(pdos) {
    this.pdos = new Map(pdos.map((pdo) => [`${pdo.bus}:${pdo.id}`, pdo]));
  }

  use(frame) {
    const pdo = frame.isExtended || frame.fd ? undefined : this.pdos.get(`${frame.bus}:${frame.id}`);
    if (pdo) return `${pdo.node} ${pdo.pdo}`;
    if (frame.fd) return "CAN FD";
    if (frame.isExtended) return this.j1939Use(frame);
    if (frame.id in BROADCASTS) return BROADCASTS[frame.id];
    const [use, node] = [FUNCTIONS[frame.id & 0x780], frame.id & 0x7f];
    if (!use || !node) return "other";
    return `${this.names.get(`${frame.bus}:${node}`) ?? `node ${node}`} ${use}`;
  }

  // Name the sender of a 29-bit frame, where one of the bench's J1939 devices has the address, and the
  // parameter group.
  j1939Use(frame) {
    if (!this.ecus.size) return "extended";
    const source = frame.id & 0xff;
    const format = (frame.id >>> 16) & 0xff;
    const group = ((frame.id >>> 8) & 0x3ff00) | (format < 240 ? 0 : (frame.id >>> 8) & 0xff);
    return `${this.ecus.get(`${frame.bus}:${source}`) ?? `address ${source}`} PGN ${group}`;
  }

  // Take the addresses that the J1939 devices have claimed.
  takeAddresses(hello, ecus) {
    const found = Object.entries(ecus ?? {}).map(([name, { address }]) => [`${hello.ecus[name]?.bus}:${address}`, name]);
    this.ecus = new Map(found);
  }

  meaning(frame) {
    if (frame.isRemote) return "remote request";
    const bytes = Uint8Array.from(frame.data.match(/../g) ?? [], (pair) => parseInt(pair, 16));
    const pdo = frame.isExtended || frame.fd ? undefined : this.pdos.get(`${frame.bus}:${frame.id}`);
    if (pdo) return pdo.signals.map((signal) => signalText(signal, bytes)).join(", ");
    const use = frame.isExtended || frame.fd ? "" : (BROADCASTS[frame.id] ?? FUNCTIONS[frame.id & 0x780] ?? "");
    if (use === "NMT" && bytes.length === 2) {
      return `${NMT[bytes[0]] ?? `command ${bytes[0]}`}, ${bytes[1] ? `node ${bytes[1]}` : "all nodes"}`;
    }
    if (use === "heartbeat" && bytes.length === 1) return STATES[bytes[0] & 0x7f] ?? `state ${bytes[0]}`;
    if (use === "EMCY" && bytes.length === 8) return emcyText(bytes[0] | (bytes[1] << 8));
    if (use.startsWith("SDO") && bytes.length === 8) return sdoText(use, bytes);
    return "";
  }
}

function signalText(signal, bytes) {
  const value = valueOf(signal, bytes);
  const name = signal.text || signal.name;
  if (value === null) return `${name} –`;
  const isWord = /^0x604[01]/.test(signal.name);
  return `${name} ${isWord ? hex(value, 4) : typeof value === "number" && !Number.isInteger(value) ? value.toPrecision(6) : value}`;
}

// Return the value of a signal; null where the frame is too short for it.
export function valueOf({ type, shift, bits }, bytes) {
  if (shift + bits > 8 * bytes.length || bits === 0) return null;
  let whole = 0n;
  for (let i = bytes.length - 1; i >= 0; i -= 1) whole = (whole << 8n) | BigInt(bytes[i]);
  const raw = (whole >> BigInt(shift)) & ((1n << BigInt(bits)) - 1n);
  if (type.startsWith("REAL")) {
    const view = new DataView(new ArrayBuffer(8));
    view.setBigUint64(0, raw, true);
    return bits === 32 ? view.getFloat32(0, true) : view.getFloat64(0, true);
  }
  const number = type.startsWith("INTEGER") ? BigInt.asIntN(bits, raw) : raw;
  return bits <= 48 ? Number(number) : number.toString();
}

function sdoText(use, bytes) {
  const place = `${hex(bytes[1] | (bytes[2] << 8), 4)}.${hex(bytes[3], 2).slice(2)}`;
  const command = bytes[0] >> 5;
  if (command === 4) return `abort ${place}, ${hex(new DataView(bytes.buffer).getUint32(4, true), 8)}`;
  if (command === 2) return `upload ${place}`;
  if (use === "SDO request" && command === 1) return `download ${place}`;
  if (use === "SDO answer" && command === 3) return `download ${place} done`;
  return "segment or block";
}
