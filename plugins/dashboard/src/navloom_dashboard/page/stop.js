// STOP over a connection of its own, which is opened at the start and watched by a heartbeat.

import { byId, say, write } from "./dom.js";
import { socketAddress } from "./session.js";

const BEAT = 1000;
/** Longest silence of the connection before it counts as down, ms: longer than two beats. */
const SILENT = 2500;
/** What the button says once the robot has reported the stop. */
export const STOPPED = "robot is stopped";
/** How long a stop that could not be sent is still sent once the connection is back, ms. */
const KEPT = 10000;

export class Stop {
  constructor(robot, refusal) {
    this.robot = robot;
    this._refusal = refusal;
    this._number = 0;
    this._waiting = null;
    this._heard = -Infinity;
    if (refusal()) return this.show();
    this._connect();
    this._beat = setInterval(() => this._tick(), BEAT / 2);
  }

  close() {
    this._closed = true;
    clearInterval(this._beat);
    this._socket?.close();
  }

  get isUp() {
    return this._socket?.readyState === WebSocket.OPEN && performance.now() - this._heard < SILENT;
  }

  _connect() {
    const socket = new WebSocket(socketAddress("stop", this.robot));
    this._socket = socket;
    socket.onopen = () => {
      this._heard = performance.now();
      if (this._waiting && performance.now() - this._waiting.pressed < KEPT) this._send({ n: this._waiting.n });
      this.show();
    };
    socket.onmessage = ({ data }) => this._take(JSON.parse(data));
    socket.onclose = () => {
      if (this._closed) return;
      this.show();
      setTimeout(() => this._closed || this._connect(), 400);
    };
  }

  _send(message) {
    if (this._socket.readyState === WebSocket.OPEN) this._socket.send(JSON.stringify(message));
  }

  _tick() {
    this._send({ heartbeat: true });
    if (this._socket.readyState === WebSocket.OPEN && performance.now() - this._heard > 2 * SILENT) this._socket.close();
    this.show();
  }

  _take(message) {
    this._heard = performance.now();
    if (this._waiting && message.n === this._waiting.n) {
      const took = Math.round(performance.now() - this._waiting.pressed);
      this._waiting = null;
      this._answer = message.sent === false ? `REFUSED: ${message.error ?? "the robot did not take it"}` : `sent, ${took} ms`;
      this._answered = performance.now();
      say(message.sent === false ? `Stop refused: ${message.error ?? ""}` : `Stop sent in ${took} ms.`, message.sent === false);
    }
    this.show();
  }

  /** Stops the robot; a button that may not says why. */
  press() {
    const reason = this._refusal();
    if (reason) return say(reason, true);
    this._waiting = { n: ++this._number, pressed: performance.now() };
    this._answer = "";
    this._send({ n: this._waiting.n });
    if (!this.isUp) say("STOP is not connected: use the emergency stop of the base.", true);
    this.show();
  }

  /** Takes what the robot's own state says: the stop of `state` holds; "" for nothing. */
  take(robot) {
    this._robot = robot;
    this.show();
  }

  show() {
    const button = byId("stop");
    const up = this.isUp || Boolean(this._refusal());
    button.classList.toggle("down", !up);
    button.classList.toggle("done", up && this._robot === STOPPED);
    const isFresh = this._answer && performance.now() - this._answered < 4000;
    const words = this._refusal() ? "view only"
      : !up ? (this._waiting ? "NOT SENT: no connection" : "no connection")
      : this._waiting ? "sending …"
      : isFresh ? this._answer
      : this._robot || "ready";
    write(byId("stop-state"), words);
  }
}
