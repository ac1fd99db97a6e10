"""What clear coats and glass mirror of the scene around."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from app.network.selection import Model
from app.renderer import Renderer
from app.scene import Camera, Clearcoat, Environment, Material, PointLight, Scene, Transmission
from app.settings import Settings
from tests.gl.scenes import Part, make_scene, quad

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

Image = NDArray[np.float32]
SIZE = (96, 72)
BLACK = Material("black", albedo=(0.0, 0.0, 0.0))
MIRROR = Material("mirror", albedo=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.0)
GLOSSY = replace(BLACK, name="glossy", roughness=0.0, specular=(0.04,) * 3)  # which reflects like a coat
COATED = replace(BLACK, name="coated", clearcoat=Clearcoat(1.0, 0.0))
PANE = Material("pane", albedo=(1.0, 1.0, 1.0), roughness=0.0, specular=(0.04,) * 3, transmission=Transmission(1.0))
WHITE, RED, BLUE = (Material(name, albedo=albedo) for name, albedo in (
    ("white", (0.7, 0.7, 0.7)), ("red", (0.7, 0.02, 0.02)), ("blue", (0.02, 0.02, 0.7))))
LAMP = PointLight((0.0, 1.6, 0.4), (3.0, 3.0, 3.0), radius=0.05)
CAMERA = Camera((0.0, 1.0, 0.5), (0.0, 1.0, -1.0), fov_y_deg=50.0)
MIDDLE = slice(24, 48), slice(36, 60)
SETTLED = (CAMERA,) * 6


def room(*front: Part) -> Scene:
    """A cube of edge 2; behind the camera its wall is red on the left as the camera looks, blue on the right."""
    walls = [quad((0, 0, 1), (-1, 0, 0), (0, 2, 0), RED), quad((1, 0, 1), (-1, 0, 0), (0, 2, 0), BLUE),
             quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), WHITE), quad((-1, 2, -1), (2, 0, 0), (0, 0, 2), WHITE),
             quad((-1, 0, 1), (0, 0, -2), (0, 2, 0), WHITE), quad((1, 0, -1), (0, 0, 2), (0, 2, 0), WHITE)]
    return make_scene([*walls, *front], [LAMP], CAMERA)


def wall(material: Material, z: float = -1.0) -> Part:
    """What the camera looks at."""
    return quad((-1, 0, z), (2, 0, 0), (0, 2, 0), material)


def draw(scene: Scene, model: Model, cameras: Sequence[Camera] = SETTLED, reflections: bool = True) -> dict[str, Image]:
    """All images of the last of consecutive frames."""
    settings = Settings(size=SIZE, outputs=("final", "reflection", "specular"), reflections=reflections, provider="cpu")
    with Renderer(scene, settings, model) as renderer:
        return [renderer.render(camera) for camera in cameras][-1]


def running(scene: Scene, model: Model) -> set[str]:
    """Names of the passes that run."""
    with Renderer(scene, Settings(size=(32, 24), provider="cpu"), model) as renderer:
        return {p.name for p in renderer.plan.passes}


def reflectance(camera: Camera) -> NDArray[np.float64]:
    """Of what is smooth, of F0 0.04, in the wall before the camera: Schlick's approximation, for every pixel."""
    slope = np.tan(np.radians(camera.fov_y_deg / 2)) / (SIZE[1] / 2)
    y, x = (np.indices(SIZE[::-1]) + 0.5 - np.array(SIZE[::-1])[:, None, None] / 2) * slope
    cosine = 1 / np.sqrt(1 + x**2 + y**2)
    return np.asarray((0.04 + 0.96 * (1 - cosine)**5)[..., None])


def test_a_clear_coat_mirrors_the_room(small_ember: Path) -> None:
    """As the surface below it would, if it were as smooth; in the picture too."""
    glossy, coated = (draw(room(wall(m)), small_ember) for m in (GLOSSY, COATED))
    expected = glossy["reflection"][MIDDLE]
    np.testing.assert_allclose(coated["reflection"][MIDDLE], expected, rtol=0.02, atol=1e-4)
    shown = (coated["final"] - coated["specular"])[MIDDLE]
    np.testing.assert_allclose(shown.mean((0, 1)), expected.mean((0, 1)), rtol=0.02)
    half = draw(room(wall(replace(COATED, clearcoat=Clearcoat(0.5, 0.0)))), small_ember)["reflection"]
    np.testing.assert_allclose(half[MIDDLE], 0.5 * coated["reflection"][MIDDLE], rtol=0.02, atol=1e-4)


def test_a_pane_mirrors_the_room(small_ember: Path) -> None:
    """Also one of alpha 0.5, by half as much."""
    expected = draw(room(wall(GLOSSY)), small_ember)["reflection"][MIDDLE].mean((0, 1))
    blended = replace(PANE, transmission=None, is_blended=True, alpha=0.5, albedo=(0.0,) * 3)
    for pane, share in ((PANE, 1.0), (blended, 0.5)):
        with_rays, without = (draw(room(wall(pane)), small_ember, reflections=on)["final"] for on in (True, False))
        np.testing.assert_allclose((with_rays - without)[MIDDLE].mean((0, 1)), share * expected, rtol=0.05)


THIN_VEIL = replace(BLACK, is_blended=True, alpha=0.01)


