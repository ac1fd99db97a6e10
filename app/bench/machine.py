"""A description of the machine that a benchmark ran on."""

import os
import platform
from contextlib import suppress
from importlib import metadata
from pathlib import Path

from app import __version__
from app.extras import extra_module

PACKAGES = ("numpy", "moderngl", "onnxruntime", "mitsuba", "drjit", "pyoidn", "flip-evaluator", "scikit-image")


def describe_machine() -> dict[str, object]:
    """Processor, cores, memory, system, load, and versions of the packages that did the work.

    Raises
    ------
    MissingExtraError
        Without the package psutil.
    """
    psutil = extra_module("psutil", "evaluation")
    return {
        "processor": processor_name(), "cores": len(os.sched_getaffinity(0)),
        "physical_cores": psutil.cpu_count(logical=False), "memory_gb": round(psutil.virtual_memory().total / 1e9, 1),
        "system": f"{platform.system()} {platform.release()}", "python": platform.python_version(),
        "load_average": os.getloadavg()[0], "versions": {"afterglow": __version__, **_versions()},
    }


def processor_name() -> str:
    """The processor's model name, or its architecture where the system does not tell."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
                platform.machine())


def _versions() -> dict[str, str]:
    versions = {}
    for package in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[package] = metadata.version(package)
    return versions
