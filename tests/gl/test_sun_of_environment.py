"""The sun of an environment map casts a sharp shadow where it should."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from app.io.image import write_exr
from app.load import load_for_editing
from app.scene import Camera
from tests.gl.scenes import draw
from tests.unit.test_suns import SUN, even_sky, unit, with_disc

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

AZIMUTH, ELEVATION, RADIUS = 60.0, 45.0, 0.27  # degrees, of the sun in the world
ROTATION = 25.0
POLE = """v -0.05 0 -0.05\nv 0.05 0 -0.05\nv 0.05 0 0.05\nv -0.05 0 0.05
v -0.05 1 -0.05\nv 0.05 1 -0.05\nv 0.05 1 0.05\nv -0.05 1 0.05
v -3 0 -3\nv 3 0 -3\nv 3 0 3\nv -3 0 3
f 12 11 10 9\nf 5 6 2 1\nf 6 7 3 2\nf 7 8 4 3\nf 8 5 1 4\nf 8 7 6 5\n"""


def test_a_pole_casts_a_sharp_shadow(tmp_path: Path) -> None:
    sky = 0.1 * even_sky(512)
    map_azimuth = AZIMUTH + ROTATION  # a rotated map is turned counter-clockwise
    write_exr(tmp_path / "sky.exr", {"": with_disc(sky, unit(map_azimuth, ELEVATION), RADIUS, SUN)})
    (tmp_path / "pole.obj").write_text(POLE)
    environment = {"type": "image", "file": "sky.exr", "rotation_deg": ROTATION}
    (tmp_path / "pole.json").write_text(json.dumps({"lightings": {"day": {"lights": [], "environment": environment}}}))
    loaded = load_for_editing(tmp_path / "pole.obj")
    scene = loaded.scene
    assert loaded.own_lights == 0, "the viewer must not save the sun beside the environment that contains it"
    assert any("azimuth 60°, elevation 45°" in notice for notice in scene.notices)

    camera = Camera((0.0, 5.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 45.0)
    images = draw(scene, (256, 256), ("direct", "position"), camera)
    x, y, z = np.moveaxis(images["position"], -1, 0)
    lit = images["direct"][..., 0] / np.median(images["direct"][..., 0])
    away = -unit(AZIMUTH, 0.0)  # the shadow is as long as the pole is high
    along, across = x * away[0] + z * away[2], np.abs(x * away[2] - z * away[0])
    floor = np.abs(y) < 1e-3
    shadow, light = floor & (along > 0.15) & (along < 0.9) & (across < 0.03), floor & ((along > 1.1) | (across > 0.1))
    assert shadow.sum() > 20 and lit[shadow].max() < 0.1
    assert lit[light].min() > 0.95
