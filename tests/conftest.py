from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.errors import DeviceError
from app.gl.context import Device
from app.network.selection import find_model
from tests.coarse_shadows import coarse_shadow_maps

SMALL_EMBER = 256, 36  # surfels, and rays of each


@pytest.fixture(scope="session")
def egl() -> None:
    """Skips where there is no OpenGL context."""
    try:
        Device().close()
    except DeviceError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def path_tracer() -> None:
    """Skips where the path tracer can't run."""
    from export.reference.mitsuba_module import load_mitsuba

    try:
        load_mitsuba()
    except DeviceError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The folder of real scenes, which is no part of the repository."""
    folder = Path(os.environ.get("AFTERGLOW_SCENES", Path(__file__).parents[2] / "shared" / "scenes"))
    if not folder.is_dir():
        pytest.skip(f"no real scenes at {folder} (set AFTERGLOW_SCENES)")
    return folder


@pytest.fixture
def coarse_shadows() -> Iterator[None]:
    """Shadow maps with an eighth of their sides, see ``tests/coarse_shadows.py``."""
    with coarse_shadow_maps():
        yield


@pytest.fixture(scope="session")
def small_ember(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The network ``ember`` with an eighth of its surfels, for tests in which only its path counts.

    Where torch is missing, ``ember`` itself, which takes longer.
    """
    if importlib.util.find_spec("torch") is None:
        return Path(find_model("ember"))
    from export.models.ember import Ember
    from export.onnx.export import write_network

    return write_network(Ember(*SMALL_EMBER).eval(), tmp_path_factory.mktemp("nets"), [], {})[0]
