// The panels of events, of what the doctor finds, of recording and of layers.

import { acting, byId, element, refuse, say, seconds, withCode } from "./dom.js";
import { LAYERS } from "./draw.js";
import { act, look, recordingAddress } from "./session.js";

export class Events {
  constructor(panel, robot) {
    this.robot = robot;
    this.list = element("ol", { className: "events" });
    this.found = element("ul", { className: "findings", "aria-live": "polite" });
    this.loads = element("tbody");
    panel.replaceChildren(
      element("h3", {}, "Doctor"),
      element("button", { type: "button", id: "doctor", onclick: () => this.ask() }, "Examine the robot"),
      this.found, element("h3", {}, "Events"), this.list, element("h3", {}, "Load of the nodes"),
      element("table", {}, element("thead", {}, element("tr", {}, ...["node", "step", "late"].map((text) => element("th", { scope: "col" }, text)))), this.loads));
  }

  async ask() {
    this.found.replaceChildren(element("li", {}, "Examining …"));
    try {
      const { findings } = await look(this.robot, "doctor");
      const items = findings.map(({ severity, what, remedy }) => item(severity, "", what, remedy));
      this.found.replaceChildren(...(items.length ? items : [element("li", { className: "good" }, "No problem found.")]));
    } catch (error) {
      this.found.replaceChildren(element("li", { className: "bad" }, error.message));
    }
  }

  /** How busy each node is: duration of its step as a share of its period, and the share of its ticks that were late. */
  showLoads(loads) {
    this.loads.replaceChildren(...loads.map(({ node, step, period, late_ticks: late, ticks }) => element("tr", {},
      element("th", { scope: "row" }, node), element("td", {}, share(step, period, 0)), element("td", {}, share(late, ticks, 1)))));
  }

  show(events) {
    this.list.replaceChildren(...(events.length
      ? events.map((event) => item(event.level, when(event), event.text, event.remedy, event.code))
      : [element("li", {}, "No event so far.")]));
  }
}

const share = (part, whole, digits) => (whole ? `${((100 * part) / whole).toFixed(digits)} %` : "–");

const when = ({ time }) => new Date(time).toLocaleTimeString();

function item(level, time, text, remedy, code = "") {
  return element("li", { className: level !== "note" ? "bad" : "" },
    element("span", { className: "level" }, [time, level, code].filter(Boolean).join(" · ")),
    element("p", {}, ...withCode(text)),
    remedy ? element("p", { className: "remedy" }, "→ ", ...withCode(remedy)) : null);
}

export class Record {
  constructor(panel, robot) {
    this.robot = robot;
    this.isOn = false;
    this.files = element("ul", { className: "files" });
    this.state = element("p", { id: "record-state" }, "Not recording.");
    this.button = acting(element("button", { type: "button", id: "record", className: "strong" }, "Start recording"), () => this._toggle());
    refuse(this.button);
    panel.replaceChildren(this.state, this.button, element("h3", {}, "Recordings"), this.files);
    this.list();
  }

  async _toggle() {
    const { file } = await act(this.robot, "record", { on: !this.isOn });
    say(this.isOn ? `${file} is complete.` : `Recording to ${file}.`);
    await this.list();
  }

  /** Takes what the server says: another page may have started or ended it, and its recorder may have failed. */
  take({ file, why }) {
    byId("recording").hidden = !file;
    const isNew = why && why !== this.why;
    this.why = why;
    if (isNew) say(this._failure, true);
    if (isNew || Boolean(file) !== this.isOn) this.list();
  }

  get _failure() {
    return `The recording has ended by itself: ${this.why}`;
  }

  _show() {
    this.button.textContent = this.isOn ? "Stop recording" : "Start recording";
    this.state.textContent = this.isOn ? "Recording all streams of the robot." : this.why ? this._failure : "Not recording.";
  }

  async list() {
    const { recordings, recording } = await look(this.robot, "recordings").catch(() => ({ recordings: [] }));
    this.isOn = Boolean(recording);
    this._show();
    this.files.replaceChildren(...recordings.map(({ name, bytes }) => element("li", {},
      element("a", { href: recordingAddress(this.robot, name), download: name }, name), ` ${(bytes / 1e6).toFixed(1)} MB`)));
  }
}

/** Buttons that show and hide the layers of the map, kept in this browser. */
export function layerButtons(panel, shown, changed) {
  const hidden = JSON.parse(localStorage.getItem("navloom-hidden") ?? "[]");
  hidden.forEach((layer) => shown.delete(layer));
  panel.replaceChildren(...Object.entries(LAYERS).map(([layer, text]) => {
    const button = element("button", { type: "button", className: "layer", "aria-pressed": String(shown.has(layer)) },
      element("span", { className: `key ${layer}`, "aria-hidden": "true" }), text);
    button.addEventListener("click", () => {
      if (!shown.delete(layer)) shown.add(layer);
      button.setAttribute("aria-pressed", String(shown.has(layer)));
      localStorage.setItem("navloom-hidden", JSON.stringify(Object.keys(LAYERS).filter((name) => !shown.has(name))));
      changed();
    });
    return button;
  }));
}

/** Ages of what is shown, each with a mark if it is old. */
export function showAges(live, old, now) {
  const kinds = ["pose", "scan", "state", "tracks", "path", "trajectory", "map", "sweep"];
  const rows = kinds.map((kind) => [kind, live.age(kind, now)]).filter(([, age]) => Number.isFinite(age));
  const list = byId("ages");
  while (list.children.length > rows.length) list.lastChild.remove();
  rows.forEach(([kind, age], i) => {
    const row = list.children[i] ?? list.appendChild(element("li"));
    const isOld = age > (old[kind] ?? Infinity);
    row.classList.toggle("bad", isOld);
    const text = `${isOld ? "⚠ " : ""}${kind} ${seconds(age)}`;
    if (row.textContent !== text) row.textContent = text;
  });
}
