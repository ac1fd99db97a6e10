"""glTF and GLB files -> ``SceneBuilder``."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from trimesh.util import triangle_strips_to_faces

from app.arrays import F64, Ints
from app.load.geometry import RawMesh, add_alpha
from app.load.gltf_file import GltfFile, open_gltf
from app.load.gltf_materials import DEFAULT, MaterialReader
from app.load.scene_builder import MAX_COORDINATE, SceneBuilder, color, vector
from app.math3d import affine_matrix, quaternion_matrices
from app.scene import Camera, CameraPath, DirectionalLight, Light, PointLight, SpotLight

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_SUPPORTED_EXTENSIONS = {"KHR_lights_punctual", "KHR_materials_emissive_strength", "KHR_texture_transform",
                         "EXT_mesh_gpu_instancing", "KHR_mesh_quantization", "EXT_texture_webp"}


def read_gltf(path: Path, builder: SceneBuilder) -> None:
    """Fill ``builder`` from a glTF or GLB file."""
    _Reader(open_gltf(path), builder).run()


class _Reader:
    def __init__(self, file: GltfFile, builder: SceneBuilder) -> None:
        self._file, self._builder = file, builder
        self._uv_sets: list[int] = []
        self._meshes: dict[int, list[int]] = {}

    def run(self) -> None:
        for name in sorted(set(self._file.json.get("extensionsRequired", [])) - _SUPPORTED_EXTENSIONS):
            self._builder.notice(f"the file requires the extension {name}, which is not supported")
        if "animations" in self._file.json:
            self._builder.notice("the animations of the file are ignored")
        materials = MaterialReader(self._file, self._builder)
        for index, spec in enumerate(self._file.items("materials")):
            material, uv_set = materials.read(spec, index)
            self._builder.materials.append(material)
            self._uv_sets.append(uv_set)
        self._builder.materials.append(DEFAULT)
        self._uv_sets.append(0)
        for index, world, names in self._nodes():
            self._visit(index, world, names)

    def _nodes(self) -> Iterator[tuple[int, F64, tuple[str, ...]]]:
        """Every node of the scene with its world matrix, and its own name and those of its ancestors."""
        nodes = self._file.items("nodes")
        scenes = self._file.items("scenes")
        if scenes:
            roots = scenes[self._file.json.get("scene", 0)].get("nodes", [])
        else:
            children = {c for n in nodes for c in n.get("children", [])}
            roots = [i for i in range(len(nodes)) if i not in children]
        stack: list[tuple[int, F64, tuple[str, ...]]] = [(i, np.eye(4), ()) for i in reversed(roots)]
        seen: set[int] = set()
        while stack:
            index, parent, ancestors = stack.pop()
            if index in seen:
                raise ValueError(f"node {index} has two parents or is its own ancestor")
            seen.add(index)
            node = nodes[index]
            world = parent @ _local(node)
            names = (node.get("name") or f"node {index}", *ancestors)
            yield index, world, names
            stack += [(c, world, names) for c in reversed(node.get("children", []))]

    def _visit(self, index: int, world: F64, names: tuple[str, ...]) -> None:
        node = self._file.json["nodes"][index]
        extensions = node.get("extensions", {})
        if "camera" in node:
            self._camera(self._file.json["cameras"][node["camera"]], node.get("name"), world)
        if "KHR_lights_punctual" in extensions:
            lights = self._file.json["extensions"]["KHR_lights_punctual"]["lights"]
            self._builder.lights.append(self._light(lights[extensions["KHR_lights_punctual"]["light"]], world))
        if "mesh" not in node:
            return
        if "skin" in node:
            self._builder.notice(f"{names[0]!r} is skinned, which is not supported: it is drawn in its rest pose")
        if "EXT_mesh_gpu_instancing" in extensions:
            local = self._instance_matrices(extensions["EXT_mesh_gpu_instancing"]["attributes"])
        else:
            local = np.eye(4)[None]
        for mesh in self._mesh(node["mesh"]):
            for matrix in local:
                self._builder.add_instance(names[0], mesh, world @ matrix, names)

    def _mesh(self, index: int) -> list[int]:
        """Indices into ``builder.meshes`` of a mesh's visible primitives; each mesh is read once."""
        if index not in self._meshes:
            spec = self._file.json["meshes"][index]
            indices = [self._primitive(p, spec.get("name", f"mesh {index}")) for p in spec["primitives"]]
            self._meshes[index] = [i for i in indices if i is not None]
        return self._meshes[index]

    def _primitive(self, spec: dict[str, Any], name: str) -> int | None:
        mode, attributes = spec.get("mode", _TRIANGLES), spec.get("attributes", {})
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            self._builder.notice("point clouds and lines are omitted")
            return None
        if "KHR_draco_mesh_compression" in spec.get("extensions", {}) or "POSITION" not in attributes:
            self._builder.notice(f"{name!r}: geometry without readable positions is omitted")
            return None
        default = len(self._uv_sets) - 1  # comes after the materials of the file
        material = spec.get("material")
        if material is None:
            material = default
        elif not 0 <= material < default:
            raise IndexError(f"no material {material}")
        positions = self._file.accessor(attributes["POSITION"]).astype(np.float64)
        order = self._file.accessor(spec["indices"])[:, 0] if "indices" in spec else np.arange(len(positions))
        uvs = self._attribute(attributes, f"TEXCOORD_{self._uv_sets[material]}", len(positions))
        raw = RawMesh(
            positions=positions,
            triangles=_triangulate(order.astype(np.int64), mode),
            normals=self._attribute(attributes, "NORMAL", len(positions)),
            uvs=None if uvs is None else np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], axis=1),
            colors=add_alpha(self._attribute(attributes, "COLOR_0", len(positions))),
        )
        return self._builder.add_mesh(name, raw, material)

    def _attribute(self, attributes: dict[str, int], key: str, count: int) -> F64 | None:
        if key not in attributes:
            return None
        values: F64 = self._file.accessor(attributes[key]).astype(np.float64)
        if len(values) != count:
            raise ValueError(f"{key} has {len(values)} values for {count} vertices")
        return values

    def _instance_matrices(self, attributes: dict[str, int]) -> F64:
        """Matrices of EXT_mesh_gpu_instancing, shape (N, 4, 4)."""
        values = {k: self._file.accessor(v).astype(np.float64) for k, v in attributes.items()
                  if k in ("TRANSLATION", "ROTATION", "SCALE")}
        count = min((len(v) for v in values.values()), default=0)
        matrices = np.tile(np.eye(4), (count, 1, 1))
        if "ROTATION" in values:
            matrices[:, :3, :3] = quaternion_matrices(values["ROTATION"][:count])
        if "SCALE" in values:
            matrices[:, :3, :3] *= values["SCALE"][:count, None, :]
        if "TRANSLATION" in values:
            matrices[:, :3, 3] = values["TRANSLATION"][:count]
        return matrices

    def _camera(self, spec: dict[str, Any], node_name: str | None, world: F64) -> None:
        name = node_name or spec.get("name") or f"camera {len(self._builder.cameras)}"
        if "perspective" not in spec:
            self._builder.notice(f"camera {name!r} is orthographic and is ignored")
            return
        fov = math.degrees(float(spec["perspective"]["yfov"]))
        if not 0 < fov < 180:
            self._builder.notice(f"camera {name!r} has a field of view of {fov:g} degrees and is ignored")
            return
        forward, up = _direction(world, (0, 0, -1)), _direction(world, (0, 1, 0))
        eye = _translation(world)
        self._builder.cameras[name] = CameraPath.still(Camera(
            eye=vector(eye), target=vector(eye + forward), up=vector(up), fov_y_deg=fov))

    def _light(self, spec: dict[str, Any], world: F64) -> Light:
        power = color(np.asarray(spec.get("color", (1, 1, 1)), np.float64) * spec.get("intensity", 1.0))
        position, direction = vector(_translation(world)), vector(_direction(world, (0, 0, -1)))
        if "range" in spec:
            self._builder.notice("the range of lights is ignored: their light falls off with squared distance only")
        if spec["type"] == "directional":
            return DirectionalLight(direction, power)
        if spec["type"] == "spot":
            cone = spec.get("spot", {})
            outer = min(max(math.degrees(cone.get("outerConeAngle", math.pi / 4)), 0.0), 90.0)
            inner = min(max(math.degrees(cone.get("innerConeAngle", 0.0)), 0.0), outer)
            return SpotLight(position, direction, power, inner, outer)
        if spec["type"] == "point":
            return PointLight(position, power)
        raise ValueError(f"unknown light type {spec['type']!r}")


