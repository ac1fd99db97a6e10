"""The machine, and transfers between GPU and CPU."""

from __future__ import annotations

import importlib
import os
import subprocess
from contextlib import closing

import moderngl
import numpy as np

from app.gl.context import Device
from gpu_sections.common import Json, Options, format_size, measure_ms

PACKAGES = ("torch", "onnxruntime", "numpy", "moderngl", "cupy", "cuda.bindings")
LIMITS = ("GL_MAX_UNIFORM_BLOCK_SIZE", "GL_MAX_TEXTURE_SIZE")
SMI_QUERY = "name,driver_version,clocks.sm,clocks.mem,pcie.link.gen.current,pcie.link.width.current"
PIXEL_BYTES = {"f4": 16, "f2": 8, "f1": 4}
RAY_BYTES = 2048 * 144 * 4 * 4  # the rays tensor of ember


def machine(options: Options) -> Json:
    """Renderer, driver, limits, packages and cores."""
    with closing(Device()) as device:
        about: Json = {"renderer": device.renderer, "version": device.version, "software": device.software,
                       "gl_error_after_info": device.ctx.error,
                       "limits": {name: device.ctx.info[name] for name in LIMITS}}
    about["packages"] = {name: _version(name) for name in PACKAGES}
    about["nvidia_smi"] = _query_nvidia_smi()
    about["cores"] = len(os.sched_getaffinity(0))
    return about


def transfers(options: Options) -> Json:
    """Milliseconds of ways to read pictures and tensors back, and of waiting for the GPU."""
    with closing(Device()) as device, device.ctx:
        context = device.ctx
        query = context.query(time=True)

        def time_nothing() -> int:
            with query:
                pass
            context.finish()
            return int(query.elapsed)

        return {**{f"{format_size(size)} {dtype}": _read_picture(context, size, dtype, options)
                   for size in options.sizes for dtype in PIXEL_BYTES},
                **{f"rays buffer dynamic={dynamic}": _copy_buffer(context, dynamic, options)
                   for dynamic in (False, True)},
                "finish": measure_ms(context.finish, options, 200),
                "query, finish and elapsed": measure_ms(time_nothing, options, 200)}


def _read_picture(context: moderngl.Context, size: tuple[int, int], dtype: str, options: Options) -> Json:
    count = size[0] * size[1] * PIXEL_BYTES[dtype]
    texture, host = context.texture(size, 4, dtype=dtype), np.empty(count, np.uint8)
    issued, mapped = (context.buffer(reserve=count, dynamic=True) for _ in range(2))
    row = {"megabytes": round(count / 1e6, 1),
           "read": measure_ms(lambda: texture.read(alignment=1), options),
           "read_into": measure_ms(lambda: texture.read_into(host, alignment=1), options),
           "pixel_buffer_issue": measure_ms(lambda: texture.read_into(issued, alignment=1), options),
           "pixel_buffer_map": measure_ms(lambda: mapped.read_into(host), options)}
    for resource in (texture, issued, mapped):
        resource.release()
    return row


def _copy_buffer(context: moderngl.Context, dynamic: bool, options: Options) -> Json:
    buffer, host = context.buffer(reserve=RAY_BYTES, dynamic=dynamic), np.zeros(RAY_BYTES, np.uint8)

    def write() -> None:
        buffer.write(host)
        context.finish()

    row = {"read_into": measure_ms(lambda: buffer.read_into(host), options), "write": measure_ms(write, options)}
    buffer.release()
    return row


def _version(package: str) -> str:
    try:
        return str(getattr(importlib.import_module(package), "__version__", "installed"))
    except ImportError as error:
        return f"missing ({error})"


def _query_nvidia_smi() -> str:
    try:
        return subprocess.run(["nvidia-smi", f"--query-gpu={SMI_QUERY}", "--format=csv,noheader"],
                              capture_output=True, text=True, check=False).stdout.strip()
    except OSError:
        return "not installed"
