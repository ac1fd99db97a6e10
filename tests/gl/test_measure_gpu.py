"""The script that measures a GPU runs all of its sections, with or without one."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

ROOT = Path(__file__).parents[2]


def test_no_section_fails(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, ROOT / "scripts" / "measure_gpu.py", tmp_path, "--quick"], cwd=tmp_path,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    results = json.loads((tmp_path / "gpu.json").read_text("utf-8"))
    assert list(results) == ["machine", "transfers", "shaders", "frames", "network", "exchanges",
                             "onnxruntime_cuda", "pictures", "goldens"]
    assert not {name: result["failed"] for name, result in results.items() if "failed" in result}
    if not torch.cuda.is_available():
        assert results["exchanges"]["map and unmap"] == {"skipped": "CUDA does not share OpenGL's device"}
    assert not results["shaders"]["errors"] and results["shaders"]["programs"] > 10
    assert results["network"]["96x72"]["onnxruntime_error"] < 1e-4
    assert results["goldens"]["exit_code"] == 0, (tmp_path / "golden.txt").read_text("utf-8")
    for model in ("none", "ember", "ssgi"):
        assert results["pictures"][model]["exit_code"] == 0 and (tmp_path / f"{model}.exr").is_file()
