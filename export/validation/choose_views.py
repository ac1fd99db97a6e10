"""Chooses the validation views, which was done once: see ``export.validation.views``."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from app.errors import OutputError, SettingsError, did_you_mean
from app.io.atomic_files import prepare_folders, replace_file, write_text
from app.load import load_scene
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings
from export.dataset.cameras import choose_cameras, normal_spread, random_camera, trace_probe
from export.dataset.contact_sheet import picture_of, tile
from export.dataset.held_out import LIST, digest
from export.dataset.scene_key import scene_key
from export.dataset.scenes.files import find_camera_volumes
from export.dataset.scenes.found_emitters import with_found_emitters
from export.dataset.scenes.generated_scene import GeneratedScene
from export.reference.path_tracer import PathTracer, Samples
from export.validation.views import VALIDATION, generated

Files = dict[str, tuple[str, tuple[str, ...], int]]
Group = tuple[dict[str, Any], Scene, list[Camera]]  # the views of one scene and lighting

SIZE = (256, 192)
EMISSIVE, EMISSIVE_SIZE = "emissive", (384, 288)  # the lighting by emissive surfaces, and the size of its views
CANDIDATES = 64
MIN_LIT, MIN_LUMINANCE = 0.6, 0.02  # see export.dataset.config.Config
FILES: Files = {  # file, lightings of its sidecar file, and views per lighting including the file's own camera
    "sponza": ("sponza/sponza.glb", ("sun", "lamp"), 6),
    "breakfast-room": ("breakfast-room/breakfast-room.glb", ("lamp", "sun"), 6),
    "country-kitchen": ("country-kitchen/country-kitchen.glb", ("spot", "lamp", "emissive"), 4),
    "cornell-box": ("cornell-box/CornellBox-Original.obj", ("lamp", "emissive"), 4),
    "stanford": ("stanford/stanford-in-box.glb", ("lamp", "emissive"), 4),
}
GENERATED = (("room", 0), ("room", 1), ("courtyard", 2), ("blocks-day", 0))  # source and seed
VIEWS_OF_GENERATED = 4
# Added later, so their random numbers are apart from those of the lists above.
EMISSIVE_NUMBER = 100
TRAINING_FILES: Files = {"contemporary-bathroom": ("contemporary-bathroom/contemporary-bathroom.glb", (EMISSIVE,), 4)}
Arguments = dict[str, float]
EMISSIVE_GENERATED: tuple[tuple[str, int, tuple[Arguments, ...]], ...] = (  # source, seed and arguments of its scenes
    ("door_ajar", 0, tuple({"angle_deg": angle} for angle in (2.0, 8.0, 25.0, 60.0))),
    ("barred_window", 0, ({},)), ("archway_stair", 0, ({},)), ("chandelier", 0, ({},)),
)
VIEWS_OF_EMISSIVE = 6  # including the scene's own camera
SHEET_FORMATS = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg"}


def write_views(scenes: Path, seed: int, drop: list[str], sheet: Path | None) -> None:
    """Choose views, write the list of all except those in ``drop``, and optionally a contact sheet.

    Raises
    ------
    SettingsError
        When ``drop`` contains an unknown name.
    OutputError
        When the sheet can't be written; the list is then unchanged.
    """
    if sheet is not None:
        if sheet.suffix.lower() not in SHEET_FORMATS:
            raise OutputError(f"unknown suffix {sheet.suffix!r}", sheet, f"expected one of: {', '.join(SHEET_FORMATS)}")
        prepare_folders(sheet.parent)
    chosen: list[tuple[dict[str, Any], Scene, Camera]] = []
    groups = [*_of_files(scenes, FILES, seed), *_of_generators(seed),
              *_of_files(scenes, TRAINING_FILES, seed, EMISSIVE_NUMBER), *_of_emissive_generators(seed)]
    for entry, scene, cameras in groups:
        if entry.get("lighting") == EMISSIVE:
            entry["size"] = EMISSIVE_SIZE
        for k, camera in enumerate(cameras):
            name = "-".join(str(entry[key]) for key in ("scene", "lighting") if key in entry) + f"-{k}"
            chosen.append(({"name": name, **entry, "camera": asdict(camera)}, scene, camera))
        print(entry["scene"], entry.get("lighting", ""), len(cameras), flush=True)
    names = [entry["name"] for entry, _, _ in chosen]
    if unknown := [name for name in drop if name not in names]:
        raise SettingsError(f"no view {unknown[0]!r}", "--drop", did_you_mean(unknown[0], names))
    chosen = [view for view in chosen if view[0]["name"] not in drop]
    if sheet is not None:
        with replace_file(sheet) as temporary:
            tile([_picture(scene, camera, entry["name"]) for entry, scene, camera in chosen]).save(
                temporary, SHEET_FORMATS[sheet.suffix.lower()])
    files = {name: {"file": file, "sha256": digest(scenes / file), "held_out": name in FILES}
             for name, (file, _, _) in {**FILES, **TRAINING_FILES}.items()}
    about = {"made_by": "python -m export validate choose", "seed": seed, "dropped": drop, "size": SIZE}
    write_text(LIST, json.dumps({**about, "files": files, "views": [entry for entry, _, _ in chosen]}, indent=1) + "\n")


def _of_files(folder: Path, files: Files, seed: int, first: int = 0) -> list[Group]:
    entries = []
    for number, (name, (file, lightings, count)) in enumerate(files.items(), first):
        for light, lighting in enumerate(lightings):
            scene = load_scene(folder / file, lighting=lighting)
            generated_scene = GeneratedScene(scene, find_camera_volumes(folder / file)[0], np.zeros((0, 2, 3)))
            cameras = _cameras(generated_scene, np.random.default_rng([VALIDATION, seed, number, light]), count - 1)
            default = scene.cameras[scene.default_camera].at(0.0)
            entries.append(({"scene": name, "lighting": lighting}, scene, [default, *cameras]))
    return entries


def _of_generators(seed: int) -> list[Group]:
    entries = []
    for number, (source, own_seed) in enumerate(GENERATED):
        generated_scene = generated(source, own_seed)
        scene = generated_scene.scene
        rng = np.random.default_rng([VALIDATION, seed, len(FILES) + number])
        entry = {"scene": f"{source}-{own_seed}", "source": source, "seed": own_seed, "key": scene_key(scene)}
        entries.append((entry, scene, _cameras(generated_scene, rng, VIEWS_OF_GENERATED)))
    return entries


def _of_emissive_generators(seed: int) -> list[Group]:
    """The views of the emissive sources; scenes that differ only in arguments share the cameras of the last one."""
    entries = []
    for number, (source, own_seed, scenes) in enumerate(EMISSIVE_GENERATED, EMISSIVE_NUMBER + len(TRAINING_FILES)):
        raw = [generated(source, own_seed, arguments) for arguments in scenes]
        complete = [with_found_emitters(generated_scene.scene) for generated_scene in raw]
        rng = np.random.default_rng([VALIDATION, seed, number])
        own = raw[-1].scene.cameras[raw[-1].scene.default_camera].at(0.0)
        cameras = [own, *_cameras(replace(raw[-1], scene=complete[-1]), rng, VIEWS_OF_EMISSIVE - 1)]
        for arguments, generated_scene, scene in zip(scenes, raw, complete, strict=True):
            name = "-".join([source, *(f"{value:g}" for value in arguments.values()), str(own_seed)])
            entry = {"scene": name, "lighting": EMISSIVE, "source": source, "seed": own_seed, "arguments": arguments,
                     "key": scene_key(generated_scene.scene)}
            entries.append((entry, scene, cameras))
    return entries


def _cameras(generated_scene: GeneratedScene, rng: np.random.Generator, wanted: int) -> list[Camera]:
    """The most interesting of the random cameras that pass the dataset's own test."""
    tracer, edge = PathTracer(generated_scene.scene, emission_is_direct=False), generated_scene.scene.longest_edge
    candidates = [random_camera(generated_scene, rng) for _ in range(CANDIDATES)]
    suitable = [candidates[k] for k in choose_cameras(tracer, edge, candidates, CANDIDATES, MIN_LIT, MIN_LUMINANCE)]
    return sorted(suitable, key=lambda camera: -_interest(trace_probe(tracer, camera, edge), edge))[:wanted]


def _interest(samples: Samples, longest_edge: float) -> float:
    """A score that grows with the mean and spread of depth and with the spread of normals."""
    depth = samples.depth[samples.depth > 0] / longest_edge
    return normal_spread(samples) * min(float(depth.mean()), 0.3) * min(float(depth.std() / depth.mean()), 1.0)


def _picture(scene: Scene, camera: Camera, name: str) -> Image.Image:
    with Renderer(scene, Settings(SIZE, ("final",), taa=False, provider="cpu"), find_model("radiosity")) as renderer:
        final = renderer.render(camera)["final"]
    picture = picture_of(final)
    ImageDraw.Draw(picture).text((4, 2), name, fill=(255, 255, 0), stroke_width=1, stroke_fill=(0, 0, 0))
    return picture
