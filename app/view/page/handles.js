// Draggable handles in the image: the lights and the selected object.

import {add, imageToWorld, length, normalize, project, scale, sub} from "./vectors.js";

const SVG = "http://www.w3.org/2000/svg";
const SUN_DISTANCE = 0.3; // from the pivot to the handle of a directional light, relative to the scene's longest edge
const RADII = {"hit-area": 18, ring: 9, core: 5}; // pixels

/** Position of a light's handle in world space. */
export function handlePosition(light, pivot, extent) {
  if (light.type === "directional") return sub(pivot, scale(normalize(light.direction), SUN_DISTANCE * extent));
  return light.position ?? light.center;
}

/** The light with its handle moved to a point. */
export function moveLight(light, point, pivot) {
  if (light.type === "directional") return {...light, direction: normalize(sub(pivot, point))};
  return {...light, [light.position ? "position" : "center"]: point};
}

export class Handles {
  /** `list` returns [{id, point, colour, selected, lineTo}] in world space; `drag` receives (id, point), `select` an id. */
  constructor(svg, list, drag, select) {
    this.svg = svg; this.list = list; this.drag = drag; this.select = select;
  }

  /** Draw the handles as seen by `camera`. */
  draw(camera) {
    this.camera = camera;
    const {clientWidth: w, clientHeight: h} = this.svg.parentElement, visible = new Set();
    for (const handle of this.list()) {
      const at = project(camera, w / h, handle.point);
      if (at.depth <= 0) continue;
      visible.add(handle.id);
      const group = this.svg.querySelector(`[data-id="${handle.id}"]`) ?? this.create(handle.id);
      group.setAttribute("transform", `translate(${at.x * w} ${at.y * h})`);
      group.setAttribute("class", handle.selected ? "selected" : "");
      group.querySelector(".core").style.fill = handle.colour;
      this.drawLine(group, handle, camera, at, w, h);
    }
    for (const group of [...this.svg.children]) if (!visible.has(group.dataset.id)) group.remove();
  }

  /** Draw a line from a directional light's handle to the pivot. */
  drawLine(group, handle, camera, at, w, h) {
    const line = group.querySelector("line"), to = handle.lineTo && project(camera, w / h, handle.lineTo);
    line.toggleAttribute("hidden", !to || to.depth <= 0);
    line.setAttribute("x2", to ? (to.x - at.x) * w : 0);
    line.setAttribute("y2", to ? (to.y - at.y) * h : 0);
  }

  create(id) {
    const group = document.createElementNS(SVG, "g");
    group.dataset.id = id;
    group.append(document.createElementNS(SVG, "line"));
    for (const [name, radius] of Object.entries(RADII)) {
      const circle = document.createElementNS(SVG, "circle");
      circle.setAttribute("r", radius); circle.setAttribute("class", name);
      group.append(circle);
    }
    let last = null;
    group.addEventListener("pointerdown", e => {
      e.stopPropagation(); e.preventDefault();
      group.setPointerCapture(e.pointerId);
      last = [e.clientX, e.clientY];
      this.select(id);
    });
    group.addEventListener("pointermove", e => {
      if (!last || !group.hasPointerCapture(e.pointerId)) return;
      e.stopPropagation();
      const handle = this.list().find(x => x.id === id), height = this.svg.parentElement.clientHeight;
      const {depth} = project(this.camera, 1, handle.point);
      const offset = imageToWorld(this.camera, (e.clientX - last[0]) / height, (e.clientY - last[1]) / height, depth);
      last = [e.clientX, e.clientY];
      if (length(offset)) this.drag(id, add(handle.point, offset));
    });
    for (const end of ["pointerup", "pointercancel"]) group.addEventListener(end, () => { last = null; });
    this.svg.append(group);
    return group;
  }
}
