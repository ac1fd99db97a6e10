// Ties the page together: the state as the server has it, the controls that change it, and the picture.

import {Connection} from "./connection.js";
import {Handles, moved, place} from "./handles.js";
import {colour, listLights, newLight} from "./lights.js";
import {Navigation} from "./navigation.js";
import {Screen} from "./screen.js";
import {showErrors, showStats} from "./stats.js";
import {add, sub} from "./vectors.js";

const $ = id => document.getElementById(id);
const view = $("view"), LOOKS = ["model", "split", "aov", "precision"], TOAST_MS = 6000, RESIZE_MS = 250;

let scene = null, state = null, steers = false, reference = 0, chosen = -1, object = "", home = null;
let pending = {}; // newest unsent change of each type: one message a screen refresh is enough

const navigation = new Navigation(view, () => change("camera", {camera: navigation.camera}));
const screen = new Screen(header => {
  connection.shown(header.input);
  if (state) handles.draw(header.camera);
  $("status").textContent = "";
  view.dataset.frames = header.number; view.dataset.input = header.input; view.dataset.repeat = header.repeat;
});
const handles = new Handles($("handles"), listHandles, dragHandle, chooseHandle);

const connection = new Connection({
  open: () => { $("status").textContent = "waiting for the first frame …"; },
  closed: () => { $("status").textContent = "connection lost, trying again …"; },
  scene: message => { scene = message; showScene(); },
  state: message => adopt(message.state),
  role: message => {
    steers = message.steers;
    $("watching").hidden = steers;
    if (steers) resize();
  },
  picture: (header, blobs) => {
    if (header.kind === "reference") { reference = header.spp; showSides(); }
    screen.take(header, blobs);
  },
  reference: message => { reference = message.spp; showSides(); showErrors(null); },
  stats: message => showStats(message, median(connection.latencies)),
  errors: message => showErrors(message.errors),
  picked: message => {
    if (!message.point) return;
    navigation.pivot = message.point;
    if (message.object in scene.objects) chooseObject(message.object);
    handles.draw(navigation.camera);
  },
  saved: message => {
    const link = document.createElement("a");
    link.href = `/saved/${message.number}/${message.name}${location.search}`;
    link.download = "";
    link.click();
    $("command").hidden = false;
    $("command").value = message.command;
    $("status").textContent = "";
  },
  refused: message => toast(message.message),
  error: message => toast(message.message),
});
window.afterglow = {
  connection, navigation, screen,
  get state() { return state; },
  get idle() { return Object.keys(pending).length === 0; }, // all that was done has been sent
};

/** Change the state here at once, and tell the server with the next screen refresh. */
function change(type, values) {
  pending[type] = {...(type === "look" ? pending[type] : {}), ...values};
  if (type === "look") Object.assign(state, values);
  else if (type === "place") state.places = {...state.places, [values.object]: values.translate};
  else if (type !== "bookmark") Object.assign(state, values);
}

let before = performance.now(), shift = false;
function tick(now) {
  navigation.advance(Math.min((now - before) / 1000, 0.1), shift);
  before = now;
  for (const [type, values] of Object.entries(pending)) connection.change({type, ...values});
  pending = {};
  requestAnimationFrame(tick);
}
requestAnimationFrame(tick);

/** Take over the state that the server has. */
function adopt(newer) {
  const first = state === null;
  state = newer;
  if (first) home = state.camera;
  if (first || JSON.stringify(state.camera) !== JSON.stringify(navigation.camera)) navigation.adopt(state.camera);
  for (const name of LOOKS) $(name).value = state[name];
  $("scale").value = state.scale;
  $("taa").checked = state.taa;
  $("exposure").value = Math.log2(state.exposure);
  $("fov").value = state.camera.fov_y_deg;
  showNumbers(); showLights(); showCameras(); showSides(); showObject();
}

