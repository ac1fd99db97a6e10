"""How many GL objects live in a context, asked of GL itself.

Nothing that the renderer keeps books of is trusted: every name up to ``MAX_NAMES`` is tried with ``glIsTexture`` and
its like. Drivers give out small names, so a leak of any kind raises a count.
"""

from __future__ import annotations

import ctypes

from app.gl.context import Device

KINDS = ("Texture", "Buffer", "Framebuffer", "Renderbuffer", "VertexArray", "Program", "Shader", "Query", "Sampler")
MAX_NAMES = 8192


def live_objects(device: Device) -> dict[str, int]:
    """Number of objects of each kind in ``device``'s context."""
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetProcAddress.restype, egl.eglGetProcAddress.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    found = {}
    with device.ctx:
        for kind in KINDS:
            exists = ctypes.CFUNCTYPE(ctypes.c_ubyte, ctypes.c_uint)(egl.eglGetProcAddress(b"glIs" + kind.encode()))
            found[kind] = sum(bool(exists(name)) for name in range(1, MAX_NAMES))
    return found
