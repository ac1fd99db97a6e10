// Connects the parts of the page: the server's state, the controls that change it, and the image.

import {Connection} from "./connection.js";
import {$, fillSelect, showToast} from "./dom.js";
import {handlePosition, Handles, moveLight} from "./handles.js";
import {lightColour, listLights, newLight} from "./lights.js";
import {Navigation} from "./navigation.js";
import {Screen} from "./screen.js";
import {showErrors, showStats} from "./stats.js";
import {add, sub} from "./vectors.js";

const view = $("view"), SELECTS = ["model", "split", "aov", "tonemap", "precision"], SAVING = "saving …";
const RESIZE_DELAY_MS = 250, MIN_SIDE = 16, MAX_SIDE = 4096, MAX_STEP_SECONDS = 0.1, KEY_ZOOM = 0.9, KEY_EXPOSURE_STEPS = 5;

let scene = null, state = null, home = null, inControl = false, referenceSamples = 0;
let selectedLight = -1, selectedObject = "";
let unsent = {}; // latest unsent change of each type: one message of a type per screen refresh is enough

const navigation = new Navigation(view, () => change("camera", {camera: navigation.camera}), message => connection.ask(message));
const screen = new Screen(header => {
  connection.recordShown(header.input);
  if (state) handles.draw(header.camera);
  $("status").textContent = "";
});
const handles = new Handles($("handles"), listHandles, dragHandle, selectHandle);

const connection = new Connection({
  open: () => { $("status").textContent = "waiting for the first frame …"; },
  closed: () => { $("status").textContent = "connection lost, reconnecting …"; },
  scene: message => { scene = message; showScene(); },
  state: message => adopt(message.state),
  role: message => {
    inControl = message.in_control;
    $("no-control").hidden = inControl;
    if (inControl) resize();
  },
  image: (header, blobs) => {
    if (header.kind === "reference") { referenceSamples = header.spp; showSplit(); }
    screen.show(header, blobs);
  },
  reference: message => { referenceSamples = message.spp; showSplit(); showErrors(null); },
  stats: message => showStats(message, median(connection.latencies)),
  errors: message => showErrors(message.errors),
  saved: message => {
    const link = document.createElement("a");
    link.href = `/saved/${message.number}/${message.name}${location.search}`;
    link.download = "";
    link.click();
    $("command").hidden = false;
    $("command").value = message.command;
    $("status").textContent = "";
  },
  rejected: message => showFailure(message.message),
  error: message => showFailure(message.message),
});
window.afterglow = {
  connection, navigation, screen,
  get state() { return state; },
  get idle() { return !Object.keys(unsent).length && !connection.asked.size; }, // whether all changes have been sent
};

/** Change the state here at once, and on the server with the next screen refresh. */
function change(type, values) {
  unsent[type] = {...(type === "settings" ? unsent[type] : {}), ...values};
  if (type === "move_object") state.object_offsets = {...state.object_offsets, [values.object]: values.translate};
  else if (type !== "bookmark") Object.assign(state, values);
}

let lastTick = performance.now();
function tick(now) {
  navigation.advance(Math.min((now - lastTick) / 1000, MAX_STEP_SECONDS));
  if ($("play").checked && inControl) setTime((state.time + (now - lastTick) / 1000) % scene.duration);
  lastTick = now;
  for (const [type, values] of Object.entries(unsent)) connection.sendChange({type, ...values});
  unsent = {};
  requestAnimationFrame(tick);
}
requestAnimationFrame(tick);

/** Take over the server's state. */
function adopt(newState) {
  const first = state === null;
  state = newState;
  if (first) home = state.camera;
  if (first || JSON.stringify(state.camera) !== JSON.stringify(navigation.camera)) navigation.adopt(state.camera);
  for (const name of SELECTS) $(name).value = state[name];
  $("scale").value = state.scale;
  $("taa").checked = state.taa;
  $("auto_exposure").checked = state.auto_exposure;
  $("reflections").checked = state.reflections;
  $("exposure").value = Math.log2(state.exposure);
  $("fov").value = state.camera.fov_y_deg;
  showNumbers(); showLights(); showCameras(); showSplit(); showObject();
}

