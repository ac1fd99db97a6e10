"""Objects that move far out of the scene's first bounds keep their shadow, under every kind of light."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.gl.shadow_atlas import size_of
from app.load import load_for_editing
from app.math3d import translation
from app.renderer import Renderer
from app.scene import Camera, DirectionalLight, Light, PointLight, RectLight, Scene, SpotLight
from app.settings import Settings
from app.view.edited_scene import EditedScene
from app.view.model_renderer import ModelRenderer
from app.view.state import State
from tests.gl.scenes import F64, Point, box, floor, leave_out_shadows, make_scene, quad, slide, without_shadows

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (96, 96)
FAR: Point = (30.0, -45.0, -20.0)
NEARBY: Point = (0.0, 0.0, 0.0)
LAMP = np.array([4.0, 3.0, 0.0])
TO_FAR = np.array(FAR) - LAMP
INTENSITY = (4000.0,) * 3
SUN = (-0.2, -1.0, 0.1)
LIGHTS: dict[str, Light] = {
    "point": PointLight(tuple(LAMP), INTENSITY),
    "sphere": PointLight(tuple(LAMP), INTENSITY, 0.4),
    "spot": SpotLight(tuple(LAMP), tuple(TO_FAR), INTENSITY, 20.0, 40.0),
    "soft spot": SpotLight(tuple(LAMP), tuple(TO_FAR), INTENSITY, 20.0, 40.0, 0.4),
    "wide spot": SpotLight(tuple(LAMP), tuple(TO_FAR), INTENSITY, 30.0, 80.0),
    "rectangle": RectLight(tuple(LAMP), (0.6, 0.0, 0.0), (0.0, 0.0, 0.6), INTENSITY, two_sided=True),
    "sun": DirectionalLight(SUN, (3.0,) * 3),
    "soft sun": DirectionalLight(SUN, (3.0,) * 3, 0.5),
}
TRAY_HALF, CUBE_LOW, CUBE_SIZE = 2.5, np.array([-0.8, 1.2, -0.8]), np.array([1.6, 0.3, 1.6])
MAX_SOFT_LEAK = 0.05  # mean in a soft shadow whose light is small and far: its filter of a texel's width is noisy
MARGIN = 0.35  # about three texels of the coarsest map there


def tray_and_cube(light: Light, times: tuple[float, ...], places: tuple[Point, ...]) -> Scene:
    """A tray with a flat box above it, which move together, beside a floor that stays."""
    motion = slide(times, places)
    tray = quad((-TRAY_HALF, 0, TRAY_HALF), (2 * TRAY_HALF, 0, 0), (0, 0, -2 * TRAY_HALF), motion=motion)
    return make_scene([floor(1.5, -2.0), tray, box(tuple(CUBE_LOW), tuple(CUBE_SIZE), motion=motion)], [light])


def from_above(place: Point) -> Camera:
    """A camera that sees the shadow below the box."""
    x, y, z = place
    return Camera((x, y + 3.0, z + 6.0), place, fov_y_deg=50.0)


def blocked(points: F64, light: Light, place: Point, margin: float) -> F64:
    """Whether the lines from ``points``, shape (..., 3), to the light's middle meet the box grown by ``margin``."""
    to = -np.array(SUN) * 1e3 if isinstance(light, DirectionalLight) else LAMP - points
    low, high = np.array(place) + CUBE_LOW - margin, np.array(place) + CUBE_LOW + CUBE_SIZE + margin
    low[1], high[1] = place[1] + CUBE_LOW[1], place[1] + CUBE_LOW[1] + CUBE_SIZE[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - points) / to, (high - points) / to
    return np.minimum(a, b).max(axis=-1) < np.maximum(a, b).min(axis=-1)


def check_shadow(lit: F64, free: F64, position: F64, light: Light, place: Point) -> None:
    """The tray is dark where the box hides the light, and lit elsewhere, with a margin between."""
    tray = (np.abs(position[..., 1] - place[1]) < 0.05) & position.any(axis=-1)
    share = np.divide(lit[..., 1], free[..., 1], out=np.ones(lit.shape[:2]), where=free[..., 1] > 0)
    dark, bright = (blocked(position, light, place, s * MARGIN) for s in (-1, 1))
    assert (free[..., 1] > 0)[tray].all()
    assert (tray & dark).sum() > 60 and (tray & ~bright).sum() > 300
    if size_of(light) > 0:
        assert share[tray & dark].mean() < MAX_SOFT_LEAK
    else:
        assert share[tray & dark].max() < 0.01
    assert share[tray & ~bright].min() > 0.98


