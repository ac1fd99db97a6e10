"""Sky beside surfaces, and surfaces too thin for the network's grid.

Rows "sky in filters" and "all bilateral weights zero" of the table of hazards.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from app.radiance_scale import radiance_scale
from app.renderer import Renderer
from app.scene import Camera, Material, Scene
from app.settings import Settings
from tests.gl.scenes import Images, box, make_scene, quad
from tests.robustness.scenes import CAMERA, EVERYTHING, LAMP, RADIOSITY, SIZE, lit_corner, shown

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

RED = Material(albedo=(0.9, 0.1, 0.1))
UP = Camera((0.0, 1.5, 1.0), (0.0, 5.0, 1.1))


@pytest.mark.parametrize("taa", [False, True])
def test_a_picture_of_nothing_but_sky_is_exactly_black(taa: bool) -> None:
    """Although there is a lit scene behind the camera."""
    settings = Settings(size=SIZE, outputs=EVERYTHING, taa=taa, provider="cpu")
    with Renderer(lit_corner(), settings, RADIOSITY) as renderer:
        for _ in range(3):
            assert not any(image.any() for image in renderer.render(UP).values())


def test_one_row_of_sky_changes_nothing_below_it() -> None:
    """The sky is masked, not averaged in: with one row of it, light stays what it is beside a black wall."""
    half, row = np.radians(30.0), 2.0 / SIZE[1]
    edge = np.arctan2(1.0, 2.0) + np.arctan(np.tan(half) * (1.0 - row))  # the floor ends below the topmost row
    camera = Camera((0.0, 1.0, 1.0), (0.0, 1.0 - np.sin(edge), 1.0 - np.cos(edge)), fov_y_deg=60.0)
    ground = quad((-9, 0, 9), (18, 0, 0), (0, 0, -10))
    behind = quad((9, 0, 2), (-18, 0, 0), (0, 3, 0))  # lights the ground indirectly
    wall = quad((-9, 0.0, -1.0), (18, 0, 0), (0, 9, 0), Material(albedo=(0.0, 0.0, 0.0)))
    open_, closed = (shown(make_scene([ground, behind, *more], [LAMP], camera)) for more in ((), (wall,)))
    sky = open_["depth"][..., 0] == 0
    assert sky[0].all() and not sky[1:].any()
    assert not any(open_[name][sky].any() for name in EVERYTHING)
    assert closed["indirect"][~sky].min() > 0
    np.testing.assert_allclose(open_["direct"][~sky], closed["direct"][~sky], rtol=1e-3)  # one unit of half precision
    np.testing.assert_allclose(open_["indirect"][~sky], closed["indirect"][~sky], rtol=2e-3)
    np.testing.assert_allclose(open_["indirect"][4:], closed["indirect"][4:], rtol=1e-3)


@pytest.mark.parametrize("rows", [1, 2])
def test_a_strip_of_surface_below_the_sky_is_lit_and_nothing_else(rows: int) -> None:
    """One row of floor at the bottom of the picture, the rest sky."""
    height = SIZE[1]
    half = np.radians(22.5)
    edge = 1.0 - 2.0 * rows / height  # of the image, from its middle
    distance = 0.5 / (np.tan(half) * edge)
    strip = quad((-9, 0, -distance), (18, 0, 0), (0, 0, distance))  # ends so that it covers the lowest rows
    images = shown(make_scene([strip], [LAMP], Camera((0.0, 0.5, 0.0), (0.0, 0.5, -1.0))))
    seen = images["depth"][..., 0] > 0
    assert seen[-rows:].all() and not seen[:-rows - 1].any()
    assert images["final"][seen].min() > 0
    assert not any(images[name][~seen].any() for name in EVERYTHING)


def on_wire(images: Images) -> NDArray[np.bool_]:
    return images["albedo"][..., 0] > 0.8


def with_low(scene: Scene, camera: Camera) -> tuple[Images, NDArray[np.float32]]:
    """A frame, and the indirect light [H, W, 4, 3] of the four low-resolution texels around each texel."""
    settings = Settings(size=SIZE, outputs=("direct", "indirect", "albedo", "depth"), taa=False, provider="cpu")
    with Renderer(scene, settings, RADIOSITY) as renderer:
        images, low = renderer.render(camera), renderer.resource("indirect_low")[..., :3] / radiance_scale(scene)
    rows, columns = (np.clip(np.floor((np.arange(n) + 0.5) * m / n - 0.5).astype(int)[:, None] + (0, 1), 0, m - 1)
                     for n, m in zip(SIZE[::-1], low.shape[:2], strict=True))
    around = low[rows[:, None, :, None], columns[None, :, None, :]]
    return images, around.reshape(*SIZE[::-1], 4, 3)


def test_a_wire_alone_before_the_sky_keeps_its_direct_light() -> None:
    """Nothing lights it indirectly: no light is made up, and no NaN."""
    wire = box((-0.004, 0.0, -0.004), (0.008, 2.0, 0.008))
    images = shown(make_scene([wire], [LAMP], Camera((0.2, 1.2, 2.5), (0.0, 0.9, 0.0))))
    seen = images["depth"][..., 0] > 0
    assert 20 < seen.sum() < 3 * SIZE[1]
    assert images["direct"][seen].min() > 0
    np.testing.assert_array_equal(images["final"], images["direct"])
    assert not images["indirect"].any()


def test_a_wire_before_the_sky_is_lit_like_what_is_around() -> None:
    """All four low-resolution texels show the sky, which is filled from the surfaces near."""
    wire = quad((0.3, 0.0, 0.9), (0.02, 0, 0), (0, 3, 0), RED)
    images, around = with_low(lit_corner(more=(wire,)), CAMERA)
    alone = on_wire(images) & ~around.any(axis=(2, 3))
    assert alone.sum() > 5
    lit = images["indirect"][(images["depth"][..., 0] > 0) & ~on_wire(images)]
    assert images["indirect"][alone].min() > 0
    assert (images["indirect"][alone] <= lit.max(axis=0)).all()


def test_a_wire_before_a_floor_takes_light_that_is_there() -> None:
    """All four low-resolution texels look up, the wire to the side: they count as little, but they count."""
    ground, behind = quad((-9, 0, 3), (18, 0, 0), (0, 0, -12)), quad((9, 0, 3), (-18, 0, 0), (0, 3, 0))
    wire = quad((0.1, 0.1, 0.9), (0.02, 0, 0), (0, 1.0, 0), RED)
    down = Camera((0.0, 2.0, 2.5), (0.0, 0.0, 0.5))
    images, around = with_low(make_scene([ground, behind, wire], [LAMP]), down)
    wire_here = on_wire(images)
    found, low = images["indirect"][wire_here], around[wire_here]
    assert wire_here.sum() > 10
    assert low.min() > 0
    assert (found >= 0.999 * low.min(axis=1)).all() and (found <= 1.001 * low.max(axis=1)).all()
