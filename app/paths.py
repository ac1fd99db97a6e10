"""Where shaders, networks and data lie, and what the packages are called, in a checkout and in a wheel."""

import os
from pathlib import Path

SHADERS = "AFTERGLOW_SHADERS"  # environment variable: another folder of shaders, to try a change without touching these

# In a wheel this package is ``afterglow._app``, and ``export`` is ``afterglow.export`` (scripts/wheel_layout.py).
PROGRAM = __name__.partition(".")[0]                                    # runs as ``python -m PROGRAM``
TRAINING = "export" if PROGRAM == "app" else f"{PROGRAM}.export"        # runs as ``python -m TRAINING``

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
