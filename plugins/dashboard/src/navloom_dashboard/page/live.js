// What a robot says: the newest message of each kind, and how old it is.

import { ENDED, continued, sessionEnded, socketAddress } from "./session.js";

const RETRY = [300, 600, 1200, 2500];
/** Age above which a kind counts as old, s. What is not listed is published on change, and may be as old as it likes. */
export const OLD = { pose: 1.0, scan: 1.0, state: 1.0, tracks: 1.0 };
/** Longest silence of the server, s: longer than the second between two of its looks at the robot. */
const SILENT = 3.0;
/** Time after which the fastest message and answer count no more, ms: clocks drift, and links change. */
const WINDOW = 30000;
/** Most events that are kept. */
const EVENTS = 200;

export class Live extends EventTarget {
  constructor(robot) {
    super();
    this.robot = robot;
    this.newest = {};
    this.scans = new Map();
    this.tracks = new Map();
    this._events = new Map();
    this.isOpen = false;
    this.gone = null;
    this.heard = performance.now();
    this._tries = 0;
    this._connect();
  }

  /** Asks for an answer, which tells how long the way to the server is. */
  ping() {
    if (this.isOpen) this._socket.send(JSON.stringify({ ping: performance.now() }));
  }

  close() {
    this._closed = true;
    clearTimeout(this._retry);
    this._socket.close();
  }

  _connect() {
    const socket = new WebSocket(socketAddress("ws", this.robot));
    this._socket = socket;
    socket.binaryType = "arraybuffer";
    this._link = new Link();
    socket.onopen = () => {
      this.isOpen = true;
      this._tries = 0;
      this.heard = performance.now();
      this._tell("connection");
    };
    socket.onmessage = ({ data }) => this._take(typeof data === "string" ? JSON.parse(data) : unpacked(data));
    socket.onclose = ({ code }) => {
      if (this._closed) return;
      if (code === ENDED) return sessionEnded();
      // A refused websocket does not say why: the session may be that of an earlier dashboard.
      if (this._tries) continued().catch(() => {});
      this.isOpen = false;
      this._tell("connection");
      const wait = RETRY[Math.min(this._tries++, RETRY.length - 1)];
      this._retry = setTimeout(() => this._connect(), wait);
    };
  }

  _take(message) {
    const { kind } = message;
    this.heard = performance.now();
    if (kind === "pong") return this._link.answered(message.ping, this.heard);
    // As if it had arrived without the delay of the link, which the age of sending does not contain.
    message.received = this.heard - this._link.delay(message.sent, this.heard);
    if (kind === "event") {
      this._events.set(message.id, message);
      if (this._events.size > EVENTS) this._events.delete(this._events.keys().next().value);
    } else if (kind === "tracks") {
      this.tracks.set(message.source, message);
    } else if (kind === "scan") {
      this.scans.set(message.name, message);
    } else if (kind === "gone") {
      this.gone = message;
    } else {
      this.newest[kind] = message;
    }
    if (this.gone && (kind === "pose" || kind === "robot")) this._begin(message);
    this._tell(kind);
  }

  /** The robot is back, perhaps started anew: what it said before does not hold. */
  _begin(message) {
    this.gone = null;
    this.newest = { [message.kind]: message };
    this.scans.clear();
    this.tracks.clear();
    this._tell("back");
  }

  /** The events, the newest first. */
  get events() {
    return [...this._events.values()].reverse();
  }

  _tell(kind) {
    this.dispatchEvent(new CustomEvent("news", { detail: kind }));
  }

  /** Age of the newest message of a kind, s; of the oldest scan or tracks; not finite without one. */
  age(kind, now = performance.now()) {
    const several = { scan: this.scans, tracks: this.tracks }[kind];
    const messages = several ? [...several.values()] : this.newest[kind] ? [this.newest[kind]] : [];
    if (!messages.length) return Number.NaN;
    return Math.max(...messages.map(({ age, received }) => (age ?? 0) + (now - received) / 1000));
  }

  /** Why what is shown may be wrong, and since when, s; null if it is fresh. */
  trouble(now = performance.now()) {
    const silence = (now - this.heard) / 1000;
    if (!this.isOpen) return { text: "NOT CONNECTED to the dashboard. This picture is old.", age: silence };
    if (this.gone) return { text: `${this.newest.pose ? "THE ROBOT IS GONE. This picture is old." : "THE ROBOT IS NOT THERE."} ${this.gone.why.replaceAll("`", "")}`, age: (now - this.gone.received) / 1000 };
    if (silence > SILENT) return { text: "THE DASHBOARD IS SILENT. This picture is old.", age: silence };
    for (const [kind, limit] of Object.entries(OLD)) {
      const age = this.age(kind, now);
      if (age > limit) return { text: `OLD DATA: the ${kind} shown is not the present one.`, age };
    }
    return null;
  }
}

/** How late messages arrive, ms: half the shortest way there and back, and what one takes longer than the fastest. */
class Link {
  constructor() {
    this._now = this._before = { least: Infinity, way: Infinity };
    this._began = -Infinity;
  }

  /** Delay of a message that the server has sent at `sent`, s of a clock of its own. */
  delay(sent, now) {
    if (sent === undefined) return 0;
    if (now - this._began > WINDOW) {
      [this._before, this._now] = [this._now, { least: Infinity, way: Infinity }];
      this._began = now;
    }
    const apart = now - 1000 * sent;
    this._now.least = Math.min(this._now.least, apart);
    const way = Math.min(this._now.way, this._before.way);
    return apart - Math.min(this._now.least, this._before.least) + (Number.isFinite(way) ? way / 2 : 0);
  }

  answered(asked, now) {
    this._now.way = Math.min(this._now.way, now - asked);
  }
}

/** A binary message: a length (uint32, little endian), that many bytes of JSON, then the raw bytes as `bytes`. */
function unpacked(data) {
  const length = new DataView(data).getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  message.bytes = data.slice(4 + length);
  if (message.kind === "scan") message.ranges = new Float32Array(message.bytes);
  return message;
}
