"""Sky beside surfaces, and surfaces too thin for the network's grid.

Rows "sky in filters" and "all bilateral weights zero" of the table of hazards.
"""

from __future__ import annotations

import numpy as np
import pytest

from app.renderer import Renderer
from app.scene import Camera, Material
from app.settings import Settings
from tests.gl.scenes import box, floor, make_scene, quad
from tests.hard.scenes import EVERYTHING, LAMP, RADIOSITY, SIZE, lit_corner, shown

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

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
    wall = quad((-9, 0.0, -1.0), (18, 0, 0), (0, 9, 0), Material(albedo=(0.0, 0.0, 0.0)))
    camera = Camera((0.0, 1.0, 1.0), (0.0, 0.55, -0.2), fov_y_deg=60.0)
    open_, closed = (shown(make_scene([floor(1.0), *more], [LAMP], camera)) for more in ((), (wall,)))
    sky = open_["depth"][..., 0] == 0
    assert sky[0].all() and sky.any(axis=1).sum() >= 1
    assert not any(open_[name][sky].any() for name in EVERYTHING)
    ground = ~sky & (closed["normal"][..., 1] > 0.9)
    assert ground.mean() > 0.3
    np.testing.assert_array_equal(open_["direct"][ground], closed["direct"][ground])
    np.testing.assert_allclose(open_["indirect"][ground], closed["indirect"][ground],
                               atol=0.02 * closed["indirect"].max() + 1e-6)


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


def test_a_wire_before_the_sky_keeps_its_direct_light() -> None:
    """All four low-resolution texels show the sky: no indirect light, rather than the sky's or a NaN."""
    wire = box((-0.004, 0.0, -0.004), (0.008, 2.0, 0.008))
    camera = Camera((0.2, 1.2, 2.5), (0.0, 0.9, 0.0))
    images = shown(make_scene([wire], [LAMP], camera))
    seen = images["depth"][..., 0] > 0
    assert 20 < seen.sum() < 3 * SIZE[1]
    assert images["direct"][seen].min() > 0
    np.testing.assert_array_equal(images["final"], images["direct"])
    assert not images["indirect"].any()


def test_a_wire_before_a_wall_takes_light_that_is_there() -> None:
    """Where no low-resolution texel is on the wire, the most alike decides: nothing is made up."""
    wall, ground = quad((-2, 0, -1), (4, 0, 0), (0, 3, 0)), floor(2.0)
    wire = box((-0.004, 0.0, -0.004), (0.008, 2.0, 0.008), Material(albedo=(0.9, 0.1, 0.1)))
    camera = Camera((0.2, 1.2, 2.5), (0.0, 0.9, 0.0))
    settings = Settings(size=SIZE, outputs=("indirect", "albedo"), taa=False, provider="cpu")
    with Renderer(make_scene([wall, ground, wire], [LAMP], camera), settings, RADIOSITY) as renderer:
        images, low = renderer.render(camera), renderer.resource("indirect_low")[..., :3]
    on_wire = images["albedo"][..., 0] > 0.8
    assert on_wire.sum() > 20
    found = images["indirect"][on_wire]
    lit = low[low.max(axis=2) > 0]
    assert (found >= 0.999 * lit.min(axis=0)).all() and (found <= 1.001 * lit.max(axis=0)).all()
