// Tools that place something on the map by pointer or by keys: a goal with points on the way, and "I am here".

import { acting, byId, degrees, fixed, say, write } from "./dom.js";
import { act } from "./session.js";

const SLOP = 10;
/** Distance that an arrow key moves the cursor, pixels; with Shift it turns the heading, with Alt the step is fine. */
const STEP = 20;
const TURN = Math.PI / 12;

const WORDS = {
  goal: { go: "Drive there", empty: "Press on the map where to drive to, and drag for the heading.", sent: "Goal sent." },
  pose: { go: "I am here", empty: "Press where the robot is, and drag to where it looks.", sent: "Pose sent." },
};

export class Tool {
  constructor(camera, robot, changed) {
    this.camera = camera;
    this.robot = robot;
    this.name = null;
    this.points = [];
    this.pressed = null;
    this.cursor = null; // {x, y, heading} in the map frame, while keys drive the tool
    this._changed = changed;
    for (const name of ["goal", "pose"]) acting(byId(`tool-${name}`), () => (this.name === name ? this.close() : this.open(name)));
    acting(byId("draft-go"), () => this.send());
    byId("draft-undo").addEventListener("click", () => this.undo());
    byId("draft-close").addEventListener("click", () => this.close());
  }

  get isOn() {
    return this.name !== null;
  }

  open(name) {
    Object.assign(this, { name, points: [], pressed: null, cursor: null });
    this._show();
    byId("map").focus({ preventScroll: true });
  }

  close() {
    if (!this.isOn) return;
    Object.assign(this, { name: null, points: [], pressed: null, cursor: null });
    this._show();
  }

  press(px, py) {
    const [x, y] = this.camera.toMap(px, py);
    this.pressed = { x, y, heading: null, px, py };
    this.cursor = null;
  }

  drag(px, py) {
    const { pressed } = this;
    const [dx, dy] = [px - pressed.px, py - pressed.py];
    pressed.heading = Math.hypot(dx, dy) > SLOP ? this.camera.heading(dx, dy) : null;
    this._show();
  }

  release() {
    const { x, y, heading } = this.pressed;
    this.pressed = null;
    this._place({ x, y, heading });
  }

  abandon() {
    this.pressed = null;
  }

  /** Adds a point of a way; "I am here" has one, which needs a heading. */
  _place(point) {
    if (this.name === "pose") this.points = [{ ...point, heading: point.heading ?? this.points[0]?.heading ?? 0 }];
    else this.points.push(point);
    this._show();
  }

  undo() {
    this.points.pop();
    this._show();
  }

  async send() {
    const { name, points } = this;
    if (!points.length) return say("Place a point on the map first.", true);
    if (name === "goal") await act(this.robot(), "goal", { points });
    else await act(this.robot(), "pose", points[0]);
    say(WORDS[name].sent);
    this.close();
  }

  /** Keys on the focused map while a tool is on; whether the key was one of them. */
  key(event) {
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (arrow) this._moveCursor(arrow, event);
    else if (event.key === "Enter") this._enter();
    else if (event.key === "Backspace") this.undo();
    else return false;
    return true;
  }

  _moveCursor([dx, dy], event) {
    const { camera } = this;
    if (!this.cursor) {
      const [x, y] = camera.toMap(camera.width / 2, camera.height / 2);
      this.cursor = { x, y, heading: null };
    }
    const { cursor } = this;
    if (event.shiftKey) {
      cursor.heading = Math.round(((cursor.heading ?? 0) - (dx || dy) * TURN) / TURN) * TURN;
    } else {
      const step = event.altKey ? 2 : STEP;
      const [px, py] = camera.toScreen(cursor.x, cursor.y);
      const [x, y] = camera.toMap(px + dx * step, py + dy * step);
      Object.assign(cursor, { x, y });
      this._keepInSight(px + dx * step, py + dy * step);
    }
    const turned = cursor.heading === null ? "" : `, heading ${degrees(cursor.heading)}`;
    byId("said").textContent = `${fixed(cursor.x, 1)}, ${fixed(cursor.y, 1)}${turned}`;
    this._show();
  }

  _keepInSight(px, py) {
    const { camera } = this;
    const margin = 40;
    const dx = px < margin ? margin - px : Math.min(0, camera.width - margin - px);
    const dy = py < margin ? margin - py : Math.min(0, camera.height - margin - py);
    if (dx || dy) camera.pan(dx, dy);
  }

  /** Places the cursor; where it was placed already, sends. */
  _enter() {
    const { cursor, points } = this;
    const last = points.at(-1);
    const isPlaced = last && (!cursor || (last.x === cursor.x && last.y === cursor.y && last.heading === cursor.heading));
    if (isPlaced) byId("draft-go").click();
    else if (cursor) {
      this._place({ ...cursor });
      say("Placed. Enter sends, arrow keys go to a further point.");
    } else say("Move the cursor with the arrow keys first.");
  }

  _show() {
    for (const name of ["goal", "pose"]) byId(`tool-${name}`).setAttribute("aria-pressed", String(this.name === name));
    byId("draft").hidden = !this.isOn;
    byId("map").classList.toggle("works", this.isOn);
    if (this.isOn) {
      const words = WORDS[this.name];
      const last = this.pressed ?? this.points.at(-1);
      const via = this.points.length + (this.pressed ? 1 : 0) - 1;
      const turned = last && last.heading !== null ? `, heading ${degrees(last.heading)}` : "";
      const place = last ? `${fixed(last.x)}, ${fixed(last.y)} m${turned}` : words.empty;
      write(byId("draft-text"), via > 0 && this.name === "goal" ? `${place}, by ${via} ${via > 1 ? "points" : "point"}` : place);
      write(byId("draft-go"), words.go);
      byId("draft-undo").hidden = this.name !== "goal";
    }
    this._changed();
  }

  draw(drawing) {
    if (!this.isOn) return;
    const { camera } = this;
    const points = this.pressed ? [...this.points, this.pressed] : this.points;
    const { context, colours } = drawing;
    if (points.length > 1) {
      context.beginPath();
      for (const { x, y } of points) context.lineTo(...camera.toScreen(x, y));
      drawing.stroke(colours.member, 2, [2, 6]);
    }
    points.forEach((point, i) => this._mark(drawing, point, i < points.length - 1 ? `${i + 1}` : WORDS[this.name].go));
    if (this.cursor) this._cross(drawing, this.cursor);
  }

  _mark(drawing, { x, y, heading }, text) {
    const at = this.camera.toScreen(x, y);
    const { context, colours } = drawing;
    context.beginPath();
    context.arc(...at, 9, 0, 7);
    drawing.stroke(colours.member, 4);
    if (heading !== null) drawing.arrow(at, this._ahead(at, heading), colours.member, 4);
    drawing.label(text, at[0] + 14, at[1] - 12);
  }

  _cross(drawing, { x, y, heading }) {
    const [px, py] = this.camera.toScreen(x, y);
    drawing.context.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      drawing.context.moveTo(px + 6 * dx, py + 6 * dy);
      drawing.context.lineTo(px + 20 * dx, py + 20 * dy);
    }
    drawing.stroke(drawing.colours.ink, 2);
    if (heading !== null) drawing.arrow([px, py], this._ahead([px, py], heading), drawing.colours.ink, 2);
  }

  _ahead([px, py], heading) {
    const angle = heading + this.camera.angle;
    return [px + 48 * Math.cos(angle), py - 48 * Math.sin(angle)];
  }
}