SETTINGS = Settings(SIZE, ("direct", "position"), taa=False)


@pytest.mark.parametrize("kind", LIGHTS)
def test_an_animated_object_keeps_its_shadow(kind: str) -> None:
    light = LIGHTS[kind]
    scene = tray_and_cube(light, (0.0, 1.0), (NEARBY, FAR))
    halfway = tuple((np.array(FAR) / 2).tolist())
    with Renderer(scene, SETTINGS) as renderer, Renderer(without_shadows(scene), SETTINGS) as unshadowed:
        leave_out_shadows(unshadowed)
        renderer.render(from_above(NEARBY), 0.0)
        for time, place in ((1.0, FAR), (0.5, halfway), (2.0, FAR)):
            lit, free = (r.render(from_above(place), time) for r in (renderer, unshadowed))
            check_shadow(lit["direct"], free["direct"], lit["position"], light, place)


@pytest.mark.parametrize("kind", LIGHTS)
def test_an_object_dragged_beyond_all_bounds_keeps_its_shadow(kind: str) -> None:
    """As the viewer does, which writes another place into the motion of a scene that is drawn already."""
    light = LIGHTS[kind]
    scene = tray_and_cube(light, (0.0,), (NEARBY,))
    with Renderer(scene, SETTINGS) as renderer, Renderer(without_shadows(scene), SETTINGS) as unshadowed:
        leave_out_shadows(unshadowed)
        before = renderer.render(from_above(NEARBY))["direct"]
        for instance in scene.instances[1:]:
            instance.motion.transforms[0] = translation(np.array(FAR))  # type: ignore[union-attr]
        lit, free = (r.render(from_above(FAR), 1e-6) for r in (renderer, unshadowed))
        check_shadow(lit["direct"], free["direct"], lit["position"], light, FAR)
        for instance in scene.instances[1:]:
            instance.motion.transforms[0] = translation(np.array(NEARBY))  # type: ignore[union-attr]
        assert np.array_equal(renderer.render(from_above(NEARBY), 2e-6)["direct"], before)


OBJ = """o base\nv -1 -2 1\nv 1 -2 1\nv 1 -2 -1\nv -1 -2 -1\nf 1 2 3 4
o tray\nv -2.5 0 2.5\nv 2.5 0 2.5\nv 2.5 0 -2.5\nv -2.5 0 -2.5\nf 5 6 7 8
o lid\nv -0.8 1.2 0.8\nv 0.8 1.2 0.8\nv 0.8 1.2 -0.8\nv -0.8 1.2 -0.8
v -0.8 1.5 0.8\nv 0.8 1.5 0.8\nv 0.8 1.5 -0.8\nv -0.8 1.5 -0.8
f 9 12 11 10\nf 13 14 15 16\nf 9 10 14 13\nf 10 11 15 14\nf 11 12 16 15\nf 12 9 13 16\n"""


@pytest.mark.parametrize("kind", ["point", "soft spot", "rectangle", "sun"])
def test_an_object_that_the_viewer_drags_keeps_its_shadow(kind: str, tmp_path: Path) -> None:
    (tmp_path / "scene.obj").write_text(OBJ)
    light = LIGHTS[kind]
    loaded = load_for_editing(tmp_path / "scene.obj", studio=False)
    drawn = ModelRenderer(EditedScene(tmp_path / "scene.obj", loaded, tmp_path), "cpu")
    near = tuple((np.array(FAR) / 20).tolist())
    for place in (near, FAR):  # the first move reloads the scene, the second one does not
        offsets = (("lid", place), ("tray", place))
        state = State(SIZE, from_above(place), (light,), "none", offsets, taa=False, aov="direct")
        assert drawn.draw(state, "none", lambda: True)
    lit = drawn._renderer.read("direct")  # type: ignore[union-attr]
    scene = tray_and_cube(light, (0.0,), (FAR,))
    with Renderer(without_shadows(scene), SETTINGS) as unshadowed:
        leave_out_shadows(unshadowed)
        free = unshadowed.render(from_above(FAR))
    check_shadow(lit, free["direct"], free["position"], light, FAR)
    drawn.close()
