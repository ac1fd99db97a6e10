"""The renderer on another driver: Mesa's zink, which draws by Vulkan, on the software renderer lavapipe."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from app.io.image import read_exr

pytestmark = [pytest.mark.gl, pytest.mark.long, pytest.mark.usefixtures("egl")]

ROOT = Path(__file__).parents[2]
ZINK = {"MESA_LOADER_DRIVER_OVERRIDE": "zink", "LIBGL_ALWAYS_SOFTWARE": "1"}
SIZE = "256x192"
CASES = "hard", "spotlights", "labels", "glass"


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False,
                          env={**os.environ, **environment})


@pytest.fixture(scope="module", autouse=True)
def zink() -> None:
    """Skips where zink finds no Vulkan driver."""
    result = run("-c", "from app.gl.context import Device; print(Device().renderer)", **ZINK)
    if not result.stdout.startswith("zink"):
        pytest.skip("zink finds no Vulkan driver: install Debian's mesa-vulkan-drivers")


def test_golden_images_agree_on_another_driver(tmp_path: Path) -> None:
    result = run("-m", "app", "golden", "check", *CASES, "--report", str(tmp_path / "golden.html"), **ZINK)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "zink" in result.stdout


def test_the_command_line_draws_the_same_picture_on_another_driver(tmp_path: Path) -> None:
    images = {}
    for name, environment in (("here", {}), ("zink", ZINK)):
        result = run("-m", "app", "--size", SIZE, "--out", str(tmp_path / name), "--aov", "final,normal,depth,direct",
                     "--format", "exr", "--check", **environment)
        assert result.returncode == 0, result.stderr
        images[name] = read_exr(tmp_path / name / "0000.exr")
    difference = {layer: np.abs(image - images["here"][layer]) for layer, image in images["zink"].items()}
    assert difference["normal"].max() == difference["depth"].max() == 0
    assert difference["direct"].max() < 1e-3
    assert difference[""].max() < 1e-2 and difference[""].mean() < 1e-6  # the picture
