"""Loads a scene: reads its file, applies the scene JSON, and adds a camera and a light where they are missing."""

import json
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from app.arrays import F64
from app.errors import MissingExtraError, SceneError, did_you_mean
from app.io.checked_json import at
from app.load.cameras import AUTO, place_camera, place_lamp
from app.load.emitters import find_emitters
from app.load.environment import build_environment
from app.load.free_space import FreeSpace
from app.load.gltf import read_gltf
from app.load.motion import build_motion
from app.load.obj import read_obj
from app.load.ply import read_ply
from app.load.scene_builder import MAX_COORDINATE, SceneBuilder
from app.load.sidecar import Lighting, Sidecar, read_sidecar
from app.load.studio import STUDIO, add_ground, is_dark, studio_lighting, why_dark
from app.load.suns import describe_sun, extract_suns
from app.math3d import affine_matrix
from app.scene import Camera, CameraPath, Scene, bounds_of

READERS: dict[str, Callable[[Path, SceneBuilder], None]] = {
    ".obj": read_obj, ".gltf": read_gltf, ".glb": read_gltf, ".ply": read_ply,
}

FREE_AXES = ".obj", ".ply"  # files that may have z up
Z_TO_Y_UP = affine_matrix(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.zeros(3))


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
    animation, variant : str or None
        The animation, and the variant of the materials, that were asked for.
    """

    scene: Scene
    own_lights: int
    objects: dict[str, tuple[int, ...]]
    sidecar: Sidecar
    animation: str | None = None
    variant: str | None = None

    @property
    def lighting(self) -> Lighting | None:
        """The chosen lighting of the scene JSON; None if the lights of the scene file are used."""
        return self.sidecar.lightings.get(self.scene.lighting)


def load_scene(path: str | Path, *, lighting: str | None = None, scene_json: str | Path | None = None,
               variant: str | None = None, animation: str | None = None, studio: bool = True,
               ground: bool = False) -> Scene:
    """Load a scene file for one lighting.

    Parameters
    ----------
    path : str or Path
        An ``.obj``, ``.gltf``, ``.glb`` or ``.ply`` file.
    lighting : str, optional
        A name under ``lightings`` in the scene JSON, whose default it is otherwise, or ``studio``.
    scene_json : str or Path, optional
        The scene JSON; default is the file of the same stem beside the scene, if it exists.
    variant : str, optional
        A variant of a glTF file's materials (KHR_materials_variants).
    animation : str, optional
        The name of an animation of the file, ``all`` or ``none``; default is the first.
    studio : bool
        Whether a scene without light is lit: an object by the studio, a room by a lamp.
    ground : bool
        Whether a ground is added below the scene.

    Raises
    ------
    SceneError
        When a file is missing, corrupt or of an unknown kind, when it has no triangle to draw, when the scene JSON is
        invalid, or when there is no lighting, variant or animation of that name.
    """
    return load_for_editing(path, lighting=lighting, scene_json=scene_json, variant=variant, animation=animation,
                            studio=studio, ground=ground).scene


def load_for_editing(path: str | Path, *, lighting: str | None = None, scene_json: str | Path | None = None,
                     variant: str | None = None, animation: str | None = None, studio: bool = True,
                     ground: bool = False) -> LoadedScene:
    """Load a scene file as ``load_scene`` does, with what an editor needs besides."""
    path = Path(path)
    builder, sidecar = read_scene(path, scene_json=scene_json, variant=variant, animation=animation)
    return finish_scene(builder, path, sidecar, lighting=lighting, studio=studio, ground=ground)


def read_scene(path: Path, *, scene_json: str | Path | None = None, variant: str | None = None,
               animation: str | None = None) -> tuple[SceneBuilder, Sidecar]:
    """Read a scene file and its scene JSON, with cameras and motions, but without any lighting of the scene JSON."""
    builder = _read(path, variant, animation)
    sidecar = _read_sidecar(path, scene_json)
    if sidecar.has_z_up:
        _turn_up(builder, path, sidecar)
    builder.cameras = sidecar.cameras | builder.cameras | sidecar.cameras
    _add_motions(builder, sidecar)
    return builder, sidecar


def finish_scene(builder: SceneBuilder, path: Path, sidecar: Sidecar, *, lighting: str | None = None,
                 studio: bool = True, ground: bool = False) -> LoadedScene:
    """The scene of what ``builder`` holds, with a lighting, a camera, and lights for what emits.

    Parameters
    ----------
    path : Path
        Names the scene, also in messages.
    """
    _check_bounds(bounds_of(tuple(builder.meshes), tuple(builder.instances)), path)
    space = cache(lambda: FreeSpace(builder.meshes, builder.instances))  # takes long and is seldom needed
    camera = choose_camera(builder, path, sidecar, space)
    view = builder.cameras[camera].at(0.0)
    sidecar, name = apply_lighting(builder, path, sidecar, lighting, view)
    if name is None and not builder.lights and is_dark(builder, space):
        if studio:
            sidecar, name = _light_the_dark(builder, path, sidecar, view, space())
        else:
            builder.notice("the scene has next to no light, so it is black without the studio")
    own_lights = len(builder.lights)
    _extract_suns(builder)
    if name != STUDIO:  # there, surfaces glow without lighting others directly
        find_emitters(builder)
    builder.drop_unused()
    if ground:
        add_ground(builder)
    objects = {group: tuple(members) for group, members in builder.groups.items()}
    return LoadedScene(_make_scene(builder, path, camera, name), own_lights, objects, sidecar, builder.animation,
                       builder.variant)


def embedded_scene(*, lighting: str | None = None) -> Scene:
    """Load the bundled Cornell box, whose lightings are ``lamp`` (default) and ``emissive``.

    Raises
    ------
    SceneError
        When there is no lighting of that name.
    """
    with resources.as_file(resources.files("app.data")) as folder:
        return load_scene(folder / "cornell-box.obj", lighting=lighting)


def _read(path: Path, variant: str | None, animation: str | None) -> SceneBuilder:
    expected = f"expected one of: {', '.join(READERS)}"
    if path.is_dir():
        raise SceneError("is a folder, not a scene file", path, expected)
    if not path.is_file():
        raise SceneError("no such scene file", path, "expected the path of an existing file")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise SceneError(f"unknown kind of scene file {path.suffix!r}", path, expected)
    builder = SceneBuilder(str(path), variant=variant, animation=animation)
    try:
        with np.errstate(all="ignore"):
            reader(path, builder)
    except (SceneError, MissingExtraError):
        raise
    except MemoryError as error:
        raise SceneError("the scene does not fit into memory", path, "expected a smaller or undamaged file") from error
    except Exception as error:
        reason = " ".join((_reason(error), *getattr(error, "__notes__", ())))
        raise SceneError(f"the scene file is corrupt: {reason}", path,
                         f"expected a valid {path.suffix} file") from error
    if variant is not None and variant not in builder.variants:
        raise SceneError(f"no material variant {variant!r}", path, did_you_mean(variant, builder.variants))
    builder.notice_repairs()
    if animation is not None and not builder.animations:
        raise SceneError("the file has no animation", path,
                         f"expected a glTF file with animations to play {animation!r}")
    require_instances(builder, path)
    return builder


def _reason(error: Exception) -> str:
    """What an error that a reader met says about the file."""
    match error:
        case json.JSONDecodeError() if not error.doc.strip():
            return "it is empty"
        case json.JSONDecodeError():
            return f"it is not JSON at line {error.lineno}, column {error.colno}"
        case UnicodeDecodeError():
            return "it is not text in UTF-8"
        case KeyError():
            return f"{error} is missing"
        case TypeError() | AttributeError():
            return "a value is of the wrong kind"
        case ValueError() if str(error).startswith("could not convert string"):
            return "a text is where a number is expected"
        case IndexError() if "out of " in str(error):  # in Python's own words
            return "a list is too short, or an index too large,"
        case struct.error():
            return "it ends too early"
        case RecursionError():
            return "it is nested too deeply"
    return " ".join(str(error).split())[:120] or type(error).__name__


def require_instances(builder: SceneBuilder, path: Path) -> None:
    """Check that there is something to draw.

    Raises
    ------
    SceneError
        When there is not.
    """
    if all(not i.moves and np.count_nonzero(i.transform[:3, :3].any(axis=0)) < 2 for i in builder.instances):
        hints = f": {'; '.join(builder.notices)}" if builder.notices else ""
        raise SceneError(f"no triangle to draw{hints}", path, "expected at least one triangle with an area")


def _read_sidecar(path: Path, scene_json: str | Path | None) -> Sidecar:
    if scene_json is not None:
        return read_sidecar(Path(scene_json))
    beside = path.with_suffix(".json")
    return read_sidecar(beside) if beside.is_file() else Sidecar()


def _choose(requested: str | None, default: str | None, known: list[str], what: str, where: Path,
            others: Sequence[str] = ()) -> str | None:
    """The name to use: the requested one, which may be of ``others`` too, the default, the first, or none."""
    if requested is not None and requested not in (names := dict.fromkeys([*known, *others])):
        raise SceneError(f"no {what} {requested!r}", where, did_you_mean(requested, names))
    if default is not None and default not in known:
        raise SceneError(f"no {what} {default!r}", at(where, "default", what), did_you_mean(default, known))
    return requested or default or next(iter(known), None)


def choose_camera(builder: SceneBuilder, path: Path, sidecar: Sidecar,
                  space: Callable[[], FreeSpace] | None = None) -> str:
    """Name of the default camera, which is added if there is none."""
    name = _choose(None, sidecar.default_camera, list(builder.cameras), "camera", sidecar.path or path)
    if name is None:
        camera, notice = place_camera(FreeSpace(builder.meshes, builder.instances) if space is None else space())
        builder.cameras[name := AUTO] = CameraPath.still(camera)
        builder.notice(notice)
    return name


def _light_the_dark(builder: SceneBuilder, path: Path, sidecar: Sidecar, camera: Camera, space: FreeSpace
                    ) -> tuple[Sidecar, str | None]:
    """Light what has no light, as seen by ``camera``: a room by a lamp, an object by the studio."""
    if space.is_room:
        lamp, place = place_lamp(space, camera)
        builder.lights.append(lamp)
        builder.notice(f"{why_dark(builder)}, so {place}")
        return sidecar, None
    builder.notice(f"{why_dark(builder)}, so it is shown in a neutral studio (not with --no-studio, or studio=False)")
    return apply_lighting(builder, path, sidecar, STUDIO, camera)


def apply_lighting(builder: SceneBuilder, path: Path, sidecar: Sidecar, requested: str | None, camera: Camera
                   ) -> tuple[Sidecar, str | None]:
    """Apply a lighting of the scene JSON, or the studio around what ``camera`` sees.

    Returns
    -------
    sidecar : Sidecar
        With the lighting that was applied.
    name : str or None
        Of that lighting; None if the scene has its own lights.
    """
    known = sidecar.lightings
    name = _choose(requested, sidecar.default_lighting, list(known), "lighting", sidecar.path or path, [STUDIO])
    if name == STUDIO and STUDIO not in known:
        sidecar = replace(sidecar, lightings={**known, STUDIO: studio_lighting(camera)})
    if name is not None:
        chosen = sidecar.lightings[name]
        builder.lights = list(chosen.lights)
        builder.scale_emission(chosen.emission)
        if chosen.environment is not None:
            folder = (sidecar.path or Path()).parent
            try:
                builder.environment = build_environment(chosen.environment, folder, builder.notice)
            except SceneError as error:  # about an image
                where = at(sidecar.path, "lightings", name, "environment", "file")
                raise SceneError(f"{error.where}: {error.what}", where, error.expected) from error
    return sidecar, name


def _extract_suns(builder: SceneBuilder) -> None:
    """Replace the suns of the builder's environment by directional lights."""
    if builder.environment is not None:
        builder.environment, suns = extract_suns(builder.environment)
        builder.lights += suns
        for sun in suns:
            builder.notice(describe_sun(sun))