function showScene() {
  const objects = Object.keys(scene.object_centers), [low, high] = scene.bounds;
  $("file").textContent = `${scene.file}, ${scene.triangles} triangles`;
  document.title = `${scene.file} · Afterglow`;
  fillSelect($("model"), scene.models); fillSelect($("aov"), scene.aovs); fillSelect($("tonemap"), scene.tonemaps);
  fillSelect($("split"), ["", "reference", ...scene.models], name => name || "nothing");
  fillSelect($("object"), ["", ...objects], name => name || "none");
  $("objects-section").hidden = !objects.length;
  $("emitters").hidden = !scene.emitters;
  $("emitters").textContent = `Emissive surfaces and suns of the environment add ${scene.emitters} more lights, which can't be edited.`;
  $("settle").value = scene.settle;
  $("motion-section").hidden = !scene.duration;
  $("time").max = scene.duration;
  navigation.extent = Math.max(...sub(high, low), 1e-9);
}

function showNumbers() {
  $("exposure-factor").textContent = state.exposure.toPrecision(3);
  $("time").value = state.time;
  $("seconds").textContent = state.time.toFixed(2);
  $("degrees").textContent = `${Math.round(state.camera.fov_y_deg)}°`;
}

function setTime(time) {
  change("settings", {time});
  showNumbers();
}

function showSplit() {
  if (state) screen.setSplit(state.split, referenceSamples);
}

function showFailure(text) {
  if ($("status").textContent === SAVING) $("status").textContent = "";
  showToast(text);
}

function showLights() {
  listLights($("lights"), state.lights, selectedLight, changeLight, index => selectHandle(`light-${index}`));
}

function changeLight(index, light) {
  const lights = [...state.lights];
  lights.splice(index, 1, ...(light ? [light] : []));
  change("lights", {lights});
  if (!light) { selectedLight = -1; document.activeElement.blur(); showLights(); }
  handles.draw(navigation.camera);
}

function listHandles() {
  const {pivot, extent} = navigation;
  const list = state.lights.map((light, i) => ({
    id: `light-${i}`, point: handlePosition(light, pivot, extent), colour: lightColour(light), selected: i === selectedLight,
    lineTo: light.type === "directional" ? pivot : null}));
  if (selectedObject) {
    const point = add(scene.object_centers[selectedObject], selectedOffset());
    list.push({id: "object", point, colour: "#5ab0f0", selected: true, lineTo: null});
  }
  return list;
}

function dragHandle(id, point) {
  if (id === "object") moveObject(sub(point, scene.object_centers[selectedObject]));
  else {
    const index = Number(id.split("-")[1]);
    changeLight(index, moveLight(state.lights[index], point, navigation.pivot));
  }
}

function selectHandle(id) {
  selectedLight = id.startsWith("light-") ? Number(id.split("-")[1]) : -1;
  showLights();
  handles.draw(navigation.camera);
}

function selectObject(name) {
  selectedObject = name;
  showObject();
  handles.draw(navigation.camera);
}

function moveObject(translate) {
  change("move_object", {object: selectedObject, translate});
  showObject();
  handles.draw(navigation.camera);
}

const selectedOffset = () => state.object_offsets[selectedObject] ?? [0, 0, 0];

function showObject() {
  $("object").value = selectedObject;
  $("translate").hidden = !selectedObject;
  $("translate").querySelectorAll("input").forEach((input, i) => {
    if (input !== document.activeElement) input.value = Number(selectedOffset()[i].toPrecision(5));
  });
}

const listCameras = () => ({...scene.cameras, ...state.bookmarks});

function showCameras() {
  $("cameras").replaceChildren(...Object.entries(listCameras()).map(([name, camera], i) => {
    const button = document.createElement("button");
    button.textContent = i < 9 ? `${i + 1} ${name}` : name;
    button.onclick = () => goTo(camera);
    if (name in state.bookmarks) {
      button.title = "Right-click to remove";
      button.oncontextmenu = e => { e.preventDefault(); change("bookmark", {name, remove: true}); };
    }
    return button;
  }));
}

function goTo(camera) {
  if (!camera) return;
  navigation.adopt(camera);
  navigation.set(camera);
  $("fov").value = camera.fov_y_deg;
  showNumbers();
}

function addBookmark() {
  const name = $("bookmark-name").value.trim() || `view ${Object.keys(state.bookmarks).length + 1}`;
  $("bookmark-name").value = "";
  change("bookmark", {name});
}

async function copyCamera() {
  const text = JSON.stringify(navigation.camera);
  $("command").hidden = false; $("command").value = text;
  try { await navigator.clipboard.writeText(text); showToast("The camera is in the clipboard, for --camera FILE.json"); }
  catch { $("command").select(); showToast("Copy the text under Save"); }
}

