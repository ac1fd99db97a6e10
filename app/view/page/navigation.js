// Camera control by mouse, touch and keys.

import {add, axes, dot, imageToWorld, length, normalize, rotate, scale, sub} from "./vectors.js";

const MAX_UP_COSINE = 0.9995;                   // between view direction and up
const ORBIT_RADIANS = 3.5, LOOK_RADIANS = 1.2;  // for a drag over the image height
const FLY_SPEED = 0.4, FAST_FACTOR = 4;         // in longest edges of the scene per second, and its factor with Shift
const WHEEL_RATE = 0.0015;                      // logarithmic zoom per unit of the wheel
const MIN_DISTANCE = 1e-3;                      // to pivot and target, in longest edges of the scene
const HELD_KEYS = ["w", "a", "s", "d", "q", "e", "arrowleft", "arrowright", "arrowup", "arrowdown"];

export class Navigation {
  /** `camera` is replaced, never changed in place; `onMove` is called afterwards. */
  constructor(view, onMove) {
    this.view = view; this.onMove = onMove;
    this.camera = null; this.pivot = [0, 0, 0]; this.extent = 1;
    this.pointers = new Map();
    this.keys = new Set(); this.fast = false;
    view.addEventListener("pointerdown", e => this.pointerDown(e));
    view.addEventListener("pointermove", e => this.pointerMove(e));
    for (const end of ["pointerup", "pointercancel"]) view.addEventListener(end, e => this.pointerUp(e));
    view.addEventListener("wheel", e => { e.preventDefault(); this.zoom(Math.exp(e.deltaY * WHEEL_RATE)); }, {passive: false});
    view.addEventListener("contextmenu", e => e.preventDefault());
    addEventListener("keyup", e => { this.fast = e.shiftKey; this.keys.delete(e.key.toLowerCase()); });
    addEventListener("blur", () => this.keys.clear());
  }

  set(camera) {
    this.camera = camera;
    this.onMove();
  }

  /** Take over a camera from elsewhere, with its target as the pivot. */
  adopt(camera) {
    this.camera = camera; this.pivot = camera.target;
  }

  /** Hold a key that flies or looks around; returns whether it is one. */
  hold(key) {
    if (HELD_KEYS.includes(key)) this.keys.add(key);
    return this.keys.has(key);
  }

  pointerDown(e) {
    if (!this.camera || e.target.closest("button")) return; // a button whose pointer is captured receives no click
    this.view.focus({preventScroll: true});
    this.view.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, [e.clientX, e.clientY]);
    this.view.classList.add("dragging");
  }

  pointerUp(e) {
    this.pointers.delete(e.pointerId);
    this.view.classList.toggle("dragging", this.pointers.size > 0);
  }

  pointerMove(e) {
    if (!this.pointers.has(e.pointerId)) return;
    const before = [...this.pointers.values()], height = this.view.clientHeight;
    const [x, y] = this.pointers.get(e.pointerId);
    this.pointers.set(e.pointerId, [e.clientX, e.clientY]);
    const dx = (e.clientX - x) / height, dy = (e.clientY - y) / height;
    if (this.pointers.size === 2) {
      const after = [...this.pointers.values()], distance = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
      this.pan(dx / 2, dy / 2);
      this.zoom(distance(before) / Math.max(distance(after), 1));
    } else if (e.buttons & 6 || e.shiftKey) this.pan(dx, dy);
    else if (e.altKey || e.ctrlKey) this.look(dx, dy);
    else this.orbit(dx, dy);
  }

  orbit(dx, dy) {
    const rotation = this.rotation(-dx * ORBIT_RADIANS, -dy * ORBIT_RADIANS);
    const rotateAboutPivot = p => add(this.pivot, rotation(sub(p, this.pivot)));
    this.set({...this.camera, eye: rotateAboutPivot(this.camera.eye), target: rotateAboutPivot(this.camera.target)});
  }

  look(dx, dy) {
    const {eye, target} = this.camera, rotation = this.rotation(-dx * LOOK_RADIANS, -dy * LOOK_RADIANS);
    this.set({...this.camera, target: add(eye, rotation(sub(target, eye)))});
  }

  /** A rotation about the camera's up and right axes that never passes over the pole. */
  rotation(yaw, pitch) {
    const up = normalize(this.camera.up), {right, forward} = axes(this.camera);
    const pitches = Math.abs(dot(rotate(forward, right, pitch), up)) < MAX_UP_COSINE;
    return v => rotate(pitches ? rotate(v, right, pitch) : v, up, yaw);
  }

  pan(dx, dy) {
    this.translate(scale(imageToWorld(this.camera, dx, dy, this.pivotDistance()), -1));
  }

  zoom(factor) {
    if (!this.camera) return;
    const {eye, target} = this.camera, step = scale(sub(this.pivot, eye), 1 - factor);
    if (length(sub(this.pivot, eye)) * factor < MIN_DISTANCE * this.extent) return;
    const newEye = add(eye, step), distance = Math.max(length(sub(target, eye)) * factor, MIN_DISTANCE * this.extent);
    const height = this.camera.orthographic_height;  // moving closer enlarges nothing there
    this.set({...this.camera, eye: newEye, target: add(newEye, scale(axes(this.camera).forward, distance)),
      ...(height != null && {orthographic_height: height * factor})});
  }

  /** Translate eye, target and pivot together. */
  translate(offset) {
    const {eye, target} = this.camera;
    this.pivot = add(this.pivot, offset);
    this.set({...this.camera, eye: add(eye, offset), target: add(target, offset)});
  }

  pivotDistance() {
    return Math.max(length(sub(this.pivot, this.camera.eye)), MIN_DISTANCE * this.extent);
  }

  /** Fly and look around by the held keys for one time step. */
  advance(seconds) {
    if (!this.camera || !this.keys.size) return;
    const {right, up, forward} = axes(this.camera), on = key => this.keys.has(key) ? 1 : 0;
    const direction = add(add(scale(right, on("d") - on("a")), scale(up, on("e") - on("q"))), scale(forward, on("w") - on("s")));
    const distance = FLY_SPEED * this.extent * seconds * (this.fast ? FAST_FACTOR : 1);
    if (length(direction)) this.translate(scale(normalize(direction), distance));
    const dx = on("arrowright") - on("arrowleft"), dy = on("arrowdown") - on("arrowup");
    if (dx || dy) this.look(dx * seconds, dy * seconds);
  }
}
