"""What draws the pictures of this process, with its version."""

from __future__ import annotations

from functools import cache

import onnxruntime

from app.gl.context import Device


@cache
def gl_origin() -> str:
    """GL renderer and version, Mesa's included."""
    device = Device()
    device.close()
    return f"{device.renderer}, OpenGL {device.version}"


def network_origin() -> str:
    """Version of onnxruntime, and the execution provider that goldens are made on."""
    return f"onnxruntime {onnxruntime.__version__}, cpu"
