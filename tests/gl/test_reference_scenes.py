"""Renderer and path tracer on the real scenes: the same surfaces, and the same light of lights without a size."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter

from app.load import load_scene
from app.metrics import psnr
from app.scene import RectLight, Scene
from tests.gl.scenes import F32, Images, draw, without_shadows
from tests.gl.test_scenes import NAMES

if importlib.util.find_spec("mitsuba") is None:
    pytest.skip("Mitsuba, of the extra 'export', is not installed", allow_module_level=True)

pytestmark = [pytest.mark.long, pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (256, 192)
EDGE = 2            # texels around the edge of a shadow that are not compared
DARKEST = 0.01      # albedo below which demodulated light says nothing
SHORT = {  # dB that are reached where the shadow map, coarser than what casts, gets single texels wrong
    ("sponza", "sun"): (36, "2 texels of thin slits of light"),
    ("breakfast-room", "sun"): (29, "21 texels behind the slats of blinds"),
    ("grey-white-room", "sun"): (30, "18 texels lit through the corners of mouldings"),
    ("country-kitchen", "spot"): (37, "18 texels of thin furniture"),
    ("country-kitchen", "lamp"): (33, "60 texels in the creases of mouldings and beside crockery"),
    ("contemporary-bathroom", "spot"): (38, "10 texels of thin furniture"),
}


def traced(scene: Scene) -> Images:
    from export.path_tracer import PathTracer
    from export.reference import Still, mean_samples

    camera = scene.cameras[scene.default_camera].at(0.0)
    return mean_samples(PathTracer(scene, max_bounces=0), Still(scene, camera, SIZE), 1)


def hard(scene: Scene) -> bool:
    return not any(isinstance(light, RectLight) or getattr(light, "radius", 0) > 0
                   or getattr(light, "angular_radius_deg", 0) > 0 for light in scene.lights)


def demodulated(images: Images, inside: np.ndarray) -> F32:
    return np.where(inside[..., None], images["direct"] / np.maximum(images["albedo"], DARKEST), 0)


@pytest.mark.parametrize("name", NAMES)
def test_real_scene(name: str, scenes: Path) -> None:
    entry = next(e for e in json.loads((scenes / "scenes.json").read_text()) if e["name"] == name)
    short = []
    for lighting in entry["lightings"] or [None]:
        scene = load_scene(scenes / entry["file"], lighting=lighting)
        drawn, truth = draw(scene, SIZE, ("direct", "albedo", "normal", "depth")), traced(scene)
        seen = (drawn["depth"][..., 0] > 0) | (truth["depth"][..., 0] > 0)
        near = np.abs(drawn["depth"] - truth["depth"])[..., 0] <= 1e-3 * truth["depth"][..., 0]
        turned = near & seen & ((drawn["normal"] * truth["normal"]).sum(-1) < np.cos(np.radians(2)))
        print(f"AGREE {name} {lighting}: depth differs in {(seen & ~near).mean():.3%}, normals in {turned.mean():.3%}")
        assert (seen & ~near).mean() < 0.01  # silhouettes, and texels that a mask's threshold parts otherwise
        assert turned.mean() < 0.01
        if not hard(scene):
            continue
        inside = seen & near & ~turned & (np.minimum(drawn["albedo"], truth["albedo"]).min(-1) > DARKEST)
        a, b = demodulated(drawn, inside), demodulated(truth, inside)
        free = demodulated(draw(without_shadows(scene), SIZE, ("direct", "albedo")), inside)[..., 1]
        share = np.where(free > 1e-4 * free.max(), b[..., 1] / np.maximum(free, 1e-12), 0)
        edge = binary_dilation(maximum_filter(share, 3) - minimum_filter(share, 3) > 0.05, iterations=EDGE)
        found = psnr(a, b, inside & ~edge)
        print(f"AGREE {name} {lighting}: {found:.1f} dB over {(inside & ~edge).mean():.0%} of the picture")
        if found < 40:
            least, why = SHORT[name, lighting]
            assert found >= least - 0.5
            short.append(f"{why}: {found:.0f} dB")
    if short:
        pytest.xfail("; ".join(short))
