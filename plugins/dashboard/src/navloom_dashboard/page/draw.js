// Draws what the robot says on the canvas. Lengths of marks are pixels of the screen, places are m in the map frame.

import { seconds } from "./dom.js";
import { OLD } from "./live.js";

const OKABE_ITO = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"];
/** Colours of shadows: of those of Okabe and Ito, what nothing else on the map has. */
export const SHADOWS = ["#CC79A7", "#E69F00", "#009E73", "#D55E00"];
/** Time that an arrow of a command looks ahead, s. */
const AHEAD = 3;
/** Time since its last echo from which a body is drawn faintly, s. */
const UNSEEN = 0.3;
/** Number of places, the likeliest ones, that have their share beside them. */
const NAMED = 5;
/** Semi-axis, in standard deviations, of the ellipse that holds the robot with 95 %. */
const SIGMAS_95 = 2.4477;

export const LAYERS = {
  map: "Map", sweep: "3D image, by height", scan: "Scans", path: "Plan", trajectory: "Trajectory", pose: "Uncertainty of the pose, other places", robot: "Robot",
  tracks: "People and other tracks", members: "Other robots", limit: "What limits the robot", commands: "Commands",
};

export function palette(isDark) {
  return isDark
    ? { ground: "#1a2028", free: [43, 52, 63], occupied: [238, 242, 246], ink: "#eef2f6", halo: "#10151b", path: "#E69F00",
        trajectory: "#56B4E9", low: [66, 118, 196], high: [255, 234, 70], robot: "#56B4E9", scan: "#F0E442", track: "#CC79A7", limit: "#ff8a3d", member: "#4cc9a0" }
    : { ground: "#c3cad2", free: [250, 251, 252], occupied: [23, 27, 33], ink: "#14181d", halo: "#ffffff", path: "#b97f00",
        trajectory: OKABE_ITO[0], low: [140, 180, 225], high: [0, 32, 77], robot: OKABE_ITO[0], scan: "#c2410c", track: "#a8447f", limit: OKABE_ITO[1], member: "#00755a" };
}

/** Colours of the layers, as CSS backgrounds. */
export const keyColours = ({ free, occupied, low, high, scan, path, trajectory, robot, track, member, limit, ink }) => ({
  map: graded(free, occupied), sweep: graded(low, high), scan, path, trajectory, pose: robot, robot, tracks: track, members: member, limit, commands: ink,
});
const graded = (from, to) => `linear-gradient(90deg, rgb(${from}), rgb(${to}))`;

export class Drawing {
  constructor(context, camera) {
    this.context = context;
    this.camera = camera;
    this.shown = new Set(Object.keys(LAYERS));
    this.unit = 1; // size of marks and text, above 1 on very large screens
    this.rasters = {}; // kind -> {bitmap, message}
    this.colours = palette(false);
  }

  frame(live, tool, ratio) {
    const { context, camera, colours } = this;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = colours.ground;
    context.fillRect(0, 0, camera.width, camera.height);
    context.lineJoin = context.lineCap = "round";
    const { newest } = live;
    this.ratio = ratio;
    for (const kind of ["map", "sweep"]) if (this._shows(kind) && this.rasters[kind]) this._raster(this.rasters[kind]);
    if (this._shows("path") && newest.path) this._line(newest.path.points, colours.path, 5, [2, 9]);
    if (this._shows("trajectory") && newest.trajectory) this._line(newest.trajectory.points, colours.trajectory, 3);
    if (this._shows("path") && newest.path?.points.length && newest.state?.goal) this._goal(newest.path.points.at(-1));
    if (this._shows("tracks")) for (const { tracks } of live.tracks.values()) this._tracks(tracks);
    if (this._shows("members")) this._members(newest.members?.members ?? []);
    const { pose, state } = newest;
    if (pose) {
      if (this._shows("scan")) for (const scan of live.scans.values()) this._scan(pose, scan);
      if (this._shows("pose") && pose.cov) this._uncertainty(pose);
      if (this._shows("pose")) this._places(newest.hypotheses?.places ?? []);
      if (this._shows("robot")) this._robot(pose, newest.robot?.footprint, colours.robot);
      if (this._shows("limit") && state?.limit?.place_in_base) this._limit(pose, state.limit);
      if (this._shows("commands") && live.age("commands") < OLD.state) this._commands(pose, newest.commands.roles);
    }
    tool.draw(this);
    this._scaleBar();
  }

  _shows(layer) {
    return this.shown.has(layer);
  }

  _raster({ bitmap, message }) {
    const { context, camera } = this;
    const [ox, oy, turn] = message.origin;
    const [px, py] = camera.toScreen(ox, oy);
    context.save();
    context.translate(px, py);
    context.rotate(-camera.angle - turn);
    const pixel = camera.scale * message.resolution;
    context.scale(pixel, -pixel); // row 0 of the bitmap is the lowest one
    context.imageSmoothingEnabled = pixel < 1;
    context.drawImage(bitmap, 0, 0);
    context.restore();
  }

