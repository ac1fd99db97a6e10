// The list of lights in the panel: colour, strength and size of each; new ones.

import {add, length, mul, sub, unit} from "./vectors.js";

const STRENGTH = {point: "intensity", sphere: "intensity", spot: "intensity", directional: "irradiance", rectangle: "radiance"};
const UNIT = {intensity: "W/sr", irradiance: "W/m²", radiance: "W/(sr m²)"};

const decode = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
const encode = v => v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;

/** A light's colour as #rrggbb, its brightest channel full. */
export function colour(light) {
  const rgb = light[STRENGTH[light.type]], most = Math.max(...rgb);
  return "#" + rgb.map(v => Math.round(255 * encode(most ? v / most : 1)).toString(16).padStart(2, "0")).join("");
}

function withColour(light, hex, strength) {
  const rgb = [1, 3, 5].map(i => decode(parseInt(hex.slice(i, i + 2), 16) / 255)), most = Math.max(...rgb, 1e-6);
  return {...light, [STRENGTH[light.type]]: rgb.map(v => v / most * strength)};
}

const strength = light => Math.max(...light[STRENGTH[light.type]]);

function size(light) {
  if (light.type === "directional") return light.angular_radius_deg ?? 0;
  return light.type === "rectangle" ? length(light.edge_u) : light.radius ?? 0;
}

function withSize(light, value) {
  if (light.type === "directional") return {...light, angular_radius_deg: Math.min(Math.max(value, 0), 80)};
  if (light.type !== "rectangle") return {...light, radius: Math.max(value, 0)};
  const factor = Math.max(value, 1e-6) / length(light.edge_u);
  return {...light, edge_u: mul(light.edge_u, factor), edge_v: mul(light.edge_v, factor)};
}

/** A new light between the eye and what it looks at, bright enough to be seen. */
export function newLight(type, camera, pivot, extent) {
  const position = add(camera.eye, mul(sub(pivot, camera.eye), 0.6)), down = [0, -1, 0], bright = v => [v, v, v];
  const intensity = bright(0.2 * extent ** 2), edge = 0.15 * extent;
  switch (type) {
    case "spot": return {type, position, direction: unit(sub(pivot, camera.eye)), intensity: mul(intensity, 2),
                         inner_deg: 20, outer_deg: 35, radius: 0.02 * extent};
    case "directional": return {type, direction: unit([0.4, -1, -0.3]), irradiance: bright(2), angular_radius_deg: 0.5};
    case "rectangle": return {type, center: position, edge_u: [edge, 0, 0], edge_v: [0, 0, edge], radiance: bright(8),
                              two_sided: true};
    default: return {type, position, intensity, radius: type === "sphere" ? 0.04 * extent : 0};
  }
}

/** Fill `box` with a row for each light; `change` takes (index, light or null), `choose` an index. */
export function listLights(box, lights, chosen, change, choose) {
  if (box.contains(document.activeElement) && document.activeElement.matches("input")
      && box.children.length === lights.length) return; // not under the user's fingers
  box.replaceChildren(...lights.map((light, index) => {
    const row = document.createElement("div"), unitName = UNIT[STRENGTH[light.type]];
    let now = light;
    const set = next => { now = next; change(index, next); };
    row.className = "light" + (index === chosen ? " chosen" : "");
    const name = button(light.type, "name", `Light ${index + 1}`, () => choose(index));
    const tint = input("color", colour(light), `Colour of light ${index + 1}`, v => set(withColour(now, v, strength(now))));
    const much = input("number", rounded(strength(light)), `Strength of light ${index + 1} in ${unitName}`,
                       v => set(withColour(now, colour(now), Math.max(v, 0))));
    const large = input("number", rounded(size(light)), `Size of light ${index + 1}`, v => set(withSize(now, v)));
    row.append(name, tint, much, large, button("×", "", `Remove light ${index + 1}`, () => change(index, null)));
    return row;
  }));
}

const rounded = v => Number(v.toPrecision(4));

function button(text, name, title, act) {
  const made = document.createElement("button");
  Object.assign(made, {textContent: text, className: name, title, onclick: act});
  return made;
}

function input(type, value, title, act) {
  const made = document.createElement("input");
  Object.assign(made, {type, value, title, step: "any", min: 0});
  made.ariaLabel = title;
  made.oninput = () => {
    const given = type === "number" ? made.valueAsNumber : made.value;
    if (type !== "number" || Number.isFinite(given)) act(given);
  };
  return made;
}
