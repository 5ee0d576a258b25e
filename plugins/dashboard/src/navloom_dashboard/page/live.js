// What a robot says: the newest message of each kind, and how old it is.

import { ENDED, continued, sessionEnded, socketAddress } from "./session.js";

const RETRY = [300, 600, 1200, 2500];
/** Age above which a kind counts as old, s. What is not listed is published on change, and may be as old as it likes. */
export const OLD = { pose: 1.0, scan: 1.0, state: 1.0, tracks: 1.0 };
/** Longest silence of the server, s: longer than the second between two of its looks at the robot. */
const SILENT = 3.0;
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

  close() {
    this._closed = true;
    clearTimeout(this._retry);
    this._socket.close();
  }

  _connect() {
    const socket = new WebSocket(socketAddress("ws", this.robot));
    this._socket = socket;
    socket.binaryType = "arraybuffer";
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
    message.received = performance.now();
    this.heard = message.received;
    const { kind } = message;
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

/** A binary message: a length (uint32, little endian), that many bytes of JSON, then the raw bytes as `bytes`. */
function unpacked(data) {
  const length = new DataView(data).getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  message.bytes = data.slice(4 + length);
  if (message.kind === "scan") message.ranges = new Float32Array(message.bytes);
  return message;
}