def _local(node: dict[str, Any]) -> F64:
    if "matrix" in node:
        return np.asarray(node["matrix"], np.float64).reshape(4, 4).T
    rotation = quaternion_matrices(np.asarray([node.get("rotation", (0, 0, 0, 1))], np.float64))[0]
    scale = np.asarray(node.get("scale", (1, 1, 1)), np.float64)
    return affine_matrix(rotation * scale, node.get("translation", (0, 0, 0)))


def _translation(world: F64) -> F64:
    position = world[:3, 3]
    if not np.abs(position).max() < MAX_COORDINATE:
        raise ValueError(f"a camera or light has a coordinate beyond {MAX_COORDINATE:g}")
    return position


def _direction(world: F64, local: tuple[float, float, float]) -> F64:
    direction = world[:3, :3] @ np.asarray(local, np.float64)
    length = float(np.linalg.norm(direction))
    if not length > 0:
        raise ValueError("a camera or light has a parent node of scale 0")
    return direction / length


def _triangulate(order: Ints, mode: int) -> Ints:
    if mode == _STRIP:
        return np.asarray(triangle_strips_to_faces([order]), np.int64).reshape(-1, 3)
    if mode == _FAN:
        return np.stack([np.full(max(len(order) - 2, 0), order[0]), order[1:-1], order[2:]], axis=1)
    return order[:len(order) // 3 * 3].reshape(-1, 3)
