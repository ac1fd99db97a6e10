"""Small scenes for the tests that draw, and one-line ways to draw them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.math3d import translation
from app.passes.shadow import EMPTY
from app.renderer import Renderer
from app.scene import Camera, CameraPath, Environment, Instance, Light, Material, Mesh, Motion, Scene, bounds_of
from app.settings import Settings
from tests.gl.closed_forms import polygon_irradiance
from tests.override import override

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Point = tuple[float, float, float]
Images = dict[str, NDArray[np.float32]]

GREY = Material(albedo=(0.5, 0.5, 0.5))
DIM = 0.2  # W/(sr m²), of the sky that the cellar's window shows
OVERHEAD = Camera((0.0, 3.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 60.0)


@dataclass(frozen=True, eq=False)
class Part:
    """One object: corners of its triangles, and what it is made of. No normals: each face has its own."""

    triangles: F64  # [T, 3, 3]
    material: Material = GREY
    uvs: F64 | None = None  # [T, 3, 2]
    motion: Motion | None = None
    place: F64 = field(default_factory=lambda: np.eye(4))


def quad(corner: Point, u: Point, v: Point, material: Material = GREY, motion: Motion | None = None) -> Part:
    """The rectangle ``corner`` + s ``u`` + t ``v``; its front is the side of u × v and its uv is (s, t)."""
    st = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)[[[0, 1, 2], [0, 2, 3]]]
    return Part(np.asarray(corner) + st @ np.array([u, v], np.float64), material, st, motion)


def floor(half: float, y: float = 0.0, material: Material = GREY) -> Part:
    return quad((-half, y, half), (2 * half, 0, 0), (0, 0, -2 * half), material)


def box(low: Point, size: Point, material: Material = GREY, motion: Motion | None = None) -> Part:
    """Six faces, seen from outside or from within."""
    edges, faces = np.diag(np.asarray(size, np.float64)), []
    for axis in range(3):
        u, v = edges[(axis + 1) % 3], edges[(axis + 2) % 3]
        faces += [quad(tuple(low), tuple(v), tuple(u)), quad(tuple(np.asarray(low) + edges[axis]), tuple(u), tuple(v))]
    return Part(np.concatenate([f.triangles for f in faces]), material, motion=motion)


def sphere(center: Point, radius: float, steps: int = 48, material: Material = GREY) -> Part:
    """Flat faces, ``steps`` from pole to pole."""
    theta = np.linspace(0, np.pi, steps + 1)[:, None]
    phi = np.linspace(0, 2 * np.pi, 2 * steps + 1)[None, :]
    at = np.stack(np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)), -1)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    corners = np.concatenate([np.stack([a, b, c], 2)[:-1], np.stack([a, c, d], 2)[1:]]).reshape(-1, 3, 3)
    return Part(np.asarray(center) + radius * corners, material)


def slide(times: Iterable[float], offsets: Iterable[Point]) -> Motion:
    """Straight motion through ``offsets``."""
    return Motion(np.array(list(times), np.float64), np.stack([translation(np.asarray(o)) for o in offsets]))


def make_scene(parts: Iterable[Part], lights: Iterable[Light] = (), camera: Camera = OVERHEAD) -> Scene:
    parts = list(parts)
    meshes, instances = [], []
    for index, part in enumerate(parts):
        count = len(part.triangles)
        positions = part.triangles.reshape(-1, 3).astype(np.float32)
        uvs = None if part.uvs is None else part.uvs.reshape(-1, 2).astype(np.float32)
        meshes.append(Mesh(f"part {index}", positions, np.zeros_like(positions),
                           np.arange(3 * count, dtype=np.uint32).reshape(-1, 3), index, uvs))
        instances.append(Instance(f"part {index}", index, part.place, part.motion))
    return Scene("test", tuple(meshes), tuple(instances), tuple(p.material for p in parts), tuple(lights),
                 {"main": CameraPath.still(camera)}, "main", bounds_of(tuple(meshes), tuple(instances)))


def cellar(window: float) -> Scene:
    """A box of 4 m with a square hole in the middle of one wall, under a sky whose light comes from above."""
    low, high = 2 - window / 2, 2 + window / 2
    walls = [quad((0, 0, 0), (0, 0, 4), (4, 0, 0)), quad((0, 4, 0), (4, 0, 0), (0, 0, 4)),
             quad((0, 0, 0), (0, 4, 0), (0, 0, 4)), quad((4, 0, 0), (0, 0, 4), (0, 4, 0)),
             quad((0, 0, 4), (0, 4, 0), (4, 0, 0)),
             quad((0, 0, 0), (low, 0, 0), (0, 4, 0)), quad((high, 0, 0), (4 - high, 0, 0), (0, 4, 0)),
             quad((low, 0, 0), (window, 0, 0), (0, low, 0)), quad((low, high, 0), (window, 0, 0), (0, 4 - high, 0))]
    radiance = np.full((16, 32, 3), DIM, np.float32)
    radiance[:2] = 20.0  # bright above, where most of the floor doesn't see it
    return replace(make_scene(walls), environment=Environment(radiance))


def window_irradiance(points: F64, window: float) -> F64:
    """Irradiance of points on the floor of the ``cellar`` that see only dim sky: from z = 1.6 on."""
    low, high = 2 - window / 2, 2 + window / 2
    corners = np.array([(low, low, 0), (high, low, 0), (high, high, 0), (low, high, 0)])
    return DIM * polygon_irradiance(points, np.array([0.0, 1.0, 0.0]), corners)


def moved(scene: Scene, offset: Point = (0, 0, 0), scale: float = 1.0) -> Scene:
    """The same scene elsewhere and at another size; lights send what makes the same picture."""
    offset_m = translation(np.asarray(offset, np.float64)) @ np.diag([scale, scale, scale, 1.0])
    instances = tuple(replace(i, transform=offset_m @ i.transform) for i in scene.instances)
    return replace(scene, instances=instances, bounds=bounds_of(scene.meshes, instances),
                   lights=tuple(_moved_light(light, offset, scale) for light in scene.lights),
                   cameras={n: replace(p, keys=tuple(moved_camera(k, offset, scale) for k in p.keys))
                            for n, p in scene.cameras.items()})


def moved_camera(camera: Camera, offset: Point, scale: float) -> Camera:
    return replace(camera, eye=_shift(camera.eye, offset, scale), target=_shift(camera.target, offset, scale))


def without_shadows(scene: Scene) -> Scene:
    """Nothing casts: of lamps because what analytic lights stand for doesn't, of suns by ``leave_out_shadows``."""
    return replace(scene, materials=tuple(replace(m, is_light_proxy=True) for m in scene.materials))


