// Vectors as arrays of three numbers, and the pinhole camera of the scene JSON: {eye, target, up, fov_y_deg}.

export const add = (a, b) => a.map((x, i) => x + b[i]);
export const sub = (a, b) => a.map((x, i) => x - b[i]);
export const mul = (a, s) => a.map(x => x * s);
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = a => Math.hypot(...a);
export const unit = a => mul(a, 1 / Math.max(length(a), 1e-300));

/** `v` turned about the unit vector `axis` by an angle in radians. */
export function turned(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(mul(v, c), mul(cross(axis, v), s)), mul(axis, dot(axis, v) * (1 - c)));
}

/** Unit vectors to the right, up and forward. */
export function axes(camera) {
  const forward = unit(sub(camera.target, camera.eye)), right = unit(cross(forward, camera.up));
  return {right, up: cross(right, forward), forward};
}

/** Where a point is seen: x and y in 0..1 from the upper left, and its depth, which is negative behind the eye. */
export function project(camera, aspect, point) {
  const {right, up, forward} = axes(camera), to = sub(point, camera.eye), depth = dot(to, forward);
  const tan = Math.tan(camera.fov_y_deg * Math.PI / 360);
  return {x: 0.5 + dot(to, right) / (2 * depth * tan * aspect), y: 0.5 - dot(to, up) / (2 * depth * tan), depth};
}

/** How far in the world a step across the picture goes at a depth; dx and dy are shares of its height, +y down. */
export function across(camera, dx, dy, depth) {
  const {right, up} = axes(camera), height = 2 * depth * Math.tan(camera.fov_y_deg * Math.PI / 360);
  return add(mul(right, dx * height), mul(up, -dy * height));
}
