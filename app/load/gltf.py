"""glTF and GLB files -> ``SceneBuilder``."""

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from trimesh.util import triangle_strips_to_faces

from app.animation.deformation import Deformation
from app.animation.node_tree import NodePlacement
from app.arrays import F64, Bools, Ints
from app.load.geometry import RawMesh, add_alpha
from app.load.gltf_animation import local_matrix, read_poses
from app.load.gltf_deformation import DeformationReader
from app.load.gltf_file import GltfFile, open_gltf
from app.load.gltf_materials import DEFAULT, MATERIAL_EXTENSIONS, MaterialReader, read_variant
from app.load.gltf_vertices import UsedVertices
from app.load.photometry import LUMENS_PER_WATT, are_photometric, to_radiometric
from app.load.scene_builder import MAX_COORDINATE, MAX_INSTANCES, SceneBuilder, color, vector
from app.load.tangents import with_tangents
from app.math3d import quaternion_matrices
from app.scene import Camera, CameraPath, DirectionalLight, Light, PointLight, SpotLight, bounds_of, unit_columns

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_SUPPORTED_EXTENSIONS = MATERIAL_EXTENSIONS | {
    "KHR_lights_punctual", "EXT_mesh_gpu_instancing", "KHR_mesh_quantization", "KHR_draco_mesh_compression",
    "EXT_meshopt_compression", "KHR_texture_basisu"}

_OUT_OF_REACH = f"has a coordinate that is no number, or beyond {MAX_COORDINATE:g}"


def read_gltf(path: Path, builder: SceneBuilder) -> None:
    """Fill ``builder`` from a glTF or GLB file."""
    _Reader(open_gltf(path), builder).run()


@contextmanager
def _within(kind: str, index: int, spec: Any) -> Iterator[None]:
    """Note in what part of the file an error was met."""
    try:
        yield
    except Exception as error:
        name = spec.get("name") if isinstance(spec, dict) else None
        error.add_note(f"in {kind} {index}" + (f" ({name!r})" if name else ""))
        raise