/** Request images as large as the window. */
function resize() {
  const ratio = Number($("resolution").value) || devicePixelRatio;
  const size = [view.clientWidth, view.clientHeight].map(n => Math.min(MAX_SIDE, Math.max(MIN_SIDE, Math.round(n * ratio))));
  if (inControl && state && String(size) !== String(state.size)) change("size", {size});
  if (state) handles.draw(navigation.camera);
}

let resizeTimer = 0;
new ResizeObserver(() => { clearTimeout(resizeTimer); resizeTimer = setTimeout(resize, RESIZE_DELAY_MS); }).observe(view);

for (const name of SELECTS) $(name).onchange = () => { change("settings", {[name]: $(name).value}); showSplit(); };
$("scale").onchange = () => change("settings", {scale: Number($("scale").value)});
$("taa").onchange = () => change("settings", {taa: $("taa").checked});
$("auto_exposure").onchange = () => change("settings", {auto_exposure: $("auto_exposure").checked});
$("reflections").onchange = () => change("settings", {reflections: $("reflections").checked});
$("exposure").oninput = () => { change("settings", {exposure: 2 ** Number($("exposure").value)}); showNumbers(); };
$("time").oninput = () => { $("play").checked = false; setTime(Number($("time").value)); };
$("fov").oninput = () => { navigation.set({...navigation.camera, fov_y_deg: Number($("fov").value)}); showNumbers(); };
$("resolution").onchange = resize;
$("object").onchange = () => selectObject($("object").value);
$("translate").oninput = () => {
  const offset = [...$("translate").querySelectorAll("input")].map(input => input.valueAsNumber);
  if (offset.every(Number.isFinite)) moveObject(offset);
};
$("add-light").onclick = () => {
  selectedLight = state.lights.length;
  const light = newLight($("new-light").value, navigation.camera, navigation.pivot, navigation.extent);
  change("lights", {lights: [...state.lights, light]});
  showLights();
};
$("bookmark").onclick = addBookmark;
$("reset").onclick = () => goTo(home);
$("copy").onclick = copyCamera;
$("take-control").onclick = () => connection.send({type: "take_control"});
$("toggle").onclick = () => {
  const hidden = document.body.classList.toggle("panel-hidden");
  $("toggle").setAttribute("aria-expanded", String(!hidden));
};
for (const button of document.querySelectorAll("[data-save]"))
  button.onclick = () => {
    $("status").textContent = SAVING;
    connection.send({type: "save", kind: button.dataset.save, settle: $("settle").valueAsNumber || 0});
  };

view.addEventListener("dblclick", async e => {
  if (e.target.closest("button")) return;
  const box = view.getBoundingClientRect();
  const position = [(e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height];
  const {point, object} = await connection.ask({type: "pick", camera: navigation.camera, position}) ?? {};
  if (!point) return;
  navigation.choosePivot(point);
  if (object in scene.object_centers) selectObject(object);
  handles.draw(navigation.camera);
});

const SHORTCUTS = {
  b: addBookmark, c: copyCamera, r: () => goTo(home), p: () => $("toggle").click(), t: () => $("taa").click(),
  " ": e => {
    if (!scene.duration || e.target.matches("button, summary")) return;
    e.preventDefault();
    $("play").click();
  },
  m: () => { const s = $("model"); s.selectedIndex = (s.selectedIndex + 1) % s.length; s.onchange(); },
  "[": () => { $("exposure").stepDown(KEY_EXPOSURE_STEPS); $("exposure").oninput(); },
  "]": () => { $("exposure").stepUp(KEY_EXPOSURE_STEPS); $("exposure").oninput(); },
  "+": () => navigation.zoom(KEY_ZOOM), "-": () => navigation.zoom(1 / KEY_ZOOM),
};
addEventListener("keydown", e => {
  navigation.fast = e.shiftKey;
  if (!state || e.ctrlKey || e.metaKey || e.target.matches("input, select, textarea")) return;
  const key = e.key.toLowerCase();
  if (navigation.hold(key)) e.preventDefault();
  else if (SHORTCUTS[key]) SHORTCUTS[key](e);
  else if (/^[1-9]$/.test(key)) goTo(Object.values(listCameras())[Number(key) - 1]);
});

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted.length ? sorted[Math.floor(sorted.length / 2)] : null;
}
