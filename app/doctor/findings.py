"""What this installation has: OpenGL, execution providers of onnxruntime, a ray caster, optional packages."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from importlib import import_module, metadata, util

from app.errors import DeviceError
from app.network.cuda_runtime import CUDA_REMEDY, find_cuda

# Import name of each optional package and the extra that installs it.
EXTRAS = {
    "DracoPy": "assets", "opengl_basisu": "assets", "av": "video", "aiohttp": "view", "flip_evaluator": "evaluation",
    "matplotlib": "evaluation", "psutil": "evaluation", "pyoidn": "evaluation", "skimage": "evaluation",
    "distributed": "cluster", "torch": "export", "mitsuba": "export",
}
NVIDIA = f"for NVIDIA GPUs: {CUDA_REMEDY}"
SOFTWARE_RENDERER = "software; to draw on a GPU, install its driver's EGL library and get permission to open its device"


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes
    ----------
    topic : str
        What it is about, such as ``draws``.
    text : str
        What was found, or what is missing.
    remedy : str
        How to get what is missing; empty if nothing is.
    is_error : bool
        Whether the program can't draw with indirect light as it is.
    """

    topic: str
    text: str
    remedy: str = ""
    is_error: bool = False


def look_around() -> Iterator[Finding]:
    """One finding for each part of the installation."""
    yield _opengl()
    yield _providers()
    yield _cuda()
    yield _caster()
    yield from _extras()


def _opengl() -> Finding:
    from app.gl.context import Device  # imports moderngl

    try:
        with closing(Device()) as device:
            text = f"{device.renderer}, OpenGL {device.version}"
            return Finding("draws", text, SOFTWARE_RENDERER if device.software else "")
    except DeviceError as error:
        return Finding("draws", f"nothing: {error.what}", error.expected, is_error=True)


def _providers() -> Finding:
    try:
        import onnxruntime

        from app.network.providers import CUDA, list_providers
    except ImportError as error:
        return Finding("infers", f"nothing: {_first_line(error)}", "pip install onnxruntime", is_error=True)
    text = f"onnxruntime {onnxruntime.__version__} on {', '.join(list_providers())}"
    return Finding("infers", text, "" if CUDA in list_providers() else NVIDIA)


def _cuda() -> Finding:
    if find_cuda() is None:
        text = "tensors by way of the CPU, since CUDA's runtime library (libcudart) or a GPU for it is missing"
        return Finding("exchanges", text, NVIDIA)
    return Finding("exchanges", "tensors on the GPU, with CUDA's runtime library")


def _caster() -> Finding:
    try:
        import_module("embreex.rtcore_scene")
    except ImportError as error:
        return Finding("traces", f"nothing: {_first_line(error)}", "pip install embreex", is_error=True)
    return Finding("traces", f"Embree, by embreex {metadata.version('embreex')}")


def _extras() -> Iterator[Finding]:
    for extra in dict.fromkeys(EXTRAS.values()):
        packages = [package for package, name in EXTRAS.items() if name == extra]
        missing = [package for package in packages if util.find_spec(package) is None]
        if missing:
            yield Finding(f"extra {extra}", f"without {', '.join(missing)}", f"pip install 'afterglow[{extra}]'")
        else:
            yield Finding(f"extra {extra}", ", ".join(packages))


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0]