function showScene() {
  $("file").textContent = `${scene.file}, ${scene.triangles} triangles`;
  document.title = `${scene.file} · Afterglow`;
  fill($("model"), scene.models); fill($("aov"), scene.aovs);
  fill($("split"), ["", "reference", ...scene.models], name => name || "nothing");
  fill($("object"), ["", ...Object.keys(scene.objects)], name => name || "none");
  $("objects-section").hidden = !Object.keys(scene.objects).length;
  $("emitters").hidden = !scene.emitters;
  $("emitters").textContent = `${scene.emitters} more stand for emissive surfaces and stay with them.`;
  $("settle").value = scene.settle;
  const [low, high] = scene.bounds;
  navigation.extent = Math.max(...sub(high, low), 1e-9);
}

function showNumbers() {
  $("stops").textContent = state.exposure.toPrecision(3);
  $("degrees").textContent = `${Math.round(state.camera.fov_y_deg)}°`;
}

function showSides() {
  if (state) screen.sides(state.split, reference);
}

function showLights() {
  listLights($("lights"), state.lights, chosen, changeLight, index => chooseHandle(`light-${index}`));
}

function changeLight(index, light) {
  const lights = [...state.lights];
  lights.splice(index, 1, ...(light ? [light] : []));
  change("lights", {lights});
  if (!light) { chosen = -1; document.activeElement.blur(); showLights(); }
  handles.draw(navigation.camera);
}

function listHandles() {
  const {pivot, extent} = navigation;
  const list = state.lights.map((light, i) => ({
    id: `light-${i}`, point: place(light, pivot, extent), colour: colour(light), chosen: i === chosen,
    from: light.type === "directional" ? pivot : null}));
  if (object) list.push({id: "object", point: objectPlace(), colour: "#5ab0f0", chosen: true, from: null});
  return list;
}

const objectPlace = () => add(scene.objects[object], state.places[object] ?? [0, 0, 0]);

function dragHandle(id, point) {
  if (id === "object") moveObject(sub(point, scene.objects[object]));
  else {
    const index = Number(id.split("-")[1]);
    changeLight(index, moved(state.lights[index], point, navigation.pivot));
  }
}

function chooseHandle(id) {
  chosen = id.startsWith("light-") ? Number(id.split("-")[1]) : -1;
  showLights();
  handles.draw(navigation.camera);
}

function chooseObject(name) {
  object = name;
  showObject();
  handles.draw(navigation.camera);
}

function moveObject(translate) {
  change("place", {object, translate});
  showObject();
  handles.draw(navigation.camera);
}

function showObject() {
  $("object").value = object;
  $("translate").hidden = !object;
  const place = state.places[object] ?? [0, 0, 0];
  $("translate").querySelectorAll("input").forEach((input, i) => {
    if (input !== document.activeElement) input.value = Number(place[i].toPrecision(5));
  });
}

const cameras = () => ({...scene.cameras, ...state.bookmarks});

function showCameras() {
  $("cameras").replaceChildren(...Object.entries(cameras()).map(([name, camera], i) => {
    const made = document.createElement("button");
    made.textContent = i < 9 ? `${i + 1} ${name}` : name;
    made.onclick = () => goTo(camera);
    if (name in state.bookmarks) {
      made.title = "Right-click forgets it";
      made.oncontextmenu = e => { e.preventDefault(); change("bookmark", {name, forget: true}); };
    }
    return made;
  }));
}

function goTo(camera) {
  if (!camera) return;
  navigation.pivot = camera.target;
  navigation.set(camera);
  $("fov").value = camera.fov_y_deg;
  showNumbers();
}

function keepCamera() {
  const name = $("bookmark-name").value.trim() || `view ${Object.keys(state.bookmarks).length + 1}`;
  $("bookmark-name").value = "";
  change("bookmark", {name});
}

async function copyCamera() {
  const text = JSON.stringify(navigation.camera);
  $("command").hidden = false; $("command").value = text;
  try { await navigator.clipboard.writeText(text); toast("The camera is in the clipboard, for --camera FILE.json"); }
  catch { $("command").select(); toast("Copy the text under Save"); }
}

