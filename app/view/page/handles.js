// What can be dragged in the picture: lights, and the chosen object.

import {across, add, length, mul, project, sub, unit} from "./vectors.js";

const SVG = "http://www.w3.org/2000/svg";
const SUN = 0.3; // of the scene's longest edge: how far from the pivot a directional light is drawn

/** Where a light is, or, of a directional one, stands for it. */
export function place(light, pivot, extent) {
  if (light.type === "directional") return sub(pivot, mul(unit(light.direction), SUN * extent));
  return light.position ?? light.center;
}

/** The light with its handle moved to a point. */
export function moved(light, point, pivot) {
  if (light.type === "directional") return {...light, direction: unit(sub(pivot, point))};
  return {...light, [light.position ? "position" : "center"]: point};
}

export class Handles {
  /** `list` gives [{id, point, colour, chosen, from}] in world space, `drag` takes (id, point), `choose` an id. */
  constructor(svg, list, drag, choose) {
    this.svg = svg; this.list = list; this.drag = drag; this.choose = choose;
  }

  /** Draw them as `camera` sees them. */
  draw(camera) {
    this.camera = camera;
    const {clientWidth: w, clientHeight: h} = this.svg.parentElement, seen = new Set();
    for (const handle of this.list()) {
      const at = project(camera, w / h, handle.point);
      if (at.depth <= 0) continue;
      seen.add(handle.id);
      const group = this.svg.querySelector(`[data-id="${handle.id}"]`) ?? this.make(handle.id);
      group.setAttribute("transform", `translate(${at.x * w} ${at.y * h})`);
      group.setAttribute("class", handle.chosen ? "chosen" : "");
      group.querySelector(".core").style.fill = handle.colour;
      this.connect(group, handle, camera, at, w, h);
    }
    for (const group of [...this.svg.children]) if (!seen.has(group.dataset.id)) group.remove();
  }

  /** A line to where a directional light points. */
  connect(group, handle, camera, at, w, h) {
    const line = group.querySelector("line"), to = handle.from && project(camera, w / h, handle.from);
    line.toggleAttribute("hidden", !to || to.depth <= 0);
    line.setAttribute("x2", to ? (to.x - at.x) * w : 0);
    line.setAttribute("y2", to ? (to.y - at.y) * h : 0);
  }

  make(id) {
    const group = document.createElementNS(SVG, "g");
    group.dataset.id = id;
    group.append(document.createElementNS(SVG, "line"));
    for (const [name, radius] of [["reach", 18], ["ring", 9], ["core", 5]]) {
      const circle = document.createElementNS(SVG, "circle");
      circle.setAttribute("r", radius); circle.setAttribute("class", name);
      group.append(circle);
    }
    let last = null;
    group.addEventListener("pointerdown", e => {
      e.stopPropagation(); e.preventDefault();
      group.setPointerCapture(e.pointerId);
      last = [e.clientX, e.clientY];
      this.choose(id);
    });
    group.addEventListener("pointermove", e => {
      if (!last || !group.hasPointerCapture(e.pointerId)) return;
      e.stopPropagation();
      const handle = this.list().find(x => x.id === id), height = this.svg.parentElement.clientHeight;
      const {depth} = project(this.camera, 1, handle.point);
      const by = across(this.camera, (e.clientX - last[0]) / height, (e.clientY - last[1]) / height, depth);
      last = [e.clientX, e.clientY];
      if (length(by)) this.drag(id, add(handle.point, by));
    });
    for (const end of ["pointerup", "pointercancel"]) group.addEventListener(end, () => { last = null; });
    this.svg.append(group);
    return group;
  }
}
