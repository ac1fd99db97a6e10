"""Where the shaders, networks and embedded data lie: inside the package in a wheel, beside it in a checkout."""

import os
from pathlib import Path

SHADERS = "AFTERGLOW_SHADERS"  # environment variable: another folder of shaders, to try a change without touching these

_PACKAGE = Path(__file__).resolve().parent


def shader_dir() -> Path:
    """Folder of the shader entry files: ``$AFTERGLOW_SHADERS``, or the one that comes with the program."""
    return Path(os.environ[SHADERS]) if os.environ.get(SHADERS) else _find("shaders")


def nets_dir() -> Path:
    """Folder of the bundled networks, ``NAME.onnx`` beside its model card ``NAME.md``."""
    return _find("nets")


def data_dir() -> Path:
    """Folder of the embedded scene and the published schemas; the same in both layouts."""
    return _PACKAGE / "data"


def _find(name: str) -> Path:
    bundled = _PACKAGE / "_bundle" / name
    return bundled if bundled.is_dir() else _PACKAGE.parent / name
