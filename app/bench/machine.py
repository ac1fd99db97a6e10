"""On what it was measured."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path

from app import __version__
from app.extras import extra_module

PACKAGES = ("numpy", "moderngl", "onnxruntime", "mitsuba", "drjit", "pyoidn", "flip-evaluator", "scikit-image")


def describe_machine() -> dict[str, object]:
    """Processor, cores, memory, system, load, and the versions of what did the work.

    Raises
    ------
    MissingExtraError
        Without the package psutil.
    """
    psutil = extra_module("psutil", "judge")
    return {
        "processor": _processor(), "cores": len(os.sched_getaffinity(0)),
        "physical_cores": psutil.cpu_count(logical=False), "memory_gb": round(psutil.virtual_memory().total / 1e9, 1),
        "system": f"{platform.system()} {platform.release()}", "python": platform.python_version(),
        "load_average": os.getloadavg()[0], "versions": {"afterglow": __version__, **_versions()},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
                platform.machine())


def _versions() -> dict[str, str]:
    found = {}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found
