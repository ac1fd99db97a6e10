"""``export rebuild``: from an empty folder to networks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("mitsuba")
pytest.importorskip("lightning_fabric")

from app.network.contract_json import read_contract
from app.paths import nets_dir

pytestmark = [pytest.mark.gl, pytest.mark.long]


def test_rebuild_makes_every_network_and_continues(path_tracer: None, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "export", "rebuild", "--quick", "--work", str(tmp_path)]
    first = subprocess.run(command, capture_output=True, text=True)
    assert first.returncode == 0, first.stderr
    assert "12 pairs, 12 of them new" in first.stdout
    networks = {path.name: path.read_bytes() for path in (tmp_path / "nets").iterdir()}
    assert {"bcnn-8.onnx", "bcnn-8-half.onnx", "bcnn-8.md"} < networks.keys()
    for path in nets_dir().glob("*.onnx"):
        if read_contract(path).trained_on == "nothing":
            assert networks[path.name] == path.read_bytes(), path.name
    log = (tmp_path / "runs" / "quick" / "log.jsonl").read_bytes()
    second = subprocess.run(command, capture_output=True, text=True)
    assert second.returncode == 0, second.stderr
    assert "12 of them new" not in second.stdout
    assert (tmp_path / "runs" / "quick" / "log.jsonl").read_bytes() == log
