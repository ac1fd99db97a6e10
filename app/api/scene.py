"""Scenes that a program builds and changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from app.api.checked import check_cameras, check_environment, check_lights, check_path, read_array
from app.api.meshes import build_part, merge
from app.arrays import F64
from app.errors import SceneError, did_you_mean
from app.load.scene import LoadedScene, apply_lighting, choose_camera, finish_scene, read_scene, require_instances
from app.load.scene_builder import SceneBuilder
from app.load.sidecar import Lighting, Sidecar
from app.paths import data_dir
from app.scene import CameraPath, Environment, Light, Material, Motion


class SceneObject:
    """An object of a scene, which can be moved.

    Attributes
    ----------
    name : str
    """

    def __init__(self, name: str, transform: F64) -> None:
        self.name, self.transform = name, transform

    def __reduce__(self) -> tuple[type[SceneObject], tuple[str, F64]]:
        return type(self), (self.name, self.transform)  # copies of arrays can be written to, unlike those it makes

    def __repr__(self) -> str:
        return f"SceneObject({self.name!r})"

    @property
    def transform(self) -> F64:
        """Object space to world space, float64, shape (4, 4); assign another matrix to move the object.

        The array is read-only. Objects of a file are in world space already: their transform is the identity at first,
        and is applied to where the file has them.
        """
        return self._transform

    @transform.setter
    def transform(self, matrix: ArrayLike) -> None:
        self._transform = _transform(matrix, self.name)


@dataclass(frozen=True, eq=False)
class Assembled:
    """A scene as the renderer takes it.

    Attributes
    ----------
    motions : dict of str to Motion
        Of the objects that may move, by name; their matrices may be overwritten.
    placed : dict of str to ndarray
        The transform of each object when it was assembled.
    """

    loaded: LoadedScene
    motions: dict[str, Motion]
    placed: dict[str, F64]


class Scene:
    """Meshes, lights, an environment and cameras.

    Lists and properties may be changed at any time; a renderer follows with its next frame. Moving an object and
    changing lights of the same kinds is cheap. Anything else, also the first move of an object, makes the renderer
    begin anew, which takes about as long as its first frame.

    Parameters
    ----------
    name : str
    studio : bool
        Whether a scene without any light is lit: an object by a neutral studio, a room by a lamp.

    Attributes
    ----------
    lights : list of Light
        Emissive surfaces and suns of the environment are not in it.
    environment : Environment or None
    cameras : dict of str to CameraPath
        A ``Camera`` may be put into it too.
    """

    def __init__(self, name: str = "scene", *, studio: bool = True) -> None:
        self._path, self._base = check_path(name, "scene"), SceneBuilder(str(name))
        self._lighting: str | None = None
        self._parts: dict[str, SceneBuilder] = {}
        self.studio = studio
        self.lights: list[Light] = []
        self.environment: Environment | None = None
        self.cameras: dict[str, CameraPath] = {}
        self._objects: dict[str, SceneObject] = {}

    @property
    def objects(self) -> Mapping[str, SceneObject]:
        """The objects by name, read-only: ``add`` and ``remove`` change them."""
        return MappingProxyType(self._objects)

    @classmethod
    def _of(cls, path: Path, builder: SceneBuilder, camera: str, lighting: str | None, studio: bool) -> Scene:
        """The scene that a file holds."""
        scene = cls(path.stem, studio=studio)
        scene._path, scene._base, scene._lighting = path, builder, lighting
        scene.lights, scene.environment = list(builder.lights), builder.environment
        scene.cameras = {camera: builder.cameras[camera], **builder.cameras}
        scene._objects.update({name: SceneObject(name, np.eye(4)) for name in builder.groups})
        return scene

    def add(self, mesh: Any, material: Material | None = None, transform: ArrayLike | None = None, *,
            name: str = "object", smooth: bool = False, normals: ArrayLike | None = None, uvs: ArrayLike | None = None,
            colors: ArrayLike | None = None) -> SceneObject:
        """Add an object.

        Parameters
        ----------
        mesh : tuple of two arrays, trimesh.Trimesh, trimesh.Scene, str or Path
            Vertices, shape (V, 3), in scene units, and triangles, integers of shape (T, 3), counter-clockwise seen
            from the front; or what trimesh loaded; or a scene file, of which only the surfaces are added.
        material : Material, optional
            Replaces those of a trimesh object or a file. One with textures needs ``uvs``, or those of the object.
        transform : array_like, shape (4, 4), optional
            Object space to world space; default is the identity.
        name : str
            A number is appended where the scene has an object of that name.
        smooth : bool
            Whether arrays without ``normals``, and trimesh objects, are shaded with interpolated normals.
        normals, uvs, colors : array_like, optional
            Of arrays, for each vertex: shapes (V, 3); (V, 2) with v growing upwards; (V, 3) or (V, 4), linear.

        Raises
        ------
        SceneError
            When an array has another shape, or there is no triangle with an area.
        """
        if not isinstance(name, str):
            raise SceneError(f"bad name {name!r}", "scene", "expected a string")
        given = {key: values for key, values in (("normals", normals), ("uvs", uvs), ("colors", colors))
                 if values is not None}
        added = SceneObject(self._free_name(name), np.eye(4))
        if transform is not None:
            added.transform = transform
        self._parts[added.name] = build_part(mesh, added.name, material, smooth, given)
        self._objects[added.name] = added
        return added

    def remove(self, name: str) -> None:
        """Remove an object that was added."""
        if name not in self._parts:
            raise SceneError(f"no added object {name!r}", self._path, did_you_mean(name, self._parts))
        del self._parts[name], self._objects[name]

    def __getitem__(self, name: str) -> SceneObject:
        """The object of that name."""
        if name not in self.objects:
            raise SceneError(f"no object {name!r}", self._path, did_you_mean(name, self.objects))
        return self.objects[name]

    def assemble(self, movable: tuple[str, ...]) -> Assembled:
        """The scene as the renderer takes it, in which the objects ``movable`` can move."""
        builder = self._base.fork()
        for name, part in self._parts.items():
            merge(part, np.eye(4) if name in movable else self.objects[name].transform, name, builder)
        motions = {name: Motion(np.zeros(1), np.array([self.objects[name].transform])) for name in movable}
        for name, item in self.objects.items():
            if name in motions:
                _attach(builder, name, motions[name])
            elif name not in self._parts and not np.array_equal(item.transform, np.eye(4)):
                _attach(builder, name, None, item.transform)
        require_instances(builder, self._path)
        lights = check_lights(self.lights)
        builder.lights = list(lights)
        builder.environment = None if self.environment is None else check_environment(self.environment)
        builder.cameras = check_cameras(self.cameras)
        lightings = {} if self._lighting is None else {self._lighting: Lighting(lights)}
        loaded = finish_scene(builder, self._path, Sidecar(lightings=lightings),
                              studio=self.studio and self.environment is None)
        return Assembled(loaded, motions, {name: item.transform for name, item in self.objects.items()})

    @property
    def key(self) -> tuple[object, ...]:
        """Changes when a renderer of the scene has to begin anew."""
        return (*self._parts.values(), self.environment, self.studio)

    def _free_name(self, name: str) -> str:
        numbered = (f"{name}.{number}" for number in range(1, len(self.objects) + 2))
        return name if name not in self.objects else next(n for n in numbered if n not in self.objects)


def load(path: str | Path | None = None, *, lighting: str | None = None, scene_json: str | Path | None = None,
         variant: str | None = None, animation: str | None = None, studio: bool = True) -> Scene:
    """Load a scene file.

    Parameters
    ----------
    path : str or Path, optional
        An ``.obj``, ``.gltf``, ``.glb`` or ``.ply`` file; default is the embedded Cornell box.
    lighting : str, optional
        A name under ``lightings`` in the scene JSON, whose default it is otherwise, or ``studio``.
    scene_json : str or Path, optional
        The scene JSON; default is the file of the same stem beside the scene, if it exists.
    variant : str, optional
        A variant of a glTF file's materials.
    animation : str, optional
        The name of an animation of the file, ``all`` or ``none``; default is the first.
    studio : bool
        As for ``Scene``.

    Raises
    ------
    SceneError
        When a file is missing, corrupt or of an unknown kind.
    """
    file = data_dir() / "cornell-box.obj" if path is None else check_path(path, "scene")
    beside = None if scene_json is None else check_path(scene_json, "scene_json")
    builder, sidecar = read_scene(file, scene_json=beside, variant=variant, animation=animation)
    camera = choose_camera(builder, file, sidecar)
    _, name = apply_lighting(builder, file, sidecar, lighting, builder.cameras[camera].at(0.0))
    return Scene._of(file, builder, camera, name, studio)


def _attach(builder: SceneBuilder, name: str, motion: Motion | None, transform: F64 | None = None) -> None:
    """Give the instances of an object a motion, or transform them."""
    for index in builder.groups[name]:
        instance = builder.instances[index]
        if instance.moves:
            raise SceneError(f"{instance.name!r} moves already", name, "expected an object without a motion of its own")
        placed = instance.transform if transform is None else transform @ instance.transform
        builder.instances[index] = replace(instance, motion=motion, transform=placed)


def _transform(matrix: ArrayLike, name: str) -> F64:
    expected = "expected an affine matrix of the shape (4, 4)"
    values = read_array(matrix, f"{name}: transform", expected)
    if values.shape != (4, 4) or not np.isfinite(values).all() or not np.array_equal(values[3], (0, 0, 0, 1)):
        raise SceneError("bad transform", name, expected)
    values.flags.writeable = False
    return values
