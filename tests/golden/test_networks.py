"""Networks are compared on saved tensors: their goldens do not depend on the rasteriser."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from app.errors import SceneError
from app.golden import SceneCase, Shot, catalogue, check, update
from app.golden.network_case import NetworkCase
from app.golden.scenes import room
from app.io.image import read_exr, write_exr
from app.network.selection import bundled_models, find_model
from tests.tiny_network import write_tiny_network

pytestmark = pytest.mark.gl
SOURCE = SceneCase("room", room(), find_model("gather"), (Shot("path", 1),), golden_frames=(1,), size=(48, 32))
CASE = NetworkCase(SOURCE, find_model("gather"))
TENSOR = "tensor_screen.exr"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    update([CASE], tmp_path / "images", [CASE.name])
    return tmp_path / "images"


def test_every_bundled_network_is_in_the_catalogue(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Including one that no scene case uses, which is checked alone."""
    more = write_tiny_network(tmp_path / "more.onnx")
    module = import_module("app.golden.catalogue")
    monkeypatch.setattr(module, "bundled_models", lambda: {**bundled_models(), "more": more})
    networks = {c.model: c for c in catalogue().values() if isinstance(c, NetworkCase)}
    assert networks.keys() >= {*bundled_models().values(), more}
    update([networks[more]], tmp_path / "images", ["more.network"])
    assert not check([networks[more]], tmp_path / "images").broken


def test_saved_tensors_outlive_an_update(folder: Path) -> None:
    path = folder / CASE.name / TENSOR
    tensor = read_exr(path)["frame1"]
    write_exr(path, {"frame1": (tensor * 0.5).astype(np.float16)})
    first = check([CASE], folder).broken[0]
    assert (first.stage, first.verdict) == ("network", "differs")
    update([CASE], folder, [CASE.name])
    np.testing.assert_allclose(read_exr(path)["frame1"], tensor * 0.5, rtol=1e-3, atol=1e-6)
    assert not check([CASE], folder).broken


def test_without_saved_tensors_a_check_fails(folder: Path) -> None:
    (folder / CASE.name / TENSOR).unlink()
    assert [(f.stage, f.verdict) for f in check([CASE], folder).broken] == [("saved tensors", "missing")]


def test_tensors_of_another_network_are_refused(folder: Path) -> None:
    write_exr(folder / CASE.name / TENSOR, {"frame1": np.zeros((8, 8, 1), np.float16)})
    with pytest.raises(SceneError, match=r"tensor_screen.exr.*8 rows of 8.*delete the file"):
        check([CASE], folder)


def test_a_saved_tensor_without_its_frame_is_refused_and_kept(folder: Path) -> None:
    path = folder / CASE.name / TENSOR
    write_exr(path, {"frame2": read_exr(path)["frame1"].astype(np.float16)})
    for use in (lambda: check([CASE], folder), lambda: update([CASE], folder, [CASE.name])):
        with pytest.raises(SceneError, match=r"tensor_screen.exr: no layer 'frame1'.*delete the file"):
            use()
    assert read_exr(path).keys() == {"frame2"}
