"""How a training process uses the machine; to be set before torch is imported."""

from __future__ import annotations

import ctypes
import os

# mallopt's numbers, malloc.h
M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD = -1, -2, -3


def tune() -> None:
    """Let threads sleep while they wait, and keep freed memory.

    Threads that spin make training many times slower when anything else runs. Asking the system for each large
    tensor's memory anew took a quarter of the time of BCNN of width 16.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # glibc's
    if mallopt is not None:
        for key, value in ((M_MMAP_THRESHOLD, 2**25), (M_TRIM_THRESHOLD, 2**31 - 1), (M_TOP_PAD, 2**30)):
            mallopt(key, value)
