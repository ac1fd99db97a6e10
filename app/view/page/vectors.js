// Vectors as arrays of three numbers, and the camera of the scene JSON: {eye, target, up} with fov_y_deg,
// orthographic_height or intrinsics.

export const add = (a, b) => a.map((x, i) => x + b[i]);
export const sub = (a, b) => a.map((x, i) => x - b[i]);
export const scale = (a, s) => a.map(x => x * s);
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = a => Math.hypot(...a);
export const normalize = a => scale(a, 1 / Math.max(length(a), 1e-300));

/** `v` rotated about the unit vector `axis` by an angle in radians. */
export function rotate(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
}

/** The camera's unit vectors right, up and forward. */
export function axes(camera) {
  const forward = normalize(sub(camera.target, camera.eye)), right = normalize(cross(forward, camera.up));
  return {right, up: cross(right, forward), forward};
}

/** Width and height in scene units of what the image shows at a depth, and where the view axis meets it in 0..1. */
function frame(camera, aspect, depth) {
  const lens = camera.intrinsics, height = camera.orthographic_height ?? 2 * depth * Math.tan(camera.fov_y_deg * Math.PI / 360);
  if (!lens || camera.orthographic_height != null) return {width: height * aspect, height, x: 0.5, y: 0.5};
  const width = lens.height * aspect;  // of the image in pixels of the intrinsics
  return {width: depth * width / lens.fx, height: depth * lens.height / lens.fy,
    x: 0.5 + (lens.cx - lens.width / 2) / width, y: lens.cy / lens.height};
}

/** Image position of a point: x and y in 0..1 from the upper left, and its depth, negative behind the eye. */
export function project(camera, aspect, point) {
  const {right, up, forward} = axes(camera), to = sub(point, camera.eye), depth = dot(to, forward);
  const {width, height, x, y} = frame(camera, aspect, depth);
  return {x: x + dot(to, right) / width, y: y - dot(to, up) / height, depth};
}

/** The point at a depth that is seen at an image position, the inverse of `project`. */
export function unproject(camera, aspect, x, y, depth) {
  const {right, up, forward} = axes(camera), middle = frame(camera, aspect, depth);
  const across = add(scale(right, (x - middle.x) * middle.width), scale(up, (middle.y - y) * middle.height));
  return add(camera.eye, add(scale(forward, depth), across));
}

/** World-space offset at a depth of a step across the image; dx and dy relative to the image height, +y down. */
export function imageToWorld(camera, dx, dy, depth) {
  const {right, up} = axes(camera), {width, height} = frame(camera, 1, depth);
  return add(scale(right, dx * width), scale(up, -dy * height));
}
