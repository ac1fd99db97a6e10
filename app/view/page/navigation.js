// Camera control by mouse, touch and keys.

import {Orbit} from "./orbit.js";
import {add, axes, dot, imageToWorld, length, normalize, rotate, scale, sub, unproject} from "./vectors.js";

const MAX_UP_COSINE = 0.9995;                   // between view direction and up
const ORBIT_RADIANS = 3.5, LOOK_RADIANS = 1.2;  // for a drag over the image height
const FLY_SPEED = 0.4, FAST_FACTOR = 4;         // in longest edges of the scene per second, and its factor with Shift
const WHEEL_RATE = 0.0015;                      // logarithmic zoom per unit of the wheel
const MIN_DISTANCE = 1e-3;                      // to pivot and target, in longest edges of the scene
const HELD_KEYS = ["w", "a", "s", "d", "q", "e", "arrowleft", "arrowright", "arrowup", "arrowdown"];

export class Navigation {
  /** `camera` is replaced, never changed in place; `onMove` is called afterwards. `ask` promises the viewer's answer. */
  constructor(view, onMove, ask) {
    this.view = view; this.onMove = onMove; this.ask = ask;
    this.camera = null; this.pivot = [0, 0, 0]; this.extent = 1;
    this.chosenPivot = null; // by the user; without it, a drag turns about the surface in the middle
    this.drag = null; this.wheel = null; // what goes on, with the camera that it has made last
    this.pointers = new Map();
    this.keys = new Set(); this.fast = false;
    view.addEventListener("pointerdown", e => this.pointerDown(e));
    view.addEventListener("pointermove", e => this.pointerMove(e));
    for (const end of ["pointerup", "pointercancel"]) view.addEventListener(end, e => this.pointerUp(e));
    view.addEventListener("wheel", e => this.turnWheel(e), {passive: false});
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
    this.camera = camera; this.pivot = camera.target; this.chosenPivot = null;
  }

  /** Let drags turn about a point until the camera goes elsewhere. */
  choosePivot(point) {
    this.pivot = this.chosenPivot = point;
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
    if (this.drag?.isKnown) this.drag = null;
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
    else if (e.altKey || e.ctrlKey || this.keys.size) this.look(dx, dy);
    else this.turn(dx, dy);
  }

  /** Orbit, or look around where walls leave no room for that; what is dragged meanwhile waits for the answer. */
  turn(dx, dy) {
    if (this.drag?.camera !== this.camera) this.drag = this.beginDrag();
    this.drag.dx += dx; this.drag.dy += dy;
    if (this.drag.isKnown) this.followDrag();
  }

  beginDrag() {
    const drag = {camera: this.camera, dx: 0, dy: 0, isKnown: false, orbit: null};
    this.ask({type: "orbit", camera: this.camera, ...(this.chosenPivot && {pivot: this.chosenPivot})}).then(answer => {
      if (this.drag !== drag || this.camera !== drag.camera) return;
      drag.isKnown = true;
      if (answer) this.pivot = answer.pivot;
      if (answer?.orbit) drag.orbit = new Orbit(this.camera, answer.pivot, answer.orbit);
      this.followDrag();
    });
    return drag;
  }

  followDrag() {
    const {drag} = this, {dx, dy} = drag;
    drag.dx = drag.dy = 0;
    if (drag.orbit) this.set(drag.orbit.turn(-dx * ORBIT_RADIANS, -dy * ORBIT_RADIANS));
    else this.look(dx, dy);
    drag.camera = this.camera;
  }

  look(dx, dy) {
    const {eye, target} = this.camera, rotation = this.rotation(-dx * LOOK_RADIANS, -dy * LOOK_RADIANS);
    this.chosenPivot = null;
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

  /** Zoom towards the surface under the cursor; what is turned meanwhile waits for the answer. */
  turnWheel(e) {
    e.preventDefault();
    if (!this.camera) return;
    const box = this.view.getBoundingClientRect(), x = (e.clientX - box.left) / box.width, y = (e.clientY - box.top) / box.height;
    const goesOn = this.wheel && this.wheel.camera === this.camera && (!this.wheel.point || this.wheel.x === x && this.wheel.y === y);
    if (!goesOn) this.wheel = this.beginWheel(x, y);
    this.wheel.factor *= Math.exp(e.deltaY * WHEEL_RATE);
    if (this.wheel.point) this.followWheel();
  }

  beginWheel(x, y) {
    const wheel = {camera: this.camera, x, y, factor: 1, point: null};
    this.ask({type: "pick", camera: this.camera, position: [x, y]}).then(answer => {
      if (this.wheel !== wheel || this.camera !== wheel.camera) return;
      wheel.point = answer?.point ?? unproject(this.camera, this.aspect, x, y, this.pivotDistance());
      this.followWheel();
    });
    return wheel;
  }

  followWheel() {
    const {wheel} = this;
    this.zoom(wheel.factor, wheel.point);
    wheel.factor = 1;
    wheel.camera = this.camera;
  }

  /** The point in the middle of the image that is as far away as the pivot. */
  middle() {
    return unproject(this.camera, this.aspect, 0.5, 0.5, this.pivotDistance());
  }

  /** Move towards a point. */
  zoom(factor, point = this.middle()) {
    const {eye, target} = this.camera, step = scale(sub(point, eye), 1 - factor);
    if (length(sub(point, eye)) * factor < MIN_DISTANCE * this.extent) return;
    const newEye = add(eye, step), distance = Math.max(length(sub(target, eye)) * factor, MIN_DISTANCE * this.extent);
    const height = this.camera.orthographic_height;  // moving closer enlarges nothing there
    this.pivot = point;
    this.set({...this.camera, eye: newEye, target: add(newEye, scale(axes(this.camera).forward, distance)),
      ...(height != null && {orthographic_height: height * factor})});
  }

  get aspect() { return this.view.clientWidth / this.view.clientHeight; }

  /** Translate eye, target and pivot together. */
  translate(offset) {
    const {eye, target} = this.camera;
    this.chosenPivot = null;
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
