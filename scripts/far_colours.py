"""Does colour arrive from afar, and that of lamps as no picture showed it?

    python scripts/far_colours.py OUT.jpg MODEL…

In a room 8 m wide two spots shine on its left wall, which is white or green; or two lamps light its floor, white
ones, or a red and a blue one. So the light changes its colour: ``change`` is how the shares of red, green and blue in
the indirect light differ from those under white. For each model (``none``, ``ssgi``, names, paths) is printed
Σ |change - the truth's| / Σ |the truth's|, for thirds of the picture from left to right: 0 is right, 1 is what a
network has that sees no difference. OUT gets the pictures, the truth's (256 denoised paths a pixel) first.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from app.bench.configurations import expand
from app.bench.judge import Layers, draw_layers
from app.metrics import exposure_of, tone_map
from app.scene import Camera, Light, Material, PointLight, Scene, SpotLight
from export.dataset.assembly import Assembly
from export.dataset.materials import Color
from export.dataset.parts import block, cylinder, slab
from export.dataset.walls import build, rectangle
from export.judge import truth_of
from export.reference import Still
from export.validation import View

F32 = NDArray[np.float32]

SIZE = (256, 192)
PATHS = 256
CAMERA = Camera((0.0, 1.5, 2.85), (0.0, 1.2, -3.0), fov_y_deg=80.0)
WIDTH, DEPTH, HEIGHT = 8.0, 6.0, 3.0
WHITE, GREEN, WOOD = (0.75, 0.75, 0.75), (0.1, 0.6, 0.1), (0.5, 0.5, 0.5)
RED_LIGHT, BLUE_LIGHT = (1.0, 0.03, 0.03), (0.03, 0.03, 1.0)
CHANGES = {"green wall": ("white wall", "green wall"), "red and blue lamp": ("white lamps", "red and blue lamp")}
DARKEST = 1e-4  # of the mean: no colour can be told there
LABEL = 90      # pixels of the sheet


def scenes() -> dict[str, Scene]:
    """All four, by name."""
    on_wall = [SpotLight((-1.6, 2.7, z), (-1.0, -0.55, 0.0), (60.0,) * 3, inner_deg=25.0, outer_deg=38.0, radius=0.05)
               for z in (-2.0, -0.4)]
    dim: list[Light] = [PointLight((2.5, 2.6, 0.5), (0.8,) * 3, radius=0.1)]

    def lamps(left: Color, right: Color) -> list[Light]:
        return [SpotLight((x, 2.8, -0.8), (0.0, -1.0, 0.0), (60 * r, 60 * g, 60 * b), inner_deg=20.0, outer_deg=40.0,
                          radius=0.05) for x, (r, g, b) in ((-2.4, left), (2.4, right))]

    return {"white wall": room(WHITE, [*on_wall, *dim]), "green wall": room(GREEN, [*on_wall, *dim]),
            "white lamps": room(WHITE, lamps((1.0,) * 3, (1.0,) * 3)),
            "red and blue lamp": room(WHITE, lamps(RED_LIGHT, BLUE_LIGHT))}


def room(left: Color, lights: list[Light]) -> Scene:
    """A white room with a floor of wood, a few things in it, and a left wall of another colour."""
    assembly = Assembly(np.random.default_rng(0))  # nothing is random here
    white, wood = Material(albedo=WHITE), Material(albedo=WOOD)
    build(assembly, rectangle(WIDTH, DEPTH, HEIGHT), [white, white, white, Material(albedo=left)])
    x, z = WIDTH / 2 + 0.3, DEPTH / 2 + 0.3
    assembly.add(slab((-x, -0.3, -z), (x, 0.0, z)), wood)
    assembly.add(slab((-x, HEIGHT, -z), (x, HEIGHT + 0.3, z)), white)
    for size, at in (((0.8, 0.8, 0.8), (-0.4, 0.0, -1.6)), ((0.7, 1.6, 0.7), (2.4, 0.0, -2.2)),
                     ((0.9, 0.4, 0.9), (1.6, 0.0, -0.2))):
        assembly.add(block(size, at), white)
    assembly.add(cylinder(0.25, 1.2, (-2.2, 0.0, -1.9)), white)
    assembly.lights += lights
    return assembly.place("room", []).scene


def shares(light: F32) -> F32:
    """Of red, green and blue, [H, W, 3]; a third each in the dark."""
    total = light.sum(axis=-1, keepdims=True)
    lit = total > DARKEST * total.mean()
    return np.divide(light, total, out=np.full_like(light, 1 / 3), where=lit)


def errors(found: dict[str, F32], truth: dict[str, F32], seen: NDArray[np.bool_]) -> list[float]:
    """Of each change of ``CHANGES``, for the thirds of the picture from left to right."""
    out = []
    for before, after in CHANGES.values():
        change, expected = ((shares(x[after]) - shares(x[before])) * seen[..., None] for x in (found, truth))
        out += [float(np.abs(change - expected)[:, part].sum() / np.abs(expected[:, part]).sum())
                for part in np.array_split(np.arange(SIZE[0]), 3)]
    return out


def main(out: Path, models: list[str]) -> None:
    made = scenes()
    stills = {name: Still(scene, CAMERA, SIZE) for name, scene in made.items()}
    truths = {name: truth_of(View(name.replace(" ", "-"), "room", still), PATHS, None)
              for name, still in stills.items()}
    configurations, absent = expand(models, [SIZE])
    if absent:
        sys.exit("; ".join(absent))
    light = {name: truth.layers["indirect"] for name, truth in truths.items()}
    seen = truths["white wall"].demodulated
    pictures = {"truth": [truths[name].layers["final"] for name in made]}
    print(f"{'':24} {'green wall':>22} {'red and blue lamp':>22}")
    for c in configurations:
        drawn: dict[str, Layers] = {name: draw_layers(scene, CAMERA, replace(c, size=SIZE), "cpu")
                                    for name, scene in made.items()}
        pictures[c.label] = [drawn[name]["final"] for name in made]
        figures = errors({name: layers["indirect"] for name, layers in drawn.items()}, light, seen)
        print(f"{c.label:24} " + " ".join(f"{x:7.2f}" for x in figures), flush=True)
    sheet(out, pictures, [exposure_of(truth.layers["final"]) for truth in truths.values()])


def sheet(out: Path, pictures: dict[str, list[F32]], exposures: list[float]) -> None:
    """A row for each model, all pictures of a column exposed alike."""
    (w, h), columns = SIZE, len(exposures)
    image = Image.new("RGB", (LABEL + columns * w, len(pictures) * h), "white")
    for row, (label, of_model) in enumerate(pictures.items()):
        ImageDraw.Draw(image).text((4, row * h + h // 2), label, fill="black")
        for column, (picture, exposure) in enumerate(zip(of_model, exposures, strict=True)):
            shown = Image.fromarray((255 * tone_map(picture, exposure)).astype(np.uint8))
            image.paste(shown, (LABEL + column * w, row * h))
    image.save(out, quality=85)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), sys.argv[2:])
