// Driving by hand with a dead-man: commands go out only while the stick or a key is held.

import { byId, fixed, say, write } from "./dom.js";
import { socketAddress } from "./session.js";

/** Time between two commands, ms: several within the 0.2 s of silence after which the robot stops. */
const PERIOD = 50;
const KEYS = {
  ArrowUp: [1, 0], w: [1, 0], ArrowDown: [-1, 0], s: [-1, 0],
  ArrowLeft: [0, 1], a: [0, 1], ArrowRight: [0, -1], d: [0, -1], q: [1, 0.5], e: [1, -0.5],
};

export class Teleop {
  /**
   * @param robot Name of the robot.
   * @param limits Gives `{v, w}`, the largest speeds of the gate, m/s and rad/s.
   * @param refusal Gives why it may not drive; empty if it may.
   */
  constructor(robot, limits, refusal) {
    Object.assign(this, { robot, _limits: limits, _refusal: refusal });
    this._held = new Map();
    this._stick = null;
    this._number = 0;
    this._timer = 0;
    const signal = (this._listening = new AbortController()).signal;
    this._listen(byId("stick"), signal);
    byId("hand-back").addEventListener("click", () => this.handBack(), { signal });
    byId("share").addEventListener("input", () => this.show(), { signal });
    this.show();
  }

  close() {
    this.release();
    this._listening.abort();
    this._socket?.close();
  }

  _listen(stick, signal) {
    stick.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      stick.focus();
      stick.setPointerCapture(event.pointerId);
      this._pull(event);
    }, { signal });
    stick.addEventListener("pointermove", (event) => this._stick && this._pull(event), { signal });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) stick.addEventListener(end, () => this._letGo(), { signal });
    stick.addEventListener("keydown", (event) => {
      const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
      if (!KEYS[key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      event.stopPropagation();
      this._held.set(event.code, KEYS[key]);
      this._start();
    }, { signal });
    stick.addEventListener("keyup", (event) => {
      this._held.delete(event.code);
      if (!this._isHeld) this.release();
    }, { signal });
    // Whatever takes the page from its operator lets go of the stick.
    stick.addEventListener("blur", () => this.release(), { signal });
    window.addEventListener("blur", () => this.release(), { signal });
    window.addEventListener("pagehide", () => this.release(), { signal });
    document.addEventListener("visibilitychange", () => document.hidden && this.release(), { signal });
  }

  get _isHeld() {
    return this._stick !== null || this._held.size > 0;
  }

  _pull(event) {
    const box = byId("stick").getBoundingClientRect();
    const radius = box.width / 2;
    const [u, v] = [(event.clientX - box.left - radius) / radius, (event.clientY - box.top - radius) / radius];
    const length = Math.max(1, Math.hypot(u, v));
    this._stick = [-v / length, -u / length];
    this._start();
  }

  _letGo() {
    this._stick = null;
    if (!this._isHeld) this.release();
  }

  _start() {
    const reason = this._refusal();
    if (reason) {
      this._held.clear();
      this._stick = null;
      return say(reason, true);
    }
    this._connect();
    if (!this._timer) this._timer = setInterval(() => this._send(), PERIOD);
    this._send();
    this.show();
  }

  /** Lets go: one command of zero, then nothing, with which the robot stands. */
  release() {
    this._held.clear();
    this._stick = null;
    if (!this._timer) return;
    clearInterval(this._timer);
    this._timer = 0;
    this._put({ v: 0, w: 0, n: ++this._number });
    this.show();
  }

  /** Ends driving by hand: the robot goes on with its goal. A connection that breaks stops it until `resume` instead. */
  handBack() {
    this.release();
    this._put({ end: true });
    this._socket?.close();
    this._socket = null;
    this._answer = null;
    this.show();
    say("Handed back: the robot goes on by itself.");
  }

  _connect() {
    if (this._socket && this._socket.readyState <= WebSocket.OPEN) return;
    const socket = new WebSocket(socketAddress("teleop", this.robot));
    this._socket = socket;
    this._answer = null;
    socket.onmessage = ({ data }) => {
      this._answer = JSON.parse(data);
      if (this._answer.error) {
        say(this._answer.error, true);
        this.release();
      }
      this.show();
    };
    socket.onclose = () => {
      if (this._socket !== socket) return;
      this.release();
      this._socket = null;
      if (!this._answer?.error) say("Driving by hand ended: its connection is lost. The robot stops until you resume.", true);
      this.show();
    };
  }

  _asked() {
    const share = Number(byId("share").value) / 100;
    let [v, w] = this._stick ?? [0, 0];
    for (const [forward, turn] of this._held.values()) {
      v += forward;
      w += turn;
    }
    const limits = this._limits();
    const within = (value) => Math.max(-1, Math.min(1, value)) * share;
    return { v: within(v) * limits.v, w: within(w) * limits.w };
  }

  _send() {
    this._put({ ...this._asked(), n: ++this._number, heard: this._answer?.at });
    this.show();
  }

  _put(message) {
    if (this._socket?.readyState === WebSocket.OPEN) this._socket.send(JSON.stringify(message));
  }

  show() {
    const limits = this._limits();
    const { v, w } = this._asked();
    const knob = byId("knob");
    const size = 38;
    knob.style.transform = `translate(${limits.w ? (-w / limits.w) * size : 0}%, ${limits.v ? (-v / limits.v) * size : 0}%)`;
    byId("stick").classList.toggle("held", Boolean(this._timer));
    write(byId("share-text"), `${byId("share").value} %`);
    write(byId("teleop-state"), this._timer ? `asked ${fixed(v)} m/s, ${fixed(w)} rad/s` : "not held");
    const { limits: granted, limited_by: by } = this._answer ?? {};
    const got = this._socket && granted ? `; the gate gives ${fixed(granted.v)} m/s, ${fixed(granted.w)} rad/s` : "";
    write(byId("teleop-limits"), `at most ${fixed(limits.v)} m/s, ${fixed(limits.w)} rad/s${got}${this._socket && by ? `, ${by}` : ""}`);
    byId("hand-back").hidden = !this._socket;
  }
}
