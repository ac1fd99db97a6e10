"""``python -m app doctor``, on this machine and on ones where something is missing."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from app.doctor import self_test
from app.network.cuda_runtime import find_cuda
from app.renderer import Renderer

ROOT = Path(__file__).parents[2]
WITHOUT = "import sys; sys.modules[{module!r}] = None; sys.argv[0] = 'afterglow'; from app.cli import main; main()"


def run(code: str, *arguments: str, **environment: str) -> tuple[int, list[str]]:
    """Exit code and lines of ``doctor`` in a process of its own, which must not print a traceback."""
    process = subprocess.run([sys.executable, "-c", code, "doctor", *arguments], cwd=ROOT, capture_output=True,
                             text=True, check=False, env={**os.environ, **environment})
    assert not process.stderr, process.stderr
    return process.returncode, process.stdout.splitlines()


@pytest.mark.parametrize(("module", "topic", "remedy"), [
    ("embreex.rtcore_scene", "traces", "pip install embreex"), ("onnxruntime", "infers", "pip install onnxruntime")])
def test_a_missing_package_is_one_line(module: str, topic: str, remedy: str) -> None:
    status, lines = run(WITHOUT.format(module=module))
    assert status == 1
    assert [line for line in lines if line.startswith(f"{topic}: nothing") and remedy in line]


def test_no_egl_is_one_line() -> None:
    status, lines = run("from app.cli import main; main()", __EGL_VENDOR_LIBRARY_FILENAMES="/none.json")
    assert status == 1
    assert [line for line in lines if line.startswith("draws: nothing: no OpenGL context") and "libegl1" in line]


@pytest.mark.gl
def test_a_missing_provider_is_one_line() -> None:
    code = ("import onnxruntime; onnxruntime.get_available_providers = lambda: ['CPUExecutionProvider']; "
            "from app.cli import main; main()")
    process = subprocess.run([sys.executable, "-c", code, "doctor", "--provider", "cuda", "--size", "64x48"], cwd=ROOT,
                             capture_output=True, text=True, check=False)
    assert process.returncode == 2
    assert [line for line in process.stdout.splitlines() if line.startswith("infers: ") and "onnxruntime-gpu" in line]
    (line,) = process.stderr.splitlines()
    assert line.startswith("error: --provider: this onnxruntime has no provider 'cuda'") and "onnxruntime-gpu" in line


@pytest.mark.gl
def test_all_is_well_here(tmp_path: Path) -> None:
    file = tmp_path / "new" / "doctor.json"
    status, lines = run("from app.cli import main; main()", "--size", "64x48", "--json", str(file))
    assert status == 0
    report = json.loads(file.read_text())
    assert len(report["checks"]) == 3 and all(check["passed"] for check in report["checks"])
    assert sum(line.startswith("passed: ") for line in lines) == 3
    (line,) = [line for line in lines if line.startswith("exchanges: ")]
    assert ("libcudart" in line and "onnxruntime-gpu" in line) == (find_cuda() is None)
    device = report["frames"]["device"]
    assert device["exchange"] in ("copy", "mapped", "cuda")
    said = f"the network runs on {device['provider']}; exchange of its tensors with OpenGL: {device['exchange']}"
    assert said in lines
    assert {"gbuffer", "direct", "network", "copy"} <= set(report["frames"]["passes"])


@pytest.mark.gl
@pytest.mark.parametrize(("output", "failing"), [("direct", "light under a lamp"), ("indirect", "indirect light")])
def test_wrong_light_fails_the_self_test(output: str, failing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    read = Renderer.read
    monkeypatch.setattr(Renderer, "read", lambda self, name: read(self, name) * np.float32(1 + 0.1 * (name == output)))
    assert [check.name for check in self_test.run_self_test("auto") if not check.passed] == [failing]
