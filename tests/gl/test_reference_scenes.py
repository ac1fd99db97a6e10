"""Renderer and path tracer agree on the real scenes: on surfaces, and on direct light of lights without a size."""

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

from export.reference.path_tracer import PathTracer
from export.reference.still import Still
from export.reference.trace import mean_samples

pytestmark = [pytest.mark.long, pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (256, 192)
SUBTEXELS = 5         # rays along each side of a texel; the middle one goes through its centre
FINE_SIZE = SIZE[0] * SUBTEXELS, SIZE[1] * SUBTEXELS
MIN_ALBEDO = 0.01     # of surfaces whose demodulated light is compared
MIN_PSNR = 40         # dB
MAX_EDGE_SHARE = 0.4  # of the surfaces


def traced(scene: Scene) -> Images:
    """Through the centres of subtexels, the middle ones of which are the centres of texels."""
    camera = scene.cameras[scene.default_camera].at(0.0)
    return mean_samples(PathTracer(scene, max_bounces=0), Still(scene, camera, FINE_SIZE), 1)


def centres(images: Images) -> Images:
    return {name: image[SUBTEXELS // 2::SUBTEXELS, SUBTEXELS // 2::SUBTEXELS] for name, image in images.items()}


def shadow_edges(light: F32, free: F32) -> np.ndarray:
    """Texels that are, with their neighbours, partly lit and partly in shadow."""
    def anywhere(subtexels: np.ndarray) -> np.ndarray:
        return maximum_filter(subtexels.reshape(SIZE[1], SUBTEXELS, SIZE[0], SUBTEXELS).any(axis=(1, 3)), 3)

    return anywhere(light > 0) & anywhere((free > 0) & (light <= 0))


def hard(scene: Scene) -> bool:
    return not any(isinstance(light, RectLight) or getattr(light, "radius", 0) > 0
                   or getattr(light, "angular_radius_deg", 0) > 0 for light in scene.lights)


def demodulated(images: Images, inside: np.ndarray) -> F32:
    return np.where(inside[..., None], images["direct"] / np.maximum(images["albedo"], MIN_ALBEDO), 0)


@pytest.mark.parametrize("name", NAMES)
def test_real_scene(name: str, scenes: Path) -> None:
    entry = next(e for e in json.loads((scenes / "scenes.json").read_text()) if e["name"] == name)
    for lighting in entry["lightings"] or [None]:
        scene = load_scene(scenes / entry["file"], lighting=lighting)
        drawn, fine = draw(scene, SIZE, ("direct", "albedo", "normal", "depth")), traced(scene)
        reference = centres(fine)
        seen = (drawn["depth"][..., 0] > 0) | (reference["depth"][..., 0] > 0)
        near = np.abs(drawn["depth"] - reference["depth"])[..., 0] <= 1e-3 * reference["depth"][..., 0]
        off_normal = near & seen & ((drawn["normal"] * reference["normal"]).sum(-1) < np.cos(np.radians(2)))
        print(f"AGREE {name} {lighting}: depth differs in {(seen & ~near).mean():.3%}, "
              f"normals in {off_normal.mean():.3%}")
        assert (seen & ~near).mean() < 0.01  # silhouettes, and texels at the threshold of a mask
        assert off_normal.mean() < 0.01
        if not hard(scene):
            continue
        inside = seen & near & ~off_normal & (np.minimum(drawn["albedo"], reference["albedo"]).min(-1) > MIN_ALBEDO)
        a, b = demodulated(drawn, inside), demodulated(reference, inside)
        free = draw(without_shadows(scene), FINE_SIZE, ("direct",))["direct"][..., 1]
        edge = shadow_edges(fine["direct"][..., 1], free)
        decibels = psnr(a, b, inside & ~edge)
        left_out = (inside & edge).sum() / inside.sum()
        print(f"AGREE {name} {lighting}: {decibels:.1f} dB, {left_out:.0%} of the surfaces at shadow edges")
        assert decibels >= MIN_PSNR
        assert left_out < MAX_EDGE_SHARE
