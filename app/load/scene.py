"""Chooses the reader for a file, then adds what the scene JSON says and what is still missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import numpy as np

from app.errors import SceneError
from app.io.checked_json import at, did_you_mean
from app.load.cameras import AUTO, automatic_camera, automatic_light
from app.load.emitters import find_emitters
from app.load.environment import environment
from app.load.gltf import read_gltf
from app.load.motion import build_motion
from app.load.obj import read_obj
from app.load.ply import read_ply
from app.load.scene_builder import LARGEST, SceneBuilder
from app.load.sidecar import Lighting, Sidecar, read_sidecar
from app.load.survey import Survey
from app.scene import CameraPath, Environment, Scene, bounds_of

READERS: dict[str, Callable[[Path, SceneBuilder], None]] = {
    ".obj": read_obj, ".gltf": read_gltf, ".glb": read_gltf, ".ply": read_ply,
}


@dataclass(frozen=True, eq=False)
class Parts:
    """A scene, and what an editor needs to know of it.

    Attributes
    ----------
    own_lights : int
        How many of the scene's lights, the first ones, stand for no emissive surface.
    objects : dict of str to tuple of int
        Instances that each name of the file moves.
    sidecar : Sidecar
        What the scene JSON says.
    """

    scene: Scene
    own_lights: int
    objects: dict[str, tuple[int, ...]]
    sidecar: Sidecar

    @property
    def lighting(self) -> Lighting | None:
        """What the scene JSON says of the chosen lighting; None where the file's own lights shine."""
        return self.sidecar.lightings.get(self.scene.lighting)


def load_scene(path: str | Path, *, lighting: str | None = None, scene_json: str | Path | None = None) -> Scene:
    """Load a scene file for one lighting.

    Parameters
    ----------
    path : str or Path
        An ``.obj``, ``.gltf``, ``.glb`` or ``.ply`` file.
    lighting : str, optional
        A name under ``lightings`` in the scene JSON; its default when not given.
    scene_json : str or Path, optional
        The scene JSON; the file of the same stem beside the scene, if there is one, when not given.

    Raises
    ------
    SceneError
        When a file is missing, corrupt or of an unknown kind, when nothing in it can be drawn, when the
        scene JSON has a mistake, or when there is no lighting of that name.
    """
    return load_parts(path, lighting=lighting, scene_json=scene_json).scene


def load_parts(path: str | Path, *, lighting: str | None = None, scene_json: str | Path | None = None) -> Parts:
    """The same as ``load_scene``, with what an editor needs to know besides."""
    path = Path(path)
    builder = _read(path)
    sidecar = _sidecar(path, scene_json)
    builder.cameras = sidecar.cameras | builder.cameras | sidecar.cameras
    name = _choose(lighting, sidecar.default_lighting, list(sidecar.lightings), "lighting", sidecar.path or path)
    _add_motions(builder, sidecar)
    if name is not None:
        builder.lights = list(sidecar.lightings[name].lights)
        builder.scale_emission(sidecar.lightings[name].emission)
        builder.environment = _environment(sidecar, name, builder.notice)
    before = len(builder.lights)
    find_emitters(builder)
    emitters = len(builder.lights) - before
    builder.drop_unused()
    scene = _finish(builder, path, sidecar, name)
    objects = {group: tuple(members) for group, members in builder.groups.items()}
    return Parts(scene, len(scene.lights) - emitters, objects, sidecar)


def embedded_scene(*, lighting: str | None = None) -> Scene:
    """The Cornell box that comes with the program; lightings ``lamp`` (default) and ``emissive``.

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
        raise SceneError("a folder, not a scene file", path, expected)
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
        raise SceneError("the scene does not fit into memory", path, "expected a smaller or a sound file") from error
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise SceneError(f"the scene file is corrupt ({reason})", path,
                         f"expected a valid {path.suffix} file") from error
    builder.notice_repairs()
    if not builder.instances:
        hints = f" ({'; '.join(builder.notices)})" if builder.notices else ""
        raise SceneError(f"no triangle to draw{hints}", path, "expected at least one triangle with an area")
    return builder


def _sidecar(path: Path, scene_json: str | Path | None) -> Sidecar:
    if scene_json is not None:
        return read_sidecar(Path(scene_json))
    beside = path.with_suffix(".json")
    return read_sidecar(beside) if beside.is_file() else Sidecar()


def _choose(asked: str | None, default: str | None, known: list[str], what: str, where: Path) -> str | None:
    """The name to use: the one asked for, the default, the first, or none."""
    if asked is not None and asked not in known:
        raise SceneError(f"no {what} {asked!r}", where, did_you_mean(asked, known))
    if default is not None and default not in known:
        raise SceneError(f"no {what} {default!r}", at(where, "default", what), did_you_mean(default, known))
    return asked or default or next(iter(known), None)


def _environment(sidecar: Sidecar, lighting: str, notice: Callable[[str], object]) -> Environment | None:
    spec = sidecar.lightings[lighting].environment
    return environment(spec, (sidecar.path or Path()).parent, notice) if spec is not None else None


def _add_motions(builder: SceneBuilder, sidecar: Sidecar) -> None:
    where = sidecar.path or Path()
    for name, keys in sidecar.objects.items():
        if name not in builder.groups:
            raise SceneError(f"no object {name!r}", at(where, "objects", name),
                             did_you_mean(name, list(builder.groups)))
        moved = tuple(builder.instances[i] for i in builder.groups[name])
        motion = build_motion(keys, bounds_of(tuple(builder.meshes), moved).mean(axis=0))
        for i in builder.groups[name]:
            if builder.instances[i].motion is not None:
                raise SceneError(f"{builder.instances[i].name!r} is moved twice", at(where, "objects", name),
                                 "expected one motion for each object")
            builder.instances[i] = replace(builder.instances[i], motion=motion)


def _finish(builder: SceneBuilder, path: Path, sidecar: Sidecar, lighting: str | None) -> Scene:
    meshes, instances = tuple(builder.meshes), tuple(builder.instances)
    bounds = bounds_of(meshes, instances)
    if not np.abs(bounds).max() < LARGEST:
        raise SceneError("the scene is too large or not finite", path, f"expected coordinates below {LARGEST:g}")
    default = _choose(None, sidecar.default_camera, list(builder.cameras), "camera", sidecar.path or path)
    glows = any(m.emits for m in builder.materials)
    lightless = lighting is None and not builder.lights and not glows
    if default is None or lightless:
        survey = Survey(meshes, instances)
        if default is None:
            camera, notice = automatic_camera(survey)
            builder.cameras[AUTO], default = CameraPath.still(camera), AUTO
            builder.notice(notice)
        if lightless:
            light, notice = automatic_light(survey, builder.cameras[default].at(0.0))
            builder.lights.append(light)
            builder.notice(notice)
    return Scene(
        name=path.stem, meshes=meshes, instances=instances, materials=tuple(builder.materials),
        lights=tuple(builder.lights), cameras=builder.cameras, default_camera=default, bounds=bounds,
        lighting=lighting or "", notices=tuple(builder.notices), environment=builder.environment,
    )
