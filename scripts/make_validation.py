"""Choose the validation views and write ``export/validation.json``, with a contact sheet to look at.

``python scripts/make_validation.py --sheet sheet.png``, then look, then again with ``--drop NAME --drop NAME …``.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from PIL import Image, ImageDraw

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from app.atomic import write_text
from app.contract import find_model
from app.load import load_scene
from app.metrics import exposure_of, tone_map
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings
from export.dataset.cameras import choose, normal_spread, probe, random_camera
from export.dataset.files import standing
from export.dataset.held_out import LIST, digest
from export.dataset.key import scene_key
from export.dataset.place import Place
from export.path_tracer import PathTracer, Samples
from export.validation import SCENES, VALIDATION, generated

SIZE = (256, 192)
CANDIDATES = 64
LEAST_LIT, DARKEST = 0.6, 0.02  # see export.dataset.config.Config
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


def main(scenes: Annotated[Path, typer.Option(help="Folder of the scene files.")] = SCENES,
         seed: int = 0, drop: Annotated[list[str] | None, typer.Option(help="Names of views to leave out.")] = None,
         sheet: Annotated[Path | None, typer.Option(help="Contact sheet to write.")] = None) -> None:
    """Write the list; with ``--sheet`` also a picture of every view."""
    entries: list[dict[str, Any]] = []
    pictures: list[Image.Image] = []
    for entry, scene, cameras in [*_of_files(scenes, seed), *_of_generators(seed)]:
        for k, camera in enumerate(cameras):
            name = "-".join(str(entry[key]) for key in ("scene", "lighting") if key in entry) + f"-{k}"
            if name in (drop or ()):
                continue
            entries.append({"name": name, **entry, "camera": asdict(camera)})
            if sheet is not None:
                pictures.append(_picture(scene, camera, name))
        print(entry["scene"], entry.get("lighting", ""), len(cameras), flush=True)
    files = {name: {"file": file, "sha256": digest(scenes / file)}
             for name, (file, _, _) in FILES.items()}
    about = {"made_by": "scripts/make_validation.py", "seed": seed, "dropped": drop or [], "size": SIZE}
    write_text(LIST, json.dumps({**about, "files": files, "views": entries}, indent=1) + "\n")
    if sheet is not None:
        _contact_sheet(pictures).save(sheet)


def _of_files(folder: Path, seed: int) -> list[tuple[dict[str, Any], Scene, list[Camera]]]:
    found = []
    for number, (name, (file, lightings, count)) in enumerate(FILES.items()):
        for light, lighting in enumerate(lightings):
            scene = load_scene(folder / file, lighting=lighting)
            place = Place(scene, standing(folder / file)[0], np.zeros((0, 2, 3)))
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


def _cameras(place: Place, rng: np.random.Generator, wanted: int) -> list[Camera]:
    """Of those that show something, by the same measure as the dataset's, the ones that show most."""
    tracer, edge = PathTracer(place.scene), place.scene.longest_edge
    candidates = [random_camera(place, rng) for _ in range(CANDIDATES)]
    fit = [candidates[k] for k in choose(tracer, edge, candidates, CANDIDATES, LEAST_LIT, DARKEST)]
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


if __name__ == "__main__":
    typer.run(main)
