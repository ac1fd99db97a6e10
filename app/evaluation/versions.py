"""Digests of the code that references depend on."""

import hashlib
from importlib import metadata, util
from pathlib import Path

from app import environment
from app.errors import MissingExtraError
from app.evaluation import denoise
from app.gl.shader import resolve
from app.paths import shader_dir
from app.scene import Scene

PATH_TRACER_PACKAGES = ("mitsuba", "drjit")
COMMAND_FILES = ("__init__.py", "cli.py")       # of the path tracer; references do not depend on them
ENVIRONMENT_FILES = ("environment_tracer.py",)  # those of scenes without an environment do not depend on it
# Shaders of the light that the renderer adds to path-traced diffuse light: emission and specular, and the background.
SURFACE_SHADERS = ("gbuffer.vert", "gbuffer.frag", "shadow.vert", "shadow.frag", "shadow_nearest.frag", "direct.frag")
BACKGROUND_SHADERS = ("gbuffer.vert", "gbuffer.frag", "background.frag")


def exporter_version(scene: Scene) -> str:
    """A digest that changes with the path tracer and the code around it, so far as ``scene`` makes use of it.

    Raises
    ------
    MissingExtraError
        When the path tracer is not installed.
    """
    package = require_path_tracer()
    digest = hashlib.sha256("".join(map(metadata.version, PATH_TRACER_PACKAGES)).encode())
    has_environment = scene.environment is not None
    modules = (denoise, environment) if has_environment else (denoise,)
    unused = COMMAND_FILES if has_environment else (*COMMAND_FILES, *ENVIRONMENT_FILES)
    tracer = [file for file in sorted((package / "reference").glob("*.py")) if file.name not in unused]
    for file in (*tracer, *(Path(str(module.__file__)) for module in modules)):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def renderer_version(scene: Scene) -> str:
    """A digest that changes with the shaders of emission, specular and background, if ``scene`` has any of these."""
    digest = hashlib.sha256()
    has_surfaces = any(material.emits or material.has_specular for material in scene.materials)
    has_background = scene.environment is not None
    for file in (*(SURFACE_SHADERS if has_surfaces else ()), *(BACKGROUND_SHADERS if has_background else ())):
        digest.update(resolve(shader_dir() / file, {}, []).encode())
    return digest.hexdigest()


def require_path_tracer() -> Path:
    """The folder of the package ``export``, found without importing it.

    Raises
    ------
    MissingExtraError
        When it or the path tracer is not installed.
    """
    package = util.find_spec("export")
    try:
        for name in PATH_TRACER_PACKAGES:
            metadata.version(name)
    except metadata.PackageNotFoundError:
        package = None
    if package is None or not package.submodule_search_locations:
        raise MissingExtraError("no path tracer to make the reference with", "--reference auto",
                                "pip install 'afterglow[export]', or --reference DIR")
    return Path(package.submodule_search_locations[0])