@pytest.mark.parametrize("veil", [THIN_VEIL, replace(THIN_VEIL, roughness=0.0, specular=(0.04,) * 3)],
                         ids=["matte", "smooth"])
def test_a_thin_veil_hides_little_of_what_a_coat_mirrors(veil: Material, small_ember: Path) -> None:
    alone, behind = (draw(room(wall(COATED), *front), small_ember) for front in ((), (wall(veil, -0.9),)))
    expected, seen = ((image["final"] - image["specular"])[MIDDLE].mean((0, 1)) for image in (alone, behind))
    np.testing.assert_allclose(seen, 0.99 * expected, rtol=0.05)


def test_a_pane_before_a_coat_mirrors_in_its_place(small_ember: Path) -> None:
    seen = draw(room(wall(COATED), wall(PANE, -0.9)), small_ember)["reflection"]
    alone = draw(room(wall(PANE, -0.9)), small_ember)["reflection"]
    np.testing.assert_allclose(seen[MIDDLE].mean((0, 1)), alone[MIDDLE].mean((0, 1)), rtol=0.05)


def test_what_is_below_a_coat_mirrors_less(small_ember: Path) -> None:
    """By what the coat takes: a mirror below a coat as smooth reflects as much as one without."""
    plain, coated = (draw(room(wall(m)), small_ember)["reflection"]
                     for m in (MIRROR, replace(MIRROR, clearcoat=Clearcoat(1.0, 0.0))))
    np.testing.assert_allclose(coated[MIDDLE], plain[MIDDLE], rtol=0.02, atol=1e-3)


def test_coats_have_no_step_where_they_are_too_rough_for_rays(small_ember: Path) -> None:
    coats = (replace(COATED, clearcoat=Clearcoat(1.0, roughness)) for roughness in (0.595, 0.605))
    smoother, rougher = (draw(room(wall(coat)), small_ember)["reflection"] for coat in coats)
    np.testing.assert_allclose(rougher[MIDDLE].mean((0, 1)), smoother[MIDDLE].mean((0, 1)), rtol=0.03)


@pytest.mark.parametrize("camera", [CAMERA, Camera((-0.9, 1.0, -0.7), (0.0, 1.0, -1.0), fov_y_deg=20.0)],
                         ids=["facing", "grazing"])
@pytest.mark.parametrize("layer", [
    replace(MIRROR, is_blended=True, alpha=0.9999, clearcoat=Clearcoat(1.0, 0.1)),
    replace(PANE, clearcoat=Clearcoat(1.0, 0.1))], ids=["metal", "pane"])
def test_a_layer_with_a_coat_reflects_no_more_than_arrives(layer: Material, camera: Camera, small_ember: Path) -> None:
    sky = Environment(np.ones((8, 16, 3), np.float32))
    scene = replace(make_scene([wall(layer)], camera=camera), environment=sky)
    seen = draw(scene, small_ember, (camera,) * 6)["final"][MIDDLE]
    np.testing.assert_allclose(seen, 1.0, rtol=0.03)


def test_a_layer_shows_no_outline_of_what_is_behind_it(small_ember: Path) -> None:
    """Also where it is so rough that opaque surfaces would reflect the light of their own pixel."""
    satin = replace(BLACK, is_blended=True, alpha=1.0, roughness=0.5, specular=(0.5,) * 3)
    behind = quad((-1, 0, -1.2), (1, 0, 0), (0, 2, 0), WHITE)
    seen = draw(room(wall(satin), behind), small_ember)["reflection"][24:48].mean((0, 2))
    assert seen[40:46].mean() == pytest.approx(seen[50:56].mean(), rel=0.2)


@pytest.mark.parametrize("material", [COATED, PANE], ids=lambda m: m.name)
def test_the_sky_is_mirrored_once(material: Material, small_ember: Path) -> None:
    """By rays, or where there are none by the pass of direct light."""
    sky = Environment(np.full((8, 16, 3), (0.5, 1.0, 2.0), np.float32))
    scene = replace(make_scene([wall(material)], camera=CAMERA), environment=sky)
    seen = draw(scene, small_ember)["final"][MIDDLE]
    share = 1.0 if material is PANE else reflectance(CAMERA)[MIDDLE].mean()  # what is behind a pane shows too
    np.testing.assert_allclose(seen.mean((0, 1)), share * np.array((0.5, 1.0, 2.0)), rtol=0.02)


def test_only_coats_and_smooth_panes_have_reflections_of_their_own(small_ember: Path) -> None:
    rays = {"outer_surface", "outer_reflection_march", "outer_reflection"}
    assert rays <= running(room(wall(COATED)), small_ember)
    assert rays <= running(room(wall(PANE)), small_ember)
    assert not rays & running(room(wall(MIRROR)), small_ember)
    assert not rays & running(room(wall(replace(COATED, clearcoat=Clearcoat(0.0, 0.0)))), small_ember)
    assert not rays & running(room(wall(replace(PANE, roughness=0.7))), small_ember)
    # Nothing opaque is smooth there.
    assert "reflection_march" not in running(room(wall(PANE)), small_ember)


def test_a_coat_shows_the_wall_behind_the_camera_where_it_is(small_ember: Path) -> None:
    image = draw(room(wall(COATED)), small_ember)["reflection"]
    row = image[30:42].mean(axis=0)
    assert (row[32:45, 0] > 5 * row[32:45, 2]).all()
    assert (row[51:64, 2] > 5 * row[51:64, 0]).all()