def _turn_up(builder: SceneBuilder, path: Path, sidecar: Sidecar) -> None:
    """Turn what a file with z up holds, so that y is up."""
    if path.suffix.lower() not in FREE_AXES:
        raise SceneError(f"{path.name} has y up, as all glTF files", at(sidecar.path or path, "up_axis"),
                         f"expected up_axis with {' and '.join(FREE_AXES)} files only")
    builder.instances = [replace(instance, transform=Z_TO_Y_UP @ instance.transform) for instance in builder.instances]


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


def _make_scene(builder: SceneBuilder, path: Path, camera: str, lighting: str | None) -> Scene:
    meshes, instances = tuple(builder.meshes), tuple(builder.instances)
    scene = Scene(
        name=path.stem, meshes=meshes, instances=instances, materials=tuple(builder.materials),
        lights=tuple(builder.lights), cameras=builder.cameras, default_camera=camera,
        bounds=bounds_of(meshes, instances), lighting=lighting or "", notices=tuple(builder.notices),
        environment=builder.environment, approximations=tuple(builder.approximations),
        approximate_lights=builder.approximate_lights,
        approximated_materials=tuple(builder.approximated_materials),
    )
    if any(i.moves for i in instances):
        _check_bounds(scene.swept_bounds, path)
    return scene


def _check_bounds(bounds: F64, path: Path) -> None:
    if not np.abs(bounds).max() < MAX_COORDINATE:
        raise SceneError("the scene is too large or not finite", path, f"expected coordinates below {MAX_COORDINATE:g}")