  _goal([x, y]) {
    const { context, camera, colours } = this;
    const at = camera.toScreen(x, y);
    for (const radius of [3, 11]) {
      context.beginPath();
      context.arc(...at, radius, 0, 7);
      this.stroke(colours.path, 4);
    }
  }

  _trace(points) {
    const { context, camera } = this;
    context.beginPath();
    points.forEach(([x, y], i) => {
      const at = camera.toScreen(x, y);
      if (i) context.lineTo(...at);
      else context.moveTo(...at);
    });
  }

  _line(points, colour, width, dash = []) {
    if (!points?.length) return;
    this._trace(points);
    this.stroke(colour, width, dash);
  }

  /** Strokes the path with a halo, so that it shows on free and on occupied cells. */
  stroke(colour, width, dash = []) {
    const { context } = this;
    context.setLineDash(dash);
    context.strokeStyle = this.colours.halo;
    context.lineWidth = (width + 2.5) * this.unit;
    context.stroke();
    context.strokeStyle = colour;
    context.lineWidth = width * this.unit;
    context.stroke();
    context.setLineDash([]);
  }

  label(text, px, py, colour = this.colours.ink) {
    const { context } = this;
    context.font = `600 ${13 * this.unit}px system-ui, sans-serif`;
    context.strokeStyle = this.colours.halo;
    context.lineWidth = 4;
    context.strokeText(text, px, py);
    context.fillStyle = colour;
    context.fillText(text, px, py);
  }

  arrow(from, to, colour, width = 3, dash = []) {
    const { context } = this;
    const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
    context.beginPath();
    context.moveTo(...from);
    context.lineTo(...to);
    this.stroke(colour, width, dash);
    this._head(to, angle, colour, width);
  }

  _head([px, py], angle, colour, width) {
    const { context } = this;
    const size = (6 + 2 * width) * this.unit;
    context.beginPath();
    for (const turn of [0, 2.5, -2.5]) context.lineTo(px + size * Math.cos(angle + turn), py + size * Math.sin(angle + turn));
    context.closePath();
    this.stroke(colour, 1.5);
    context.fillStyle = colour;
    context.fill();
  }

  _scan(pose, scan) {
    const { context, camera } = this;
    const [c, s] = [Math.cos(pose.heading), Math.sin(pose.heading)];
    const place = (x, y) => camera.toScreen(pose.x + c * x - s * y, pose.y + s * x + c * y);
    const { scale } = camera;
    context.fillStyle = context.strokeStyle = this.colours.scan;
    if (scan.beams) return this._cones(scan, place, pose.heading + camera.angle);
    const [bx, by, mount] = scan.pose;
    const [px, py] = place(bx, by);
    const first = pose.heading + mount + scan.angle_min + camera.angle;
    const size = (scale > 150 ? 4 : 3) * this.unit;
    context.beginPath();
    scan.ranges.forEach((range, i) => {
      if (!Number.isFinite(range)) return;
      const angle = first + i * scan.angle_step;
      context.rect(px + scale * range * Math.cos(angle) - size / 2, py - scale * range * Math.sin(angle) - size / 2, size, size);
    });
    context.fill();
  }

  /** Beams with places of their own, such as sonars: an arc at each echo, as wide as its cone. */
  _cones(scan, place, turn) {
    const { context, camera } = this;
    context.lineWidth = 3;
    scan.beams.forEach(([x, y, bearing, half], i) => {
      if (!Number.isFinite(scan.ranges[i])) return;
      const [at, middle] = [place(x, y), -(turn + bearing)];
      context.beginPath();
      context.arc(...at, scan.ranges[i] * camera.scale, middle - Math.max(half, 0.01), middle + Math.max(half, 0.01));
      context.stroke();
    });
  }

  _uncertainty({ x, y, heading, cov }) {
    const { context, camera } = this;
    const [[xx, xy], [, yy]] = cov;
    const [mean, half] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
    const [major, minor] = [mean + half, Math.max(mean - half, 0)].map((variance) => SIGMAS_95 * Math.sqrt(variance) * camera.scale);
    if (!(major < 1e5)) return;
    const at = camera.toScreen(x, y);
    context.beginPath();
    context.ellipse(...at, Math.max(major, 1), Math.max(minor, 1), -camera.angle - Math.atan2(2 * xy, xx - yy) / 2, 0, 7);
    context.fillStyle = this.colours.robot;
    context.globalAlpha = 0.2;
    context.fill();
    context.globalAlpha = 1;
    this.stroke(this.colours.robot, 1.5, [4, 4]);
    const spread = 2 * Math.sqrt(cov[2][2]);
    if (!(spread > 0.02)) return;
    const middle = -camera.angle - heading;
    context.beginPath();
    context.moveTo(...at);
    context.arc(...at, 46, middle - Math.min(spread, Math.PI), middle + Math.min(spread, Math.PI));
    context.closePath();
    context.globalAlpha = 0.25;
    context.fill();
    context.globalAlpha = 1;
  }

