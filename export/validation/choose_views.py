"""Chooses the validation views; they were chosen once, before the first training run."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from app.evaluation.metrics import exposure_of, tone_map
from app.io.atomic_files import write_text
from app.load import load_scene
from app.network.contract import find_model
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings
from export.dataset.cameras import choose, normal_spread, probe, random_camera
from export.dataset.held_out import LIST, digest
from export.dataset.key import scene_key
from export.dataset.scenes.files import standing
from export.dataset.scenes.generated_scene import GeneratedScene
from export.reference.path_tracer import PathTracer, Samples
from export.validation.views import VALIDATION, generated

SIZE = (256, 192)
CANDIDATES = 64
MIN_LIT, DARKEST = 0.6, 0.02  # see export.dataset.config.Config
FILES = {  # with the lightings of their sidecar files; views of each, the file's own camera among them
    "sponza": ("sponza/sponza.glb", ("sun", "lamp"), 6),
    "breakfast-room": ("breakfast-room/breakfast-room.glb", ("lamp", "sun"), 6),
    "country-kitchen": ("country-kitchen/country-kitchen.glb", ("spot", "lamp", "emissive"), 4),
    "cornell-box": ("cornell-box/CornellBox-Original.obj", ("lamp", "emissive"), 4),
    "stanford": ("stanford/stanford-in-box.glb", ("lamp", "emissive"), 4),
}
GENERATED = (("room", 0), ("room", 1), ("courtyard", 2), ("blocks-day", 0))  # sources and seeds
VIEWS_OF_GENERATED = 4
COLUMNS = 8


def write_views(scenes: Path, seed: int, drop: list[str], sheet: Path | None) -> None:
    """Choose views, write their list but for those in ``drop``, and a contact sheet if one is asked for."""
    entries: list[dict[str, Any]] = []
    pictures: list[Image.Image] = []
    for entry, scene, cameras in [*_of_files(scenes, seed), *_of_generators(seed)]:
        for k, camera in enumerate(cameras):
            name = "-".join(str(entry[key]) for key in ("scene", "lighting") if key in entry) + f"-{k}"
            if name in drop:
                continue
            entries.append({"name": name, **entry, "camera": asdict(camera)})
            if sheet is not None:
                pictures.append(_picture(scene, camera, name))
        print(entry["scene"], entry.get("lighting", ""), len(cameras), flush=True)
    files = {name: {"file": file, "sha256": digest(scenes / file)}
             for name, (file, _, _) in FILES.items()}
    about = {"made_by": "python -m export validate choose", "seed": seed, "dropped": drop, "size": SIZE}
    write_text(LIST, json.dumps({**about, "files": files, "views": entries}, indent=1) + "\n")
    if sheet is not None:
        _contact_sheet(pictures).save(sheet)


def _of_files(folder: Path, seed: int) -> list[tuple[dict[str, Any], Scene, list[Camera]]]:
    found = []
    for number, (name, (file, lightings, count)) in enumerate(FILES.items()):
        for light, lighting in enumerate(lightings):
            scene = load_scene(folder / file, lighting=lighting)
            place = GeneratedScene(scene, standing(folder / file)[0], np.zeros((0, 2, 3)))
            cameras = _cameras(place, np.random.default_rng([VALIDATION, seed, number, light]), count - 1)
            own = scene.cameras[scene.default_camera].at(0.0)
            found.append(({"scene": name, "lighting": lighting}, scene, [own, *cameras]))
    return found


def _of_generators(seed: int) -> list[tuple[dict[str, Any], Scene, list[Camera]]]:
    found = []
    for number, (source, own) in enumerate(GENERATED):
        place = generated(source, own)
        cameras = _cameras(place, np.random.default_rng([VALIDATION, seed, len(FILES) + number]), VIEWS_OF_GENERATED)
        entry = {"scene": f"{source}-{own}", "source": source, "seed": own, "key": scene_key(place.scene)}
        found.append((entry, place.scene, cameras))
    return found


def _cameras(place: GeneratedScene, rng: np.random.Generator, wanted: int) -> list[Camera]:
    """Of those that show something, by the same measure as the dataset's, the ones that show most."""
    tracer, edge = PathTracer(place.scene), place.scene.longest_edge
    candidates = [random_camera(place, rng) for _ in range(CANDIDATES)]
    fit = [candidates[k] for k in choose(tracer, edge, candidates, CANDIDATES, MIN_LIT, DARKEST)]
    return sorted(fit, key=lambda camera: -_interest(probe(tracer, camera, edge), edge))[:wanted]


def _interest(samples: Samples, longest_edge: float) -> float:
    """Grows with the depth's mean and spread, and with how many ways surfaces face."""
    depth = samples.depth[samples.depth > 0] / longest_edge
    return normal_spread(samples) * min(float(depth.mean()), 0.3) * min(float(depth.std() / depth.mean()), 1.0)


def _picture(scene: Scene, camera: Camera, name: str) -> Image.Image:
    with Renderer(scene, Settings(SIZE, ("final",), taa=False, provider="cpu"), find_model("radiosity")) as renderer:
        final = renderer.render(camera)["final"]
    picture = Image.fromarray((255 * tone_map(final, exposure_of(final))).astype(np.uint8))
    ImageDraw.Draw(picture).text((4, 2), name, fill=(255, 255, 0), stroke_width=1, stroke_fill=(0, 0, 0))
    return picture


def _contact_sheet(pictures: list[Image.Image]) -> Image.Image:
    rows = -(-len(pictures) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * SIZE[0], rows * SIZE[1]))
    for k, picture in enumerate(pictures):
        sheet.paste(picture, (k % COLUMNS * SIZE[0], k // COLUMNS * SIZE[1]))
    return sheet

