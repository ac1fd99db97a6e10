"""Light where an eighth of the image has few texels: edges of blocks, corners of walls, mouldings, feet of things.

Each is compared with many rays from the pixels themselves, which end at the light of the newest surfels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from app.arrays import F32, Bools
from app.network.selection import find_model
from app.radiance_scale import radiance_scale
from app.renderer import Renderer
from app.scene import Camera, Material
from app.settings import Settings
from app.surfels.final_gather import LightAt, gather, sequence
from tests.gl.scenes import box, make_scene

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SIZE = (256, 192)
FRAMES, RAYS = 32, 512
WHITE = Material(albedo=(0.7,) * 3)
LIT, SHINING = (Material(albedo=(0.7,) * 3, emission=(light,) * 3) for light in (6.0, 0.2))
BLOCK_TOP = 0.5
CAMERA = Camera((0.3, 1.0, 1.7), (0.0, 0.55, -1.0), fov_y_deg=60)
SCENE = make_scene([
    box((-2, 0, -2), (4, 2.5, 4), WHITE),            # a room,
    box((-2, 2.4, -2), (4, 0.1, 4), SHINING),        # its ceiling,
    box((-0.2, 0, -0.9), (0.5, BLOCK_TOP, 0.5), WHITE),  # a block in it,
    box((-1.9, 0, -2), (0.9, 2.5, 0.4), WHITE),      # a part of the wall that stands forward,
    box((-1.0, 0.6, -2.0), (0.02, 0.9, 0.1), LIT),   # a lit strip behind its corner,
    box((0.2, 0.9, -2.0), (1.6, 0.04, 0.03), WHITE),  # a moulding on the wall,
    box((0.9, 0.0, -1.2), (0.3, 0.1, 0.3), WHITE),   # and a small thing on the floor.
], (), CAMERA)


@dataclass(frozen=True, eq=False)
class Pictures:
    """Light, and where surfaces are; by model the light that it draws."""

    light: dict[str, F32]
    position: F32
    normal: F32
    many_rays: Renderer

    def error(self, model: str, pixels: Bools) -> float:
        """Root of the mean squared error at some of the pixels, relative to the mean of what many rays find."""
        rows = np.flatnonzero(pixels.ravel())
        rows = rows[:: max(1, len(rows) // 150)]
        assert len(rows) >= 20
        expected = self._expected(rows)
        found = self.light[model].reshape(-1, 3)[rows, 0]
        return float(np.sqrt(((found - expected) ** 2).mean()) / expected.mean())

    def _expected(self, rows: NDArray[np.int64]) -> F32:
        surfels, scale = self.many_rays.surfels, radiance_scale(SCENE)
        indirect = np.ascontiguousarray(self.many_rays.resource("surfel_indirect").T) / np.float32(scale)
        caster, lookup = surfels.caster, surfels.lookup
        light_at = LightAt(lambda at, facing: np.zeros_like(at),
                           lambda at, facing: lookup.approximate(indirect, at, facing))
        normal = self.normal.reshape(-1, 3)[rows]
        origin = (self.position.reshape(-1, 3)[rows] - caster.origin).astype(np.float32)
        numbers = np.broadcast_to(sequence((1, 1), np.zeros(1, np.int64), 0, RAYS, 0.25), (len(rows), RAYS, 2))
        return gather(caster, light_at, float(surfels.world.median_radius), origin + caster.ray_epsilon * normal,
                      normal, numbers).light.mean(axis=1)[:, 0]


@pytest.fixture(scope="module")
def pictures(egl: None) -> Iterator[Pictures]:
    light = {}
    settings = Settings(SIZE, ("indirect", "position", "normal"), provider="cpu")
    for model in ("ember", "final-gather"):
        with Renderer(SCENE, settings, find_model(model)) as renderer:
            for _ in range(FRAMES if model == "final-gather" else 4):
                renderer.advance(CAMERA)
            images = renderer.render(CAMERA)
            light[model] = images["indirect"]
            if model == "final-gather":
                yield Pictures(light, images["position"], images["normal"], renderer)


def near(values: F32, low: float, high: float) -> Bools:
    return np.asarray((values > low) & (values < high))


def regions(pictures: Pictures) -> dict[str, Bools]:
    (x, y, z), up = np.moveaxis(pictures.position, -1, 0), pictures.normal[..., 1]
    floor = (up > 0.9) & near(y, -0.01, 0.01)
    front = pictures.normal[..., 2] > 0.9
    return {
        "top of a block along its edges": (up > 0.9) & near(y, BLOCK_TOP - 0.01, BLOCK_TOP + 0.01),
        "wall before a lit strip around the corner": front & near(z, -1.61, -1.59) & near(x, -1.5, -1.0),
        "moulding": near(z, -1.99, -1.96) & near(x, 0.25, 1.75) & near(y, 0.89, 0.95),
        "floor around a small thing": floor & near(x, 0.8, 1.3) & near(z, -1.3, -0.75),
    }


@pytest.mark.parametrize(("region", "bound"), [
    ("top of a block along its edges", 0.1), ("wall before a lit strip around the corner", 0.03), ("moulding", 0.1),
    ("floor around a small thing", 0.12)])
@pytest.mark.parametrize("model", ["ember", "final-gather"])
def test_light_is_what_many_rays_find(pictures: Pictures, model: str, region: str, bound: float) -> None:
    assert pictures.error(model, regions(pictures)[region]) < bound