def draw(scene: Scene, size: tuple[int, int], outputs: tuple[str, ...] = ("final",), camera: Camera | None = None,
         model: Path | None = None, **settings: object) -> Images:
    """One frame without temporal anti-aliasing, in a renderer of its own."""
    options = {"taa": False, "provider": "cpu", **settings}
    with Renderer(scene, Settings(size=size, outputs=outputs, **options), model) as renderer:  # type: ignore[arg-type]
        if all(material.is_light_proxy for material in scene.materials):
            leave_out_shadows(renderer)
        return renderer.render(camera or scene.cameras[scene.default_camera].at(0.0))


def leave_out_shadows(renderer: Renderer) -> None:
    """Empty all shadow maps from now on."""
    for name in ("shadow", "shadow_nearest"):
        override(renderer, name, EMPTY)


def visibility(scene: Scene, size: tuple[int, int], camera: Camera) -> tuple[F64, F64]:
    """Share [h, w] of the lights' direct light that arrives, and the surface points [h, w, 3]."""
    lit = draw(scene, size, ("direct", "position"), camera)
    free = draw(without_shadows(scene), size, ("direct",), camera)["direct"][..., 1].astype(np.float64)
    share = np.divide(lit["direct"][..., 1], free, out=np.ones_like(free), where=free > 0)
    return share, lit["position"].astype(np.float64)


def _shift(point: Point, offset: Point, scale: float) -> Point:
    return tuple((np.asarray(point) * scale + np.asarray(offset)).tolist())


def _moved_light(light: Light, offset: Point, scale: float) -> Light:
    changes: dict[str, object] = {}
    for name in ("position", "center"):
        if hasattr(light, name):
            changes[name] = _shift(getattr(light, name), offset, scale)
    for name in ("edge_u", "edge_v"):
        if hasattr(light, name):
            changes[name] = tuple(c * scale for c in getattr(light, name))
    if hasattr(light, "intensity"):
        changes |= {"intensity": tuple(c * scale**2 for c in light.intensity), "radius": light.radius * scale}
    return replace(light, **changes)  # type: ignore[arg-type]
