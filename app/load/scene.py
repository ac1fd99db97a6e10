"""Loads a scene: reads its file, applies the scene JSON, and adds a camera and a light where they are missing."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import numpy as np

from app.errors import SceneError, did_you_mean
from app.io.checked_json import at
from app.load.cameras import AUTO, place_camera, place_light
from app.load.emitters import find_emitters
from app.load.environment import build_environment
from app.load.free_space import FreeSpace
from app.load.gltf import read_gltf
from app.load.motion import build_motion
from app.load.obj import read_obj
from app.load.ply import read_ply
from app.load.scene_builder import MAX_COORDINATE, SceneBuilder
from app.load.sidecar import Lighting, Sidecar, read_sidecar
from app.load.suns import describe_sun, extract_suns
from app.scene import CameraPath, Scene, bounds_of

READERS: dict[str, Callable[[Path, SceneBuilder], None]] = {
    ".obj": read_obj, ".gltf": read_gltf, ".glb": read_gltf, ".ply": read_ply,
}


@dataclass(frozen=True, eq=False)
class LoadedScene:
    """A scene with what an editor needs besides.

    Attributes
    ----------
    own_lights : int
        Number of lights of the file or its scene JSON. They come first in ``scene.lights``, before suns of the
        environment and emissive surfaces.
    objects : dict of str to tuple of int
        Indices of the instances that each name in the file moves.
    sidecar : Sidecar
        The content of the scene JSON.
    """

    scene: Scene
    own_lights: int
    objects: dict[str, tuple[int, ...]]
    sidecar: Sidecar

    @property
    def lighting(self) -> Lighting | None:
        """The chosen lighting of the scene JSON; None if the lights of the scene file are used."""
        return self.sidecar.lightings.get(self.scene.lighting)


def load_scene(path: str | Path, *, lighting: str | None = None, scene_json: str | Path | None = None) -> Scene:
    """Load a scene file for one lighting.

    Parameters
    ----------
    path : str or Path
        An ``.obj``, ``.gltf``, ``.glb`` or ``.ply`` file.
    lighting : str, optional
        A name under ``lightings`` in the scene JSON, whose default it is otherwise.
    scene_json : str or Path, optional
        The scene JSON; default is the file of the same stem beside the scene, if it exists.

    Raises
    ------
    SceneError
        When a file is missing, corrupt or of an unknown kind, when it has no triangle to draw, when the scene JSON is
        invalid, or when there is no lighting of that name.
    """
    return load_for_editing(path, lighting=lighting, scene_json=scene_json).scene


def load_for_editing(path: str | Path, *, lighting: str | None = None,
                     scene_json: str | Path | None = None) -> LoadedScene:
    """Load a scene file as ``load_scene`` does, with what an editor needs besides."""
    path = Path(path)
    builder = _read(path)
    sidecar = _read_sidecar(path, scene_json)
    builder.cameras = sidecar.cameras | builder.cameras | sidecar.cameras
    name = _choose(lighting, sidecar.default_lighting, list(sidecar.lightings), "lighting", sidecar.path or path)
    _add_motions(builder, sidecar)
    if name is not None:
        chosen = sidecar.lightings[name]
        builder.lights = list(chosen.lights)
        builder.scale_emission(chosen.emission)
        if chosen.environment is not None:
            folder = (sidecar.path or Path()).parent
            builder.environment = build_environment(chosen.environment, folder, builder.notice)
    own_lights = len(builder.lights)
    _extract_suns(builder)
    find_emitters(builder)
    derived_lights = len(builder.lights) - own_lights
    builder.drop_unused()
    scene = _finish(builder, path, sidecar, name)
    objects = {group: tuple(members) for group, members in builder.groups.items()}
    return LoadedScene(scene, len(scene.lights) - derived_lights, objects, sidecar)


def embedded_scene(*, lighting: str | None = None) -> Scene:
    """Load the bundled Cornell box, whose lightings are ``lamp`` (default) and ``emissive``.

    Raises
    ------
    SceneError
        When there is no lighting of that name.
    """
    with resources.as_file(resources.files("app.data")) as folder:
        return load_scene(folder / "cornell-box.obj", lighting=lighting)


def _read(path: Path) -> SceneBuilder:
    expected = f"expected one of: {', '.join(READERS)}"
    if path.is_dir():
        raise SceneError("is a folder, not a scene file", path, expected)
    if not path.is_file():
        raise SceneError("no such scene file", path, "expected the path of an existing file")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise SceneError(f"unknown kind of scene file {path.suffix!r}", path, expected)
    builder = SceneBuilder(str(path))
    try:
        with np.errstate(all="ignore"):
            reader(path, builder)
    except SceneError:
        raise
    except MemoryError as error:
        raise SceneError("the scene does not fit into memory", path, "expected a smaller or undamaged file") from error
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise SceneError(f"the scene file is corrupt: {reason}", path,
                         f"expected a valid {path.suffix} file") from error
    builder.notice_repairs()
    if not builder.instances:
        hints = f": {'; '.join(builder.notices)}" if builder.notices else ""
        raise SceneError(f"no triangle to draw{hints}", path, "expected at least one triangle with an area")
    return builder


def _read_sidecar(path: Path, scene_json: str | Path | None) -> Sidecar:
    if scene_json is not None:
        return read_sidecar(Path(scene_json))
    beside = path.with_suffix(".json")
    return read_sidecar(beside) if beside.is_file() else Sidecar()


def _choose(requested: str | None, default: str | None, known: list[str], what: str, where: Path) -> str | None:
    """The name to use: the requested one, the default, the first, or none."""
    if requested is not None and requested not in known:
        raise SceneError(f"no {what} {requested!r}", where, did_you_mean(requested, known))
    if default is not None and default not in known:
        raise SceneError(f"no {what} {default!r}", at(where, "default", what), did_you_mean(default, known))
    return requested or default or next(iter(known), None)


def _extract_suns(builder: SceneBuilder) -> None:
    """Replace the suns of the builder's environment by directional lights."""
    if builder.environment is not None:
        builder.environment, suns = extract_suns(builder.environment)
        builder.lights += suns
        for sun in suns:
            builder.notice(describe_sun(sun))


