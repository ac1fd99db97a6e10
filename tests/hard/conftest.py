from __future__ import annotations

from tests.gl.conftest import egl

__all__ = ["egl"]
