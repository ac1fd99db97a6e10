"""Loading Mitsuba and the LLVM library that it compiles its kernels with."""

import os
import re
from pathlib import Path
from typing import Any

from app.errors import DeviceError

VARIANT = "llvm_ad_rgb"
MIN_LLVM = 16  # older ones fail on processors with AVX-512
LLVM_FOLDERS = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/opt/homebrew/opt/llvm/lib")
LLVM_PATTERNS = ("libLLVM*.so*", "*/libLLVM*.so*", "libLLVM*.dylib")


def load_mitsuba() -> Any:
    """The Mitsuba module with its variant set.

    Raises
    ------
    DeviceError
        When Mitsuba or LLVM is missing, or the LLVM library is unusable.
    """
    try:
        import mitsuba as mi
    except ImportError:
        raise DeviceError("the path tracer is not installed", "package mitsuba",
                          "expected pip install 'afterglow[export]'") from None
    if mi.variant() is None:
        if "DRJIT_LIBLLVM_PATH" not in os.environ:
            os.environ["DRJIT_LIBLLVM_PATH"] = _find_llvm()
        try:
            mi.set_variant(VARIANT)
        except ImportError:  # Dr.Jit has printed the reason
            raise DeviceError("the LLVM library is unusable", os.environ["DRJIT_LIBLLVM_PATH"],
                              f"expected version {MIN_LLVM} or newer") from None
        mi.set_log_level(mi.LogLevel.Error)
    return mi


def _find_llvm() -> str:
    """Path of the newest LLVM library on this machine."""
    libraries = {int(version[1]): str(file) for folder in LLVM_FOLDERS for pattern in LLVM_PATTERNS
                 for file in Path(folder).glob(pattern) if (version := re.search(r"(\d+)", file.name))}
    newest = max(libraries, default=0)
    if newest < MIN_LLVM:
        raise DeviceError("no LLVM library for the path tracer", "this machine",
                          f"expected version {MIN_LLVM} or newer (Debian: apt-get install libllvm19), "
                          "or its path in DRJIT_LIBLLVM_PATH")
    return libraries[newest]
