// The list of lights in the panel: colour, strength and size of each, and new lights.

import {add, length, normalize, scale, sub} from "./vectors.js";

const STRENGTH = {point: "intensity", sphere: "intensity", spot: "intensity", directional: "irradiance", rectangle: "radiance"};
const UNIT = {intensity: "W/sr", irradiance: "W/m²", radiance: "W/(sr m²)"};

const decode = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
const encode = v => v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;

/** A light's colour as #rrggbb, normalized so that its brightest channel is 255. */
export function lightColour(light) {
  const rgb = light[STRENGTH[light.type]], max = Math.max(...rgb);
  return "#" + rgb.map(v => Math.round(255 * encode(max ? v / max : 1)).toString(16).padStart(2, "0")).join("");
}

function withColour(light, hex, strength) {
  const rgb = [1, 3, 5].map(i => decode(parseInt(hex.slice(i, i + 2), 16) / 255)), max = Math.max(...rgb, 1e-6);
  return {...light, [STRENGTH[light.type]]: rgb.map(v => v / max * strength)};
}

const lightStrength = light => Math.max(...light[STRENGTH[light.type]]);

function lightSize(light) {
  if (light.type === "directional") return light.angular_radius_deg ?? 0;
  return light.type === "rectangle" ? length(light.edge_u) : light.radius ?? 0;
}

function withSize(light, value) {
  if (light.type === "directional") return {...light, angular_radius_deg: Math.min(Math.max(value, 0), 80)};
  if (light.type !== "rectangle") return {...light, radius: Math.max(value, 0)};
  const factor = Math.max(value, 1e-6) / length(light.edge_u);
  return {...light, edge_u: scale(light.edge_u, factor), edge_v: scale(light.edge_v, factor)};
}

/** A new light between the eye and the pivot, bright enough for the scene's size. */
export function newLight(type, camera, pivot, extent) {
  const position = add(camera.eye, scale(sub(pivot, camera.eye), 0.6)), grey = v => [v, v, v];
  const intensity = grey(0.2 * extent ** 2), edge = 0.15 * extent;
  switch (type) {
    case "spot": return {type, position, direction: normalize(sub(pivot, camera.eye)), intensity: scale(intensity, 2),
                         inner_deg: 20, outer_deg: 35, radius: 0.02 * extent};
    case "directional": return {type, direction: normalize([0.4, -1, -0.3]), irradiance: grey(2), angular_radius_deg: 0.5};
    case "rectangle": return {type, center: position, edge_u: [edge, 0, 0], edge_v: [0, 0, edge], radiance: grey(8),
                              two_sided: true};
    default: return {type, position, intensity, radius: type === "sphere" ? 0.04 * extent : 0};
  }
}

/** Fill `box` with one row per light; `change` receives (index, light or null), `select` an index. */
export function listLights(box, lights, selected, change, select) {
  if (box.contains(document.activeElement) && document.activeElement.matches("input")
      && box.children.length === lights.length) return; // don't replace an input while it is edited
  box.replaceChildren(...lights.map((light, index) => {
    const row = document.createElement("div"), label = `light ${index + 1}`, unit = UNIT[STRENGTH[light.type]];
    let current = light;
    const set = next => { current = next; change(index, next); };
    row.className = "light" + (index === selected ? " selected" : "");
    row.append(
      button(light.type, "name", `Select ${label}`, () => select(index)),
      input("color", lightColour(light), `Colour of ${label}`, v => set(withColour(current, v, lightStrength(current)))),
      input("number", rounded(lightStrength(light)), `Strength of ${label} in ${unit}`,
            v => set(withColour(current, lightColour(current), Math.max(v, 0)))),
      input("number", rounded(lightSize(light)), `Size of ${label}`, v => set(withSize(current, v))),
      button("×", "", `Remove ${label}`, () => change(index, null)));
    return row;
  }));
}

const rounded = v => Number(v.toPrecision(4));

function button(text, className, title, onclick) {
  return Object.assign(document.createElement("button"), {textContent: text, className, title, onclick});
}

function input(type, value, title, onChange) {
  const element = Object.assign(document.createElement("input"), {type, value, title, step: "any", min: 0, ariaLabel: title});
  element.oninput = () => {
    const given = type === "number" ? element.valueAsNumber : element.value;
    if (type !== "number" || Number.isFinite(given)) onChange(given);
  };
  return element;
}