class _Reader:
    def __init__(self, file: GltfFile, builder: SceneBuilder) -> None:
        self._file, self._builder = file, builder
        self._materials = MaterialReader(file, builder)
        self._uv_sets: list[tuple[int, ...]] = []
        self._variant: int | None = None
        self._meshes: dict[int, list[int]] = {}
        self._repeated: Counter[str] = Counter()  # names of cameras
        self._given_names = {part.get("name") for key in ("nodes", "cameras") for part in file.items(key)}
        self._is_animated = "animations" in file.json
        self._poses = read_poses(file, builder)
        self._deformations = DeformationReader(file, builder, self._poses)

    def run(self) -> None:
        required = set(self._file.json.get("extensionsRequired", []))
        for name in sorted(required - _SUPPORTED_EXTENSIONS):
            self._builder.notice(f"the file requires the extension {name}, which is not supported")
        for name in sorted(set(self._file.json.get("extensionsUsed", [])) - required - _SUPPORTED_EXTENSIONS):
            self._builder.notice(f"the extension {name} is ignored")
        variants = self._file.json.get("extensions", {}).get("KHR_materials_variants", {}).get("variants", [])
        self._builder.variants = [str(v["name"]) for v in variants]
        if self._builder.variant in self._builder.variants:
            self._variant = self._builder.variants.index(self._builder.variant)
        for index, spec in enumerate(self._file.items("materials")):
            with _within("material", index, spec):
                material, uv_sets = self._materials.read(spec, index)
            self._builder.materials.append(material)
            self._uv_sets.append(uv_sets)
        self._builder.materials.append(DEFAULT)
        self._uv_sets.append(())
        for index, world, names in self._nodes():
            with _within("node", index, self._file.items("nodes")[index]):
                self._visit(index, self._poses.tree.world_at(0.0)[index] if self._is_animated else world, names)
        self._convert_lights()

    def _convert_lights(self) -> None:
        """Take lights as candela and lux where they would burn out the scene as W/sr and W/m²."""
        builder = self._builder
        if are_photometric(builder.lights, bounds_of(tuple(builder.meshes), tuple(builder.instances))):
            builder.lights = [to_radiometric(light) for light in builder.lights]
            builder.notice(f"the file's lights are in candela and lux: {LUMENS_PER_WATT:g} of them count as 1 W/sr or "
                           "W/m² (exposure brightens the picture)")

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
            world = parent @ local_matrix(node)
            names = (node.get("name") or f"node {index}", *ancestors)
            yield index, world, names
            stack += [(c, world, names) for c in reversed(node.get("children", []))]

    def _visit(self, index: int, world: F64, names: tuple[str, ...]) -> None:
        node = self._file.json["nodes"][index]
        extensions = node.get("extensions", {})
        if "camera" in node:
            self._camera(self._file.json["cameras"][node["camera"]], node.get("name"), index, world)
        if "KHR_lights_punctual" in extensions:
            lights = self._file.json["extensions"]["KHR_lights_punctual"]["lights"]
            light = self._light(lights[extensions["KHR_lights_punctual"]["light"]], world)
            if light is not None:
                self._builder.lights.append(light)
            if self._poses.tree.moves[index]:
                self._builder.notice("lights of animated nodes stay where they are at time 0")
        if "mesh" not in node:
            return
        if "EXT_mesh_gpu_instancing" in extensions:
            local = self._instance_matrices(extensions["EXT_mesh_gpu_instancing"]["attributes"])
        else:
            local = np.eye(4)[None]
        primitives = self._file.json["meshes"][node["mesh"]]["primitives"]
        if "skin" not in node and not any("targets" in p for p in primitives):
            for mesh in self._mesh(node["mesh"]):
                self._place(index, mesh, world, local, names)
            return
        for mesh, deformation in self._deformed_meshes(index, node):
            moving = deformation if deformation.moves else None
            if deformation.skin is not None:  # by its joints alone, wherever its own node is
                self._builder.add_instance(names[0], mesh, np.eye(4), names, deformation=moving)
            else:
                self._place(index, mesh, world, local, names, moving)

    def _place(self, index: int, mesh: int, world: F64, local: F64, names: tuple[str, ...],
               deformation: Deformation | None = None) -> None:
        """Add an instance of a mesh at node ``index`` for each matrix of ``local``, shape (N, 4, 4)."""
        for matrix in local:
            placement = NodePlacement(self._poses.tree, index, matrix) if self._poses.tree.moves[index] else None
            self._builder.add_instance(names[0], mesh, world @ matrix, names, placement, deformation)

    def _deformed_meshes(self, index: int, node: dict[str, Any]) -> Iterator[tuple[int, Deformation]]:
        """Indices into ``builder.meshes`` of a node's visible primitives in their shape at time 0."""
        spec = self._file.json["meshes"][node["mesh"]]
        for primitive in spec["primitives"]:
            name = spec.get("name", f"mesh {node['mesh']}")
            content = self._read_primitive(primitive, name)
            if content is None:
                continue
            raw, material, used = content
            deformation = self._deformations.read(node, index, primitive, raw, used)
            has_normals = raw.normals is not None
            raw = with_tangents(replace(raw, source=np.arange(len(raw.positions))), self._builder.materials[material])
            assert raw.source is not None
            deformation = deformation.select(raw.source, np.zeros(3)).with_tangents(raw.tangents)
            vertices, skin = deformation.vertices_at(0.0), deformation.skin
            mesh = self._builder.add_mesh(name, replace(
                raw, triangles=raw.triangles if skin is None else _face_outwards(raw.triangles, skin.is_mirrored(0.0)),
                positions=vertices.positions, normals=vertices.normals if has_normals else None,
                tangents=vertices.tangents, source=np.arange(len(raw.source)) if deformation.moves else None), material)
            if mesh is not None:
                yield mesh, deformation

    def _mesh(self, index: int) -> list[int]:
        """Indices into ``builder.meshes`` of a mesh's visible primitives; each mesh is read once."""
        if index not in self._meshes:
            spec = self._file.json["meshes"][index]
            indices = [self._primitive(p, spec.get("name", f"mesh {index}")) for p in spec["primitives"]]
            self._meshes[index] = [i for i in indices if i is not None]
        return self._meshes[index]

    def _primitive(self, spec: dict[str, Any], name: str) -> int | None:
        content = self._read_primitive(spec, name)
        return None if content is None else self._builder.add_mesh(name, *content[:2])

    def _read_primitive(self, spec: dict[str, Any], name: str) -> tuple[RawMesh, int, UsedVertices] | None:
        """A primitive with the index of its material and the reader of its vertices; None if it can't be drawn."""
        mode, attributes = spec.get("mode", _TRIANGLES), spec.get("attributes", {})
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            self._builder.notice("point clouds and lines are omitted")
            return None
        if "POSITION" not in attributes:
            self._builder.notice(f"{name!r}: geometry without readable positions is omitted")
            return None
        default = len(self._uv_sets) - 1  # comes after the materials of the file
        material = read_variant(spec, self._variant)
        if material is None:
            material = default
        elif not 0 <= material < default:
            raise IndexError(f"no material {material}")
        used = UsedVertices(self._file, spec)

        def read(key: str, *widths: int) -> F64 | None:
            return used.read(key, attributes[key], *widths) if key in attributes else None

        first, second = (*self._uv_sets[material], None, None)[:2]
        colors = add_alpha(read("COLOR_0", 3, 4))
        if colors is not None and (colors[:, 3] < 1).any():
            self._materials.apply_vertex_alpha(material)
        return RawMesh(
            positions=used.read("POSITION", attributes["POSITION"], 3),
            triangles=_triangulate(used.order, mode),
            normals=read("NORMAL", 3),
            uvs=_flip_v(read(f"TEXCOORD_{first}", 2)),
            colors=colors,
            second_uvs=_flip_v(read(f"TEXCOORD_{second}", 2)),
            tangents=read("TANGENT", 4),
        ), material, used

    def _instance_matrices(self, attributes: dict[str, int]) -> F64:
        """Matrices of EXT_mesh_gpu_instancing, shape (N, 4, 4)."""
        values = {k: self._file.accessor(v).astype(np.float64) for k, v in attributes.items()
                  if k in ("TRANSLATION", "ROTATION", "SCALE")}
        count = min((len(v) for v in values.values()), default=0)
        count = min(count, MAX_INSTANCES + 1)  # the builder refuses that one
        matrices = np.tile(np.eye(4), (count, 1, 1))
        if "ROTATION" in values:
            matrices[:, :3, :3] = quaternion_matrices(values["ROTATION"][:count])
        if "SCALE" in values:
            matrices[:, :3, :3] *= values["SCALE"][:count, None, :]
        if "TRANSLATION" in values:
            matrices[:, :3, 3] = values["TRANSLATION"][:count]
        return matrices

    def _camera(self, spec: dict[str, Any], node_name: str | None, index: int, world: F64) -> None:
        cameras = self._builder.cameras
        name = node_name or spec.get("name") or f"camera {len(cameras)}"
        if name in cameras:  # names need not be unique
            self._repeated[name] += 1
            numbers = count(1 + self._repeated[name])
            name = next(other for number in numbers
                        if (other := f"{name} {number}") not in cameras and other not in self._given_names)
        camera = self._lens(spec, name)
        if camera is None:
            return
        if not _is_in_reach(world):
            self._builder.notice(f"camera {name!r} {_OUT_OF_REACH}, and is ignored")
            return
        if self._poses.tree.moves[index] and self._poses.period > 0:
            cameras[name] = CameraPath((0.0,), (camera,), NodePlacement(self._poses.tree, index, np.eye(4)))
        else:
            cameras[name] = CameraPath.still(camera.placed(world))

    def _lens(self, spec: dict[str, Any], name: str) -> Camera | None:
        """A camera of the file's projection, anywhere; None for one that can't be drawn."""
        camera = Camera(eye=(0, 0, 0), target=(0, 0, -1))
        if spec["type"] == "orthographic":
            height = 2 * abs(float(spec["orthographic"]["ymag"]))
            if not 0 < height < MAX_COORDINATE:
                self._builder.notice(f"camera {name!r} has a height of {height:g} and is ignored")
                return None
            return replace(camera, orthographic_height=height)
        fov = math.degrees(float(spec["perspective"]["yfov"]))
        if not 0 < fov < 180:
            self._builder.notice(f"camera {name!r} has a field of view of {fov:g} degrees and is ignored")
            return None
        return replace(camera, fov_y_deg=fov)

    def _light(self, spec: dict[str, Any], world: F64) -> Light | None:
        """A light; None for one without a direction."""
        kind = spec["type"]
        power = color(np.asarray(spec.get("color", (1, 1, 1)), np.float64) * spec.get("intensity", 1.0))
        if not _is_in_reach(world):
            raise ValueError(f"light {spec.get('name', kind)!r} {_OUT_OF_REACH}")
        position, axes = vector(world[:3, 3]), unit_columns(world[:3, :3])
        if "range" in spec:
            self._builder.approximation("KHR_lights_punctual: lights reach beyond their range, with squared distance")
        if kind == "point":
            return PointLight(position, power)
        if kind not in ("directional", "spot"):
            raise ValueError(f"unknown light type {kind!r}")
        if axes is None:
            self._builder.notice("lights of nodes of scale 0 have no direction and are omitted")
            return None
        direction = vector(-axes[:, 2])
        if kind == "directional":
            return DirectionalLight(direction, power)
        self._builder.approximation("KHR_lights_punctual: spots fade linearly in angle between their two cones")
        cone = spec.get("spot", {})
        # In this order, max gives 0 for an angle that is not a number.
        outer = min(max(0.0, math.degrees(cone.get("outerConeAngle", math.pi / 4))), 90.0)
        inner = min(max(0.0, math.degrees(cone.get("innerConeAngle", 0.0))), outer)
        return SpotLight(position, direction, power, inner, outer)


def _is_in_reach(world: F64) -> bool:
    """Whether a node's place, in its matrix to world space, is one of numbers that can be computed with."""
    return bool(np.abs(world[:3, 3]).max() < MAX_COORDINATE)


def _flip_v(uvs: F64 | None) -> F64 | None:
    """Texture coordinates with v upwards."""
    return None if uvs is None else np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], axis=1)


def _face_outwards(triangles: Ints, is_mirrored: Bools) -> Ints:
    """Triangles, shape (T, 3), turned over where most of their vertices are mirrored, shape (V,)."""
    valid = (triangles < len(is_mirrored)).all(axis=1)  # others are an error later
    turn = np.zeros(len(triangles), np.bool_)
    turn[valid] = is_mirrored[triangles[valid]].sum(axis=1) > 1
    return np.where(turn[:, None], triangles[:, ::-1], triangles)


def _triangulate(order: Ints, mode: int) -> Ints:
    if mode == _STRIP:
        return np.asarray(triangle_strips_to_faces([order]), np.int64).reshape(-1, 3)
    if mode == _FAN:
        return np.stack([np.full(max(len(order) - 2, 0), order[0]), order[1:-1], order[2:]], axis=1)
    return order[:len(order) // 3 * 3].reshape(-1, 3)
