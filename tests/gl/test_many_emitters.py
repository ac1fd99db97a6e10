"""Many and curved emissive pieces: the renderer's few lights against the path tracer, which traces the pieces."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from app.load import load_scene
from app.load.light_tree import MAX_LIGHTS
from app.scene import Camera, CameraPath, Scene
from tests.gl.scenes import draw

if importlib.util.find_spec("mitsuba") is None:
    pytest.skip("Mitsuba, of the extra 'export', is not installed", allow_module_level=True)

from export.reference.path_tracer import PathTracer
from export.reference.still import Still
from export.reference.trace import mean_samples

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "path_tracer")]

SIZE = (96, 72)
CAMERA = Camera((0.0, 1.5, 2.3), (0.0, 0.9, 0.0), fov_y_deg=75.0)
MTL = "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl warm\nKd 0 0 0\nKe 60 45 25\nnewmtl cold\nKd 0 0 0\nKe 20 40 60\n"


def write_room(folder: Path, parts: dict[str, trimesh.Trimesh]) -> Scene:
    """A room with two boxes in it, and a mesh of each material: what emits, and what is grey besides."""
    walls = trimesh.creation.box(extents=(5, 3, 5))
    walls.invert()
    walls.apply_translation((0, 1.5, 0))
    boxes = [trimesh.creation.box(bounds=bounds) for bounds in (((-0.5, 0, -0.4), (0.5, 0.7, 0.4)),
                                                               ((-1.7, 0, -1.6), (-1.0, 1.4, -1.0)))]
    text, base = "mtllib room.mtl\n", 1
    grey = trimesh.util.concatenate([walls, *boxes, *([parts["grey"]] if "grey" in parts else [])])
    for name, mesh in {**parts, "grey": grey}.items():
        text += f"o {name}\nusemtl {name}\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in mesh.vertices)
        text += "".join(f"f {a} {b} {c}\n" for a, b, c in mesh.faces + base)
        base += len(mesh.vertices)
    (folder / "room.mtl").write_text(MTL)
    (folder / "room.obj").write_text(text)
    scene = load_scene(folder / "room.obj")
    return replace(scene, cameras={"main": CameraPath.still(CAMERA)}, default_camera="main")


def ring(part: trimesh.Trimesh, radius: float, y: float, count: int) -> trimesh.Trimesh:
    parts = []
    for angle in 2 * np.pi * np.arange(count) / count:
        parts.append(part.copy())
        parts[-1].apply_translation((radius * np.cos(angle), y, radius * np.sin(angle)))
    return trimesh.util.concatenate(parts)


def bulbs() -> dict[str, trimesh.Trimesh]:
    """A chandelier of 240 bulbs in two colours."""
    bulb = trimesh.creation.icosphere(1, 0.01)
    return {"warm": trimesh.util.concatenate([ring(bulb, 0.6, 2.1, 100), ring(bulb, 0.4, 2.3, 60)]),
            "cold": ring(bulb, 0.5, 2.2, 80)}


def tiles() -> dict[str, trimesh.Trimesh]:
    """A ceiling with 15 × 15 panels, which face down."""
    panel = trimesh.Trimesh(0.05 * np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)]), [[0, 1, 2], [0, 2, 3]],
                            process=False)
    parts = []
    for x in np.linspace(-2.2, 2.2, 15):
        for z in np.linspace(-2.2, 2.2, 15):
            parts.append(panel.copy())
            parts[-1].apply_translation((x, 2.98, z))
    return {"warm": trimesh.util.concatenate(parts)}


def recessed() -> dict[str, trimesh.Trimesh]:
    """36 downlights, each in a box without a bottom that hangs from the ceiling."""
    panel = trimesh.Trimesh(0.06 * np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)]), [[0, 1, 2], [0, 2, 3]],
                            process=False)
    can = trimesh.creation.box(extents=(0.14, 0.16, 0.14))
    can.update_faces(can.face_normals[:, 1] > -0.5)
    parts: dict[str, list[trimesh.Trimesh]] = {"warm": [], "grey": []}
    for x in np.linspace(-2, 2, 6):
        for z in np.linspace(-2, 2, 6):
            for name, part, y in (("warm", panel, 2.97), ("grey", can, 2.91)):
                parts[name].append(part.copy())
                parts[name][-1].apply_translation((x, y, z))
    return {name: trimesh.util.concatenate(meshes) for name, meshes in parts.items()}


def shelf() -> dict[str, trimesh.Trimesh]:
    """A row of 60 diodes close to a wall, behind the lip of a board."""
    diode = trimesh.creation.box(extents=(0.03, 0.01, 0.03))
    row = [diode.copy().apply_translation((x, 1.6, -2.2)) for x in np.linspace(-1.5, 1.5, 60)]
    board = [trimesh.creation.box(bounds=((-1.6, 1.604, -2.5), (1.6, 1.63, -2.1))),
             trimesh.creation.box(bounds=((-1.6, 1.54, -2.12), (1.6, 1.63, -2.1)))]
    return {"cold": trimesh.util.concatenate(row), "grey": trimesh.util.concatenate(board)}


def shade() -> dict[str, trimesh.Trimesh]:
    """An upright cylinder without caps."""
    tube = trimesh.creation.cylinder(0.3, 0.4, sections=48)
    tube.update_faces(np.abs(tube.face_normals[:, 2]) < 0.5)
    tube.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    tube.apply_translation((1.2, 1.3, -0.8))
    return {"warm": tube}


@pytest.mark.parametrize(("make", "max_error", "max_bias"),
                         [(bulbs, 0.07, 0.02), (tiles, 0.05, 0.02), (shade, 0.06, 0.02), (recessed, 0.12, 0.06),
                          (shelf, 0.14, 0.08)],
                         ids=["bulbs", "tiles", "shade", "recessed", "shelf"])
def test_direct_light_of_many_emitters(make: Callable[[], dict[str, trimesh.Trimesh]], max_error: float,
                                       max_bias: float, tmp_path: Path) -> None:
    """Mean and mean absolute error of direct light with shadows, relative to the mean."""
    scene = write_room(tmp_path, make())
    assert len(scene.lights) <= MAX_LIGHTS and scene.approximate_lights
    drawn = draw(scene, SIZE, ("direct",))["direct"]
    reference = mean_samples(PathTracer(scene, max_bounces=0), Still(scene, CAMERA, SIZE), 768)["direct"]
    error, bias = np.abs(drawn - reference).mean() / reference.mean(), drawn.mean() / reference.mean() - 1
    print(f"{len(scene.lights)} lights: mean error {error:.1%}, mean {bias:+.1%}")
    assert error < max_error
    assert abs(bias) < max_bias
