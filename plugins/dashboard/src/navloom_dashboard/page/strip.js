// The strip of disagreement: the speeds that the instances of a role command, over the last half minute.

import { SHADOWS } from "./draw.js";
import { element, fixed } from "./dom.js";

const SPAN = 30000;
/** Most ticks kept of a role, more than 20 Hz give in the span. */
const MOST = 900;
const ROWS = [["v", "m/s"], ["w", "rad/s"]];

export class Strip {
  constructor(role) {
    this.role = role;
    this.ticks = [];
    this.canvas = element("canvas", { className: "strip", role: "img", "aria-label": `${role}: commands of the last 30 s` });
    this.rows = element("tbody");
    this.element = element("div", {}, this.canvas, element("table", {},
      element("thead", {}, element("tr", {}, ...["instance", "m/s", "rad/s", "apart, 30 s"].map((text) => element("th", { scope: "col" }, text)))),
      this.rows));
  }

  add(entries, now = performance.now()) {
    this.ticks.push({ now, entries });
    while (this.ticks.length > MOST || this.ticks[0].now < now - SPAN) this.ticks.shift();
  }

  /** Mean distances of a shadow from the active instance: [m/s, rad/s]. */
  _apart(instance) {
    let [count, v, w] = [0, 0, 0];
    for (const { entries } of this.ticks) {
      const active = entries.find((entry) => entry.active);
      const other = entries.find((entry) => entry.instance === instance);
      if (!active || !other || active === other) continue;
      count += 1;
      v += Math.abs(active.v - other.v);
      w += Math.abs(active.w - other.w);
    }
    return count ? [v / count, w / count] : null;
  }

  show(colours, isSpoken) {
    const newest = this.ticks.at(-1);
    if (!newest) return;
    this._plot(newest, colours);
    if (!isSpoken) return;
    let shadow = 0;
    this.rows.replaceChildren(...newest.entries.map(({ instance, active, v, w }) => {
      const apart = active ? null : this._apart(instance);
      const swatch = element("span", { className: `swatch ${active ? "solid" : "dashed"}` });
      swatch.style.borderTopColor = active ? colours.ink : SHADOWS[shadow++ % SHADOWS.length];
      return element("tr", {},
        element("th", { scope: "row" }, swatch, instance, active ? " (active)" : ""),
        element("td", {}, fixed(v)), element("td", {}, fixed(w)),
        element("td", {}, apart ? `${fixed(apart[0])}; ${fixed(apart[1])}` : "–"));
    }));
  }

  _plot(newest, colours) {
    const { canvas } = this;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const half = height / ROWS.length;
    ROWS.forEach(([name, unit], row) => this._row(context, newest, name, unit, row * half, width, half, colours));
  }

  _row(context, newest, name, unit, top, width, height, colours) {
    const most = Math.max(0.1, ...this.ticks.flatMap(({ entries }) => entries.map((entry) => Math.abs(entry[name]))));
    const x = (now) => width - ((newest.now - now) / SPAN) * width;
    const y = (value) => top + height / 2 - (value / most) * (height / 2 - 8);
    const series = (instance) => this.ticks.flatMap(({ now, entries }) => {
      const entry = entries.find((found) => found.instance === instance);
      return entry ? [[x(now), y(entry[name])]] : [];
    });
    context.strokeStyle = colours.ink;
    context.globalAlpha = 0.3;
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(0, y(0));
    context.lineTo(width, y(0));
    context.stroke();
    const active = newest.entries.find((entry) => entry.active);
    const base = active ? series(active.instance) : [];
    newest.entries.filter((entry) => !entry.active).forEach(({ instance }, i) => {
      const line = series(instance);
      context.fillStyle = context.strokeStyle = SHADOWS[i % SHADOWS.length];
      context.globalAlpha = 0.28;
      trace(context, [...line, ...[...base].reverse()]);
      context.fill();
      context.globalAlpha = 1;
      context.lineWidth = 2;
      context.setLineDash([5, 4]);
      trace(context, line);
      context.stroke();
      context.setLineDash([]);
    });
    context.globalAlpha = 1;
    context.strokeStyle = context.fillStyle = colours.ink;
    context.lineWidth = 2;
    trace(context, base);
    context.stroke();
    context.font = "12px system-ui, sans-serif";
    context.fillText(`${fixed(most, 1)} ${unit}`, 3, top + 12);
  }
}

function trace(context, points) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
}
