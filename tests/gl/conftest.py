from __future__ import annotations

import pytest

from app.errors import DeviceError
from app.gl.context import Device


@pytest.fixture(scope="session")
def egl() -> None:
    """Skips where there is no OpenGL context."""
    try:
        Device().close()
    except DeviceError as error:
        pytest.skip(str(error))
