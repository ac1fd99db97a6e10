"""Renderer and path tracer on the real scenes: the same surfaces, and the same light of lights without a size."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from app.evaluation.metrics import psnr
from app.load import load_scene
from app.scene import RectLight, Scene
from tests.gl.scenes import F32, Images, draw, without_shadows
from tests.gl.test_scenes import NAMES

if importlib.util.find_spec("mitsuba") is None:
    pytest.skip("Mitsuba, of the extra 'export', is not installed", allow_module_level=True)

pytestmark = [pytest.mark.long, pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (256, 192)
SPREAD = 5          # rays a side through each texel, the middle one through its centre
DARKEST = 0.01      # albedo below which demodulated light says nothing
LEAST = 40          # dB
MAX_EDGES = 0.4    # share of the surfaces


def traced(scene: Scene) -> Images:
    """Through the centres of finer texels; every ``SPREAD``-th is the centre of one of the picture's."""
    from export.reference.path_tracer import PathTracer
    from export.reference.still import Still
    from export.reference.trace import mean_samples

    camera = scene.cameras[scene.default_camera].at(0.0)
    return mean_samples(PathTracer(scene, max_bounces=0), Still(scene, camera, (SIZE[0] * SPREAD, SIZE[1] * SPREAD)), 1)


def centres(images: Images) -> Images:
    return {name: image[SPREAD // 2::SPREAD, SPREAD // 2::SPREAD] for name, image in images.items()}


def shadow_edges(light: F32, free: F32) -> np.ndarray:
    """Texels where light, finely traced, reaches some of their points or neighbours' and is kept from others."""
    def anywhere(what: np.ndarray) -> np.ndarray:
        return maximum_filter(what.reshape(SIZE[1], SPREAD, SIZE[0], SPREAD).any(axis=(1, 3)), 3)

    return anywhere(light > 0) & anywhere((free > 0) & (light <= 0))


def hard(scene: Scene) -> bool:
    return not any(isinstance(light, RectLight) or getattr(light, "radius", 0) > 0
                   or getattr(light, "angular_radius_deg", 0) > 0 for light in scene.lights)


def demodulated(images: Images, inside: np.ndarray) -> F32:
    return np.where(inside[..., None], images["direct"] / np.maximum(images["albedo"], DARKEST), 0)


@pytest.mark.parametrize("name", NAMES)
def test_real_scene(name: str, scenes: Path) -> None:
    entry = next(e for e in json.loads((scenes / "scenes.json").read_text()) if e["name"] == name)
    for lighting in entry["lightings"] or [None]:
        scene = load_scene(scenes / entry["file"], lighting=lighting)
        drawn, fine = draw(scene, SIZE, ("direct", "albedo", "normal", "depth")), traced(scene)
        reference = centres(fine)
        seen = (drawn["depth"][..., 0] > 0) | (reference["depth"][..., 0] > 0)
        near = np.abs(drawn["depth"] - reference["depth"])[..., 0] <= 1e-3 * reference["depth"][..., 0]
        turned = near & seen & ((drawn["normal"] * reference["normal"]).sum(-1) < np.cos(np.radians(2)))
        print(f"AGREE {name} {lighting}: depth differs in {(seen & ~near).mean():.3%}, normals in {turned.mean():.3%}")
        assert (seen & ~near).mean() < 0.01  # silhouettes, and texels that a mask's threshold parts otherwise
        assert turned.mean() < 0.01
        if not hard(scene):
            continue
        inside = seen & near & ~turned & (np.minimum(drawn["albedo"], reference["albedo"]).min(-1) > DARKEST)
        a, b = demodulated(drawn, inside), demodulated(reference, inside)
        edge = shadow_edges(fine["direct"][..., 1], traced(without_shadows(scene))["direct"][..., 1])
        found = psnr(a, b, inside & ~edge)
        left_out = (inside & edge).sum() / inside.sum()
        print(f"AGREE {name} {lighting}: {found:.1f} dB, {left_out:.0%} of the surfaces at edges of shadows")
        assert found >= LEAST
        assert left_out < MAX_EDGES