/** Ask for pictures as large as the window. */
function resize() {
  const ratio = Number($("resolution").value) || devicePixelRatio;
  const size = [view.clientWidth, view.clientHeight].map(n => Math.min(4096, Math.max(16, Math.round(n * ratio))));
  if (steers && state && String(size) !== String(state.size)) change("size", {size});
  if (state) handles.draw(navigation.camera);
}

let timer = 0;
new ResizeObserver(() => { clearTimeout(timer); timer = setTimeout(resize, RESIZE_MS); }).observe(view);

for (const name of LOOKS) $(name).onchange = () => { change("look", {[name]: $(name).value}); showSides(); };
$("scale").onchange = () => change("look", {scale: Number($("scale").value)});
$("taa").onchange = () => change("look", {taa: $("taa").checked});
$("exposure").oninput = () => { change("look", {exposure: 2 ** Number($("exposure").value)}); showNumbers(); };
$("fov").oninput = () => { navigation.set({...navigation.camera, fov_y_deg: Number($("fov").value)}); showNumbers(); };
$("resolution").onchange = resize;
$("object").onchange = () => chooseObject($("object").value);
$("translate").oninput = () => {
  const place = [...$("translate").querySelectorAll("input")].map(input => input.valueAsNumber);
  if (place.every(Number.isFinite)) moveObject(place);
};
$("add-light").onclick = () => {
  chosen = state.lights.length;
  const light = newLight($("new-light").value, navigation.camera, navigation.pivot, navigation.extent);
  change("lights", {lights: [...state.lights, light]});
  showLights();
};
$("bookmark").onclick = keepCamera;
$("reset").onclick = () => goTo(home);
$("copy").onclick = copyCamera;
$("steer").onclick = () => connection.send({type: "steer"});
$("toggle").onclick = () => {
  const alone = document.body.classList.toggle("alone");
  $("toggle").setAttribute("aria-expanded", String(!alone));
};
for (const button of document.querySelectorAll("[data-save]"))
  button.onclick = () => {
    $("status").textContent = "drawing it afresh …";
    connection.send({type: "save", kind: button.dataset.save, settle: $("settle").valueAsNumber || 0});
  };

view.addEventListener("dblclick", e => {
  if (e.target.closest("button")) return;
  const box = view.getBoundingClientRect();
  connection.send({type: "pick", at: [(e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height]});
});

const ONCE = {
  b: keepCamera, c: copyCamera, r: () => goTo(home), p: () => $("toggle").click(), t: () => $("taa").click(),
  m: () => { const s = $("model"); s.selectedIndex = (s.selectedIndex + 1) % s.length; s.onchange(); },
  "[": () => { $("exposure").stepDown(5); $("exposure").oninput(); },
  "]": () => { $("exposure").stepUp(5); $("exposure").oninput(); },
  "+": () => navigation.zoom(0.9), "-": () => navigation.zoom(1 / 0.9),
};
addEventListener("keydown", e => {
  shift = e.shiftKey;
  if (!state || e.ctrlKey || e.metaKey || e.target.matches("input, select, textarea")) return;
  const key = e.key.toLowerCase();
  if (["w", "a", "s", "d", "q", "e", "arrowleft", "arrowright", "arrowup", "arrowdown"].includes(key)) {
    navigation.keys.add(key);
    e.preventDefault();
  } else if (ONCE[key]) ONCE[key]();
  else if (/^[1-9]$/.test(key)) goTo(Object.values(cameras())[Number(key) - 1]);
});
addEventListener("keyup", e => { shift = e.shiftKey; navigation.keys.delete(e.key.toLowerCase()); });
addEventListener("blur", () => navigation.keys.clear());

let hiding = 0;
function toast(text) {
  $("toast").textContent = text;
  $("toast").hidden = false;
  if ($("status").textContent.startsWith("drawing")) $("status").textContent = "";
  clearTimeout(hiding);
  hiding = setTimeout(() => { $("toast").hidden = true; }, TOAST_MS);
}

function fill(select, values, text = value => value) {
  const options = values.map(value => new Option(text(value), value));
  select.replaceChildren(...options);
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted.length ? sorted[Math.floor(sorted.length / 2)] : null;
}
