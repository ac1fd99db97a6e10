// A camera that turns about a pivot, where the viewer found that its eye passes no surface.

import {add, axes, normalize, rotate, sub} from "./vectors.js";

export class Orbit {
  /** `plan` has the grid of free cells as the viewer sends it: a row for each step of pitch from `first_row`. */
  constructor(camera, pivot, plan) {
    this.start = camera; this.pivot = pivot; this.plan = plan;
    this.yaw = 0; this.pitch = 0;
  }

  /** The camera after turning further by angles in radians, as far as surfaces allow. */
  turn(yaw, pitch) {
    const count = Math.max(1, Math.ceil(2 * Math.max(Math.abs(yaw), Math.abs(pitch)) / this.plan.step));
    for (let i = 0; i < count; i++) this.advance(yaw / count, pitch / count);
    const {right} = axes(this.start), up = normalize(this.start.up);
    const turned = p => add(this.pivot, rotate(rotate(sub(p, this.pivot), right, this.pitch), up, this.yaw));
    return {...this.start, eye: turned(this.start.eye), target: turned(this.start.target)};
  }

  /** A step of less than a cell; along a surface in its way if that is free. */
  advance(yaw, pitch) {
    const free = [[yaw, pitch], [yaw, 0], [0, pitch]].find(([y, p]) => this.isFree(this.yaw + y, this.pitch + p));
    if (free) { this.yaw += free[0]; this.pitch += free[1]; }
  }

  isFree(yaw, pitch) {
    const {step, first_row, free} = this.plan, row = free[Math.floor(pitch / step) - first_row];
    if (!row) return false;
    const column = Math.floor(yaw / step) % row.length;
    return row.at(column) === "1";
  }
}