  /** Where a robot may be that does not know where it is, with how likely each place is. */
  _places(places) {
    const { camera, context, colours } = this;
    places.forEach(({ x, y, heading, weight }, i) => {
      const at = camera.toScreen(x, y);
      context.globalAlpha = Math.min(1, 0.4 + weight);
      this._head(at, -camera.angle - heading, colours.track, 3);
      context.globalAlpha = 1;
      if (i < NAMED) this.label(`${Math.round(100 * weight)} %`, at[0] + 12, at[1] - 10, colours.track);
    });
  }

  _robot({ x, y, heading }, footprint, colour, name = "") {
    const { context, camera } = this;
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    const polygon = (footprint ?? []).map(([u, v]) => [x + c * u - s * v, y + s * u + c * v]);
    if (polygon.length) {
      this._trace(polygon);
      context.closePath();
      context.fillStyle = colour;
      context.globalAlpha = 0.45;
      context.fill();
      context.globalAlpha = 1;
      this.stroke(colour, 2);
    }
    const at = camera.toScreen(x, y);
    this._head(at, -camera.angle - heading, colour, 3);
    if (name) this.label(name, at[0] + 14, at[1] - 12);
  }

  _members(members) {
    for (const member of members) {
      const since = member.age > OLD.pose ? `, ${seconds(member.age)} ago` : "";
      this._robot(member, member.footprint, this.colours.member, member.name + since);
    }
  }

  _tracks(tracks) {
    const { context, camera, colours } = this;
    for (const { id, x, y, vx, vy, radius, unseen } of tracks) {
      const at = camera.toScreen(x, y);
      context.globalAlpha = unseen > UNSEEN ? 0.4 : 1;
      context.beginPath();
      context.arc(...at, Math.max(5, (radius || 0.25) * camera.scale), 0, 7);
      this.stroke(colours.track, 2.5);
      if (Math.hypot(vx, vy) > 0.05) this.arrow(at, camera.toScreen(x + vx, y + vy), colours.track, 2.5);
      this.label(`${id}`, at[0] + 9, at[1] - 9, colours.track);
    }
    context.globalAlpha = 1;
  }

  _limit(pose, { place_in_base: [u, v], text }) {
    const { context, camera, colours } = this;
    const [c, s] = [Math.cos(pose.heading), Math.sin(pose.heading)];
    const at = camera.toScreen(pose.x + c * u - s * v, pose.y + s * u + c * v);
    context.beginPath();
    context.moveTo(...camera.toScreen(pose.x, pose.y));
    context.lineTo(...at);
    this.stroke(colours.limit, 2, [3, 6]);
    context.beginPath();
    context.arc(...at, 10, 0, 7);
    context.moveTo(at[0] - 6, at[1] - 6);
    context.lineTo(at[0] + 6, at[1] + 6);
    context.moveTo(at[0] + 6, at[1] - 6);
    context.lineTo(at[0] - 6, at[1] + 6);
    this.stroke(colours.limit, 3);
    this.label(text, at[0] + 14, at[1] + 20, colours.limit);
  }

  _commands(pose, roles) {
    const { camera, context, colours } = this;
    for (const entries of Object.values(roles)) {
      if (entries.length < 2) continue; // nothing to compare
      let shadow = 0;
      for (const { instance, active, v, w } of entries) {
        const colour = active ? colours.ink : SHADOWS[shadow++ % SHADOWS.length];
        if (Math.abs(v) < 0.01 && Math.abs(w) < 0.02) continue;
        const points = [];
        let [x, y, heading] = [pose.x, pose.y, pose.heading];
        for (let i = 0; i <= 12; i++) {
          points.push(camera.toScreen(x, y));
          const step = AHEAD / 12;
          heading += (w * step) / 2;
          x += v * step * Math.cos(heading);
          y += v * step * Math.sin(heading);
          heading += (w * step) / 2;
        }
        context.beginPath();
        for (const point of points) context.lineTo(...point);
        this.stroke(colour, active ? 4 : 3, active ? [] : [7, 6]);
        const end = points.at(-1);
        this._head(end, -camera.angle - heading, colour, active ? 3 : 2);
        this.label(instance, end[0] + 12, end[1] + (active ? -8 : 8 + 15 * shadow), colour);
      }
    }
  }

  _scaleBar() {
    const { context, camera } = this;
    const wanted = 120 / camera.scale;
    const power = 10 ** Math.floor(Math.log10(wanted));
    const length = [5, 2, 1].map((n) => n * power).find((n) => n <= wanted);
    const [x, y] = [16, camera.height - 16];
    context.beginPath();
    context.moveTo(x, y - 5);
    context.lineTo(x, y);
    context.lineTo(x + length * camera.scale, y);
    context.lineTo(x + length * camera.scale, y - 5);
    this.stroke(this.colours.ink, 2);
    this.label(length < 1 ? `${Math.round(length * 100)} cm` : `${length} m`, x + 6, y - 7);
  }
}
