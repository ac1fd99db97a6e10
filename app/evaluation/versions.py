"""Digests of the code that references depend on."""

import hashlib
from importlib import metadata, util
from pathlib import Path

from app import environment
from app.errors import MissingExtraError
from app.evaluation import denoise
from app.paths import TRAINING
from app.scene import Scene

PATH_TRACER_PACKAGES = ("mitsuba", "drjit")
# Of the path tracer; references don't depend on them.
UNUSED_FILES = ("__init__.py", "cli.py", "environment_tracer.py", "integrator_timer.py")


def exporter_version(scene: Scene) -> str:
    """A digest that changes with the path tracer and the code around it, so far as ``scene`` makes use of it.

    Raises
    ------
    MissingExtraError
        When the path tracer is not installed.
    """
    package = require_path_tracer()
    digest = hashlib.sha256("".join(map(metadata.version, PATH_TRACER_PACKAGES)).encode())
    modules = (denoise,) if scene.environment is None else (denoise, environment)
    tracer = [file for file in sorted((package / "reference").glob("*.py")) if file.name not in UNUSED_FILES]
    for file in (*tracer, *(Path(str(module.__file__)) for module in modules)):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def require_path_tracer() -> Path:
    """The folder of the package ``export``, found without importing it.

    Raises
    ------
    MissingExtraError
        When it or the path tracer is not installed.
    """
    package = util.find_spec(TRAINING)
    try:
        for name in PATH_TRACER_PACKAGES:
            metadata.version(name)
    except metadata.PackageNotFoundError:
        package = None
    if package is None or not package.submodule_search_locations:
        raise MissingExtraError("no path tracer to make the reference with", "--reference auto",
                                "pip install 'afterglow[export]', or --reference DIR")
    return Path(package.submodule_search_locations[0])
