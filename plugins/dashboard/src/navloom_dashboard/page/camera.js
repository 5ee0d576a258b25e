// Which part of the map the canvas shows. Map frame: m, x right and y up at angle 0. Screen: CSS pixels, y down.

const SCALES = [2, 1000];
/** Share of the way to the robot that a followed view goes in a frame; all of it with reduced motion. */
const EASE = 0.35;

export class Camera {
  constructor() {
    this.x = 0;
    this.y = 0;
    this.scale = 60; // pixels per m
    this.angle = 0; // rad, by which the map is turned to the left
    this.follows = false;
    this.isFit = false; // shows what was asked with `fit`, and nobody has moved it since
    this.width = 1;
    this.height = 1;
  }

  toScreen(x, y) {
    const [c, s] = [Math.cos(this.angle), Math.sin(this.angle)];
    const [dx, dy] = [x - this.x, y - this.y];
    return [this.width / 2 + this.scale * (c * dx - s * dy), this.height / 2 - this.scale * (s * dx + c * dy)];
  }

  toMap(px, py) {
    const [c, s] = [Math.cos(this.angle), Math.sin(this.angle)];
    const [u, v] = [(px - this.width / 2) / this.scale, (this.height / 2 - py) / this.scale];
    return [this.x + c * u + s * v, this.y - s * u + c * v];
  }

  /** Heading in the map frame of a direction on the screen. */
  heading(dx, dy) {
    return wrapped(Math.atan2(-dy, dx) - this.angle);
  }

  /** Moves the map by pixels. */
  pan(dx, dy) {
    const [x, y] = this.toMap(this.width / 2 - dx, this.height / 2 - dy);
    Object.assign(this, { x, y, follows: false, isFit: false });
  }

  /** Zooms and turns about a point of the screen, which stays where it is; about the centre while it follows. */
  zoom(factor, px = this.width / 2, py = this.height / 2, turn = 0) {
    if (this.follows) [px, py] = [this.width / 2, this.height / 2];
    const [x, y] = this.toMap(px, py);
    this.isFit = false;
    this.scale = Math.min(SCALES[1], Math.max(SCALES[0], this.scale * factor));
    this.angle = wrapped(this.angle + turn);
    const [nx, ny] = this.toMap(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }

  /** Shows a rectangle of the map frame, north up, below pixels at the top that something covers. */
  fit([x0, y0, x1, y1], covered = 0) {
    const margin = 1.08;
    const scale = Math.min(this.width / ((x1 - x0) * margin), (this.height - covered) / ((y1 - y0) * margin));
    this.scale = Math.min(SCALES[1], Math.max(SCALES[0], scale));
    Object.assign(this, { x: (x0 + x1) / 2, y: (y0 + y1) / 2 + covered / 2 / this.scale, angle: 0, follows: false, isFit: true });
  }

  /** Brings a followed robot nearer to the centre; whether it is not there yet. */
  chase(pose, isCalm) {
    const [dx, dy] = [pose.x - this.x, pose.y - this.y];
    const share = isCalm || Math.hypot(dx, dy) * this.scale < 1 ? 1 : EASE;
    this.isFit = false;
    this.x += share * dx;
    this.y += share * dy;
    return share < 1;
  }
}

/** An angle in (-pi, pi]. */
export const wrapped = (angle) => Math.PI - ((((Math.PI - angle) % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI));