def _add_motions(builder: SceneBuilder, sidecar: Sidecar) -> None:
    where = sidecar.path or Path()
    for name, keys in sidecar.objects.items():
        if name not in builder.groups:
            raise SceneError(f"no object {name!r}", at(where, "objects", name), did_you_mean(name, builder.groups))
        members = tuple(builder.instances[i] for i in builder.groups[name])
        motion = build_motion(keys, bounds_of(tuple(builder.meshes), members).mean(axis=0))
        for i in builder.groups[name]:
            if builder.instances[i].motion is not None:
                raise SceneError(f"{builder.instances[i].name!r} has two motions", at(where, "objects", name),
                                 "expected at most one motion for each object")
            builder.instances[i] = replace(builder.instances[i], motion=motion)


def _finish(builder: SceneBuilder, path: Path, sidecar: Sidecar, lighting: str | None) -> Scene:
    meshes, instances = tuple(builder.meshes), tuple(builder.instances)
    bounds = bounds_of(meshes, instances)
    if not np.abs(bounds).max() < MAX_COORDINATE:
        raise SceneError("the scene is too large or not finite", path, f"expected coordinates below {MAX_COORDINATE:g}")
    default = _choose(None, sidecar.default_camera, list(builder.cameras), "camera", sidecar.path or path)
    emissive = any(m.emits for m in builder.materials)
    is_unlit = lighting is None and not builder.lights and not emissive
    if default is None or is_unlit:
        space = FreeSpace(meshes, instances)
        if default is None:
            camera, notice = place_camera(space)
            builder.cameras[AUTO], default = CameraPath.still(camera), AUTO
            builder.notice(notice)
        if is_unlit:
            light, notice = place_light(space, builder.cameras[default].at(0.0))
            builder.lights.append(light)
            builder.notice(notice)
    return Scene(
        name=path.stem, meshes=meshes, instances=instances, materials=tuple(builder.materials),
        lights=tuple(builder.lights), cameras=builder.cameras, default_camera=default, bounds=bounds,
        lighting=lighting or "", notices=tuple(builder.notices), environment=builder.environment,
        approximate_lights=tuple(builder.approximate_lights),
        approximated_materials=tuple(builder.approximated_materials),
    )
