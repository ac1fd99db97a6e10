// The camera under mouse, touch and keys.

import {across, add, axes, dot, length, mul, sub, turned, unit} from "./vectors.js";

const STEEPEST = 0.9995;      // cosine between view and up
const TURN = 3.5, LOOK = 1.2; // radians for a drag as long as the picture is high
const FLY = 0.4, FAST = 4;    // longest edges of the scene a second; and with Shift

export class Navigation {
  /** `camera` is replaced, never changed; `moved` is called after. */
  constructor(view, moved) {
    this.view = view; this.moved = moved;
    this.camera = null; this.pivot = [0, 0, 0]; this.extent = 1;
    this.pointers = new Map();
    this.keys = new Set();
    view.addEventListener("pointerdown", e => this.down(e));
    view.addEventListener("pointermove", e => this.move(e));
    for (const end of ["pointerup", "pointercancel"]) view.addEventListener(end, e => this.up(e));
    view.addEventListener("wheel", e => { e.preventDefault(); this.zoom(Math.exp(e.deltaY * 0.0015)); }, {passive: false});
    view.addEventListener("contextmenu", e => e.preventDefault());
  }

  set(camera) {
    this.camera = camera;
    this.moved();
  }

  /** Take over a camera from elsewhere, and turn about what it looks at. */
  adopt(camera) {
    this.camera = camera; this.pivot = camera.target;
  }

  down(e) {
    if (!this.camera || e.target.closest("button")) return; // a button whose pointer is captured is never clicked
    this.view.focus({preventScroll: true});
    this.view.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, [e.clientX, e.clientY]);
    this.view.classList.add("dragging");
  }

  up(e) {
    this.pointers.delete(e.pointerId);
    this.view.classList.toggle("dragging", this.pointers.size > 0);
  }

  move(e) {
    if (!this.pointers.has(e.pointerId)) return;
    const before = [...this.pointers.values()], height = this.view.clientHeight;
    const [x, y] = this.pointers.get(e.pointerId);
    this.pointers.set(e.pointerId, [e.clientX, e.clientY]);
    const dx = (e.clientX - x) / height, dy = (e.clientY - y) / height;
    if (this.pointers.size === 2) {
      const after = [...this.pointers.values()], apart = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
      this.pan(dx / 2, dy / 2);
      this.zoom(apart(before) / Math.max(apart(after), 1));
    } else if (e.buttons & 6 || e.shiftKey) this.pan(dx, dy);
    else if (e.altKey || e.ctrlKey) this.look(dx, dy);
    else this.orbit(dx, dy);
  }

  orbit(dx, dy) {
    const turn = this.turn(-dx * TURN, -dy * TURN), about = p => add(this.pivot, turn(sub(p, this.pivot)));
    this.set({...this.camera, eye: about(this.camera.eye), target: about(this.camera.target)});
  }

  look(dx, dy) {
    const {eye, target} = this.camera;
    this.set({...this.camera, target: add(eye, this.turn(-dx * LOOK, -dy * LOOK)(sub(target, eye)))});
  }

  /** A rotation about the camera's up and its right, which never goes over the top. */
  turn(yaw, pitch) {
    const up = unit(this.camera.up), {right, forward} = axes(this.camera);
    const tilted = Math.abs(dot(turned(forward, right, pitch), up)) < STEEPEST;
    return v => turned(tilted ? turned(v, right, pitch) : v, up, yaw);
  }

  pan(dx, dy) {
    this.shift(mul(across(this.camera, dx, dy, this.reach()), -1));
  }

  zoom(factor) {
    if (!this.camera) return;
    const {eye, target} = this.camera, step = mul(sub(this.pivot, eye), 1 - factor);
    if (length(sub(this.pivot, eye)) * factor < 1e-3 * this.extent) return;
    const closer = add(eye, step), away = Math.max(length(sub(target, eye)) * factor, 1e-3 * this.extent);
    this.set({...this.camera, eye: closer, target: add(closer, mul(axes(this.camera).forward, away))});
  }

  /** Move eye, target and pivot alike. */
  shift(by) {
    const {eye, target} = this.camera;
    this.pivot = add(this.pivot, by);
    this.set({...this.camera, eye: add(eye, by), target: add(target, by)});
  }

  reach() {
    return Math.max(length(sub(this.pivot, this.camera.eye)), 1e-3 * this.extent);
  }

  /** Fly and look by the keys that are held, for so many seconds. */
  advance(seconds, fast) {
    if (!this.camera || !this.keys.size) return;
    const {right, up, forward} = axes(this.camera), on = key => this.keys.has(key) ? 1 : 0;
    const way = add(add(mul(right, on("d") - on("a")), mul(up, on("e") - on("q"))), mul(forward, on("w") - on("s")));
    if (length(way)) this.shift(mul(unit(way), FLY * this.extent * seconds * (fast ? FAST : 1)));
    const dx = on("arrowright") - on("arrowleft"), dy = on("arrowdown") - on("arrowup");
    if (dx || dy) this.look(dx * seconds, dy * seconds);
  }
}
