"""What the driver says about every shader program."""

from __future__ import annotations

import ctypes
import ctypes.util
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import islice
from time import perf_counter
from typing import Any

from app.errors import AfterglowError
from app.gl import context
from app.gl.shader import Program, compile_program
from app.golden import SceneCase, catalogue
from app.golden.scenes import FRAME_SECONDS
from gpu_sections.common import Json, Options

GL_DEBUG_OUTPUT, GL_DEBUG_OUTPUT_SYNCHRONOUS = 0x92E0, 0x8242
FRAMES = 3  # after which every program of a case has run
MAX_MESSAGES = 25

_MESSAGES: Counter[str] = Counter()


def _count_message(source: int, kind: int, ident: int, severity: int, length: int, text: bytes, user: object) -> None:
    _MESSAGES[f"{kind:#x} {text.decode(errors='replace')[:220]}"] += 1


_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_uint, ctypes.c_uint, ctypes.c_uint, ctypes.c_int,
                             ctypes.c_char_p, ctypes.c_void_p)(_count_message)


def shaders(options: Options) -> Json:
    """Compile and run every program of the golden catalogue; compile times and the driver's debug messages."""
    ms: dict[str, float] = {}

    def timed(ctx: Any, stages: Sequence[str], defines: Mapping[str, object]) -> Program:
        begin = perf_counter()
        program = compile_program(ctx, stages, defines)
        ms[f"{'+'.join(stages)} {','.join(sorted(defines))}"] = round((perf_counter() - begin) * 1e3, 1)
        return program

    errors: dict[str, str] = {}
    _MESSAGES.clear()
    context.compile_program = timed  # type: ignore[attr-defined]
    try:
        for name, case in islice(catalogue().items(), 2 if options.quick else None):
            if isinstance(case, SceneCase):
                try:
                    _draw(case)
                except AfterglowError as error:
                    errors[name] = str(error)[:600]
    finally:
        context.compile_program = compile_program  # type: ignore[attr-defined]
    return {"programs": len(ms), "errors": errors, "slowest_ms": sorted(ms.values())[-5:],
            "total_ms": round(sum(ms.values())), "messages": _MESSAGES.most_common(MAX_MESSAGES)}


def _draw(case: SceneCase) -> None:
    with case.renderer() as renderer:
        with renderer._gl.ctx:
            _listen()
        for number, (camera, cut) in enumerate(islice(case._frames(), FRAMES)):
            if cut:
                renderer.cut()
            renderer.advance(camera, number * FRAME_SECONDS)


def _listen() -> None:
    """Count the debug messages of the current context."""
    egl = ctypes.CDLL(ctypes.util.find_library("EGL") or "libEGL.so.1")
    egl.eglGetProcAddress.restype, egl.eglGetProcAddress.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    enable = ctypes.CFUNCTYPE(None, ctypes.c_uint)(egl.eglGetProcAddress(b"glEnable"))
    enable(GL_DEBUG_OUTPUT)
    enable(GL_DEBUG_OUTPUT_SYNCHRONOUS)
    set_callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(
        egl.eglGetProcAddress(b"glDebugMessageCallback"))
    set_callback(ctypes.cast(_CALLBACK, ctypes.c_void_p), None)
