"""Light of traced rectangles that the texels of a quad share, against light that each texel evaluates for itself."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import app.renderer
from app.scene import Camera, Material, RectLight, Scene
from tests.gl.scenes import Images, box, draw, floor, make_scene, quad, without_shadows

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

F64 = NDArray[np.float64]

SIZE = (320, 240)
SLANTED = Camera((0.0, 1.2, 2.4), (0.0, 0.0, -0.3), (0.0, 1.0, 0.0), 50.0)
OUTPUTS = "direct", "specular", "position", "normal"
PANES = [RectLight((-1.0, 1.5, -1.0), (1.0, 0, 0.2), (0, 0, 1.0), (4.0, 3.0, 2.0)),
         RectLight((1.2, 0.7, -1.2), (0, 0, -1.2), (0, -1.2, 0), (2.0, 3.0, 4.0), two_sided=True)]


def glossy(roughness: float) -> Material:
    return Material(albedo=(0.5,) * 3, roughness=roughness, specular=(0.04,) * 3)


def plane(roughness: float) -> Scene:
    return without_shadows(make_scene([floor(2.5, material=glossy(roughness))], PANES))


def draw_both(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> tuple[Images, Images]:
    """With shared light, and with shadow maps, for which no light is shared; nothing casts a shadow."""
    shared = draw(scene, SIZE, OUTPUTS, SLANTED)
    monkeypatch.setattr(app.renderer, "needs_rays", lambda lights, *_: (False,) * len(lights))
    return shared, draw(scene, SIZE, OUTPUTS, SLANTED)


def quads_of(image: NDArray[np.float32]) -> F64:
    """Its quads, shape (h / 2, w / 2, 4, components)."""
    h, w, components = image.shape
    return image.astype(np.float64).reshape(h // 2, 2, w // 2, 2, components).swapaxes(1, 2).reshape(
        h // 2, w // 2, 4, components)


@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.6, 1.0])
def test_on_a_plane_it_differs_by_little(roughness: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """At most 2 % of the brightest light anywhere, and 1 % on the mean, in a picture of large pixels."""
    shared, own = draw_both(plane(roughness), monkeypatch)
    for output in ("direct", "specular"):
        error = np.abs(shared[output] - own[output]).max(axis=-1)
        print(f"SHARED roughness {roughness} {output}: largest {error.max() / own[output].max():.4f} of the peak, "
              f"mean {error.mean() / own[output].mean():.5f} of the mean")
        assert error.max() < 0.02 * own[output].max()
        assert error.mean() < 0.01 * own[output].mean()


def test_rough_planes_share_it() -> None:
    """Most quads have one value for four texels; those close to a pane, in these large pixels, do not."""
    images = draw(plane(0.6), SIZE, OUTPUTS, SLANTED)
    light, surface = quads_of(images["specular"]), quads_of(images["normal"])
    shown = (np.abs(surface).max(axis=-1) > 0.5).all(axis=-1)
    is_shared = (light == light[:, :, :1]).all(axis=(2, 3))[shown]
    assert shown.sum() > 4000
    print(f"SHARED {is_shared.mean():.3f} of the quads")
    assert is_shared.mean() > 0.6


def test_texels_at_edges_keep_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quad with two surfaces, here of boxes, steps and bars, is as exact as without sharing."""
    parts = [floor(2.5, material=glossy(0.5)), box((-0.8, 0.0, -0.8), (0.5, 0.4, 0.5), glossy(0.5))]
    parts += [quad((0.2, 0.1 + 0.05 * i, 0.3 - 0.2 * i), (0.8, 0, 0), (0, 0, -0.15), glossy(0.5)) for i in range(5)]
    shared, own = draw_both(without_shadows(make_scene(parts, PANES)), monkeypatch)
    normal, height = quads_of(own["normal"]), quads_of(own["position"])[..., 1]
    is_edge = (np.ptp(normal, axis=2).max(axis=-1) > 0.5) | (np.ptp(height, axis=2) > 0.02)
    assert is_edge.sum() > 300
    for output in ("direct", "specular"):
        error = np.abs(quads_of(shared[output]) - quads_of(own[output]))[is_edge]
        assert error.max() < 0.002 * own[output].max()
