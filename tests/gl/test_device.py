"""The OpenGL context: which device it is on, and errors that the driver reports."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from app.errors import DeviceError
from app.gl.context import DEVICE_INDEX, Device
from app.gl.pool import Pool
from app.graph import Plan

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

ROOT = Path(__file__).parents[2]
NOTHING = Plan((), {}, frozenset(), {})
# Mesa's reference rasteriser does not know a limit that moderngl asks for.
SOFTPIPE = {"GALLIUM_DRIVER": "softpipe", "MESA_GL_VERSION_OVERRIDE": "4.5", "MESA_GLSL_VERSION_OVERRIDE": "450"}


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False,
                          env={**os.environ, **environment})


def test_errors_of_the_context_itself_are_not_taken_for_those_of_allocations() -> None:
    code = "from app.gl.context import Device; device = Device(); print(device.renderer, device.ctx.error)"
    text = run("-c", code, **SOFTPIPE).stdout.split()
    if text[:1] != ["softpipe"]:
        pytest.skip("Mesa's softpipe is missing")
    assert text == ["softpipe", "GL_NO_ERROR"]


@pytest.mark.parametrize(("error", "message"), [
    ("GL_OUT_OF_MEMORY", "not enough graphics memory for 64x48.*smaller size"),
    ("GL_INVALID_ENUM", r"can't allocate textures \(GL_INVALID_ENUM\)")])
def test_only_lack_of_memory_is_called_that(error: str, message: str) -> None:
    device: Any = SimpleNamespace(ctx=SimpleNamespace(error=error), max_size=4096, renderer="a driver")
    with pytest.raises(DeviceError, match=message):
        Pool(cast(Device, device), NOTHING, (64, 48))


@pytest.mark.parametrize("number", ["99", "first"])
def test_a_device_that_does_not_exist_is_one_line(number: str) -> None:
    result = run("-m", "app", "--model", "none", **{DEVICE_INDEX: number})
    assert result.returncode == 2 and not result.stdout
    assert result.stderr.startswith(f"error: {DEVICE_INDEX}: no OpenGL device '{number}'")
    assert len(result.stderr.splitlines()) == 1 and "counted from 0" in result.stderr


def test_a_device_that_exists_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DEVICE_INDEX, "0")
    Device().close()
