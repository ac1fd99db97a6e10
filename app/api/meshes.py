"""What ``Scene.add`` takes: arrays, trimesh objects and files, as parts of a scene that is under construction."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from app.api.checked import check_material, read_array
from app.arrays import F64
from app.errors import SceneError
from app.io.image import srgb_decode
from app.load.geometry import RawMesh, add_alpha, clean, smooth_normals
from app.load.gltf import read_gltf
from app.load.gltf_materials import DEFAULT as GLTF_DEFAULT
from app.load.scene import read_scene
from app.load.scene_builder import SceneBuilder
from app.load.tangents import with_tangents
from app.scene import Material, Mesh


def build_part(mesh: Any, name: str, material: Material | None, smooth: bool, attributes: dict[str, ArrayLike]
               ) -> SceneBuilder:
    """The meshes, materials and instances of what ``Scene.add`` was given.

    Raises
    ------
    SceneError
        When it is none of what is expected, or has no triangle with an area.
    """
    is_arrays = isinstance(mesh, Sequence) and len(mesh) == 2 and not isinstance(mesh, str)
    if attributes and not is_arrays:
        raise SceneError(f"{', '.join(attributes)} given with a {type(mesh).__name__}", name,
                         "expected them with (vertices, triangles) only")
    if material is not None:
        material = check_material(material, name)
    if isinstance(mesh, str | Path):
        part = read_scene(Path(mesh))[0]
    elif hasattr(mesh, "export"):
        part = _from_trimesh(mesh, name, smooth)
    elif is_arrays:
        part = _from_arrays(mesh[0], mesh[1], name, material or Material(), smooth, attributes)
    else:
        raise SceneError(f"can't add a {type(mesh).__name__}", name,
                         "expected (vertices, triangles), a trimesh object or the path of a scene file")
    if not part.instances:
        raise SceneError("no triangle to draw", name, "expected at least one triangle with an area")
    if material is not None:
        _replace_materials(part, material, name)
    return part


def merge(part: SceneBuilder, transform: F64, name: str, builder: SceneBuilder) -> None:
    """Add what ``part`` holds to ``builder``, in world space after ``transform``, as one object."""
    meshes, materials = len(builder.meshes), len(builder.materials)
    builder.materials += part.materials
    builder.meshes += [replace(mesh, material=mesh.material + materials) for mesh in part.meshes]
    builder.groups[name] = list(range(len(builder.instances), len(builder.instances) + len(part.instances)))
    builder.instances += [replace(i, name=name if len(part.instances) == 1 else f"{name}.{i.name}",
                                  mesh=i.mesh + meshes, transform=transform @ i.transform) for i in part.instances]


def _from_trimesh(mesh: Any, name: str, smooth: bool) -> SceneBuilder:
    """A ``trimesh.Trimesh`` or ``trimesh.Scene`` by way of glTF, which has its textures and colours."""
    builder = SceneBuilder(name)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "mesh.glb"
        try:
            _prepare_for_gltf(mesh).export(str(file), include_normals=smooth)
            read_gltf(file, builder)
        except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
            raise SceneError(f"can't read the mesh ({error})", name, "expected a trimesh object with triangles"
                             ) from error
    _replace_default_material(builder)
    return builder


def _prepare_for_gltf(mesh: Any) -> Any:
    """A copy of ``mesh`` that glTF does not change.

    Its colours of faces belong to vertices of their own, else they would be averaged at shared ones; and it has
    dielectric materials in place of those of OBJ files, which would become metals.
    """
    mesh = mesh.copy()
    for part in getattr(mesh, "geometry", {"": mesh}).values():
        visual: Any = getattr(part, "visual", None)
        if getattr(visual, "kind", None) == "face":
            normals = part.vertex_normals[part.faces.reshape(-1)]
            part.unmerge_vertices()
            part.vertex_normals = normals
        material: Any = getattr(visual, "material", None)
        if isinstance(material, trimesh.visual.material.SimpleMaterial):
            part.visual.material = material.to_pbr()  # type: ignore[no-untyped-call]
            part.visual.material.metallicFactor = 0.0
            if material.image is not None and np.array_equal(material.diffuse, trimesh.visual.color.DEFAULT_COLOR):
                part.visual.material.baseColorFactor = None  # what trimesh has for no colour would darken the image
    return mesh


def _replace_materials(part: SceneBuilder, material: Material, name: str) -> None:
    """Give all meshes ``material``, and tangents where it has a normal map."""
    uv_sets = {texture.uv_set for texture in material.maps.values()}
    for mesh in part.meshes:
        if (0 in uv_sets and mesh.uvs is None) or (1 in uv_sets and mesh.second_uvs is None):
            raise SceneError("the material has textures, but the mesh has no uvs for them", name,
                             "expected uvs, or a material without textures")
    part.materials = [material] * len(part.materials)
    if material.maps.keys() & {"normal_map", "clearcoat_normal_map"}:
        if any(instance.deformation is not None for instance in part.instances):
            raise SceneError("a normal map can't be put on a mesh that deforms", name,
                             "expected a material without a normal map")
        part.meshes = [mesh if mesh.tangents is not None else _add_tangents(mesh, material) for mesh in part.meshes]


def _add_tangents(mesh: Mesh, material: Material) -> Mesh:
    normals = mesh.normals.astype(np.float64) if mesh.normals.any() else None  # zeros: flat faces
    rows: dict[str, Any] = {key: None if values is None else values.astype(np.float64) for key, values in (
        ("uvs", mesh.uvs), ("second_uvs", mesh.second_uvs), ("colors", mesh.colors))}
    raw = RawMesh(mesh.positions.astype(np.float64), mesh.triangles.astype(np.int64), normals, **rows)
    cleaned = clean(with_tangents(raw, material))
    arrays: dict[str, Any] = {key: None if (values := getattr(cleaned, key)) is None else values.astype(np.float32)
                              for key in ("positions", "normals", "uvs", "second_uvs", "colors", "tangents")}
    return replace(mesh, triangles=cleaned.triangles.astype(np.uint32), **arrays)


def _replace_default_material(builder: SceneBuilder) -> None:
    """Give surfaces without a material the renderer's, since glTF's is metallic; their colours are sRGB-encoded."""
    for index, mesh in enumerate(builder.meshes):
        if builder.materials[mesh.material].name != GLTF_DEFAULT.name:
            continue
        material = Material()
        if mesh.colors is not None:
            rgb = srgb_decode(mesh.colors[:, :3])
            mesh = replace(mesh, colors=np.concatenate([rgb, mesh.colors[:, 3:]], axis=1))
            material = Material(albedo=(1.0, 1.0, 1.0))
        builder.materials.append(material)
        builder.meshes[index] = replace(mesh, material=len(builder.materials) - 1)


def _from_arrays(vertices: ArrayLike, triangles: ArrayLike, name: str, material: Material, smooth: bool,
                 attributes: dict[str, ArrayLike]) -> SceneBuilder:
    positions = _rows(vertices, (3,), f"{name}: vertices")
    read_array(triangles, f"{name}: triangles", "expected integers of the shape (T, 3)")
    faces = np.asarray(triangles)
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise SceneError(f"bad triangles of the shape {faces.shape} and type {faces.dtype}", name,
                         "expected integers of the shape (T, 3)")
    faces = faces.astype(np.int64)
    if len(faces) and not (int(faces.min()) >= 0 and int(faces.max()) < len(positions)):
        raise SceneError("a triangle refers to a missing vertex", name, f"expected indices below {len(positions)}")
    widths = {"normals": (3,), "uvs": (2,), "colors": (3, 4)}
    rows = {key: _rows(values, widths[key], f"{name}: {key}", len(positions)) for key, values in attributes.items()}
    if "colors" in rows and not ((rows["colors"] >= 0) & (rows["colors"] <= 1)).all():
        raise SceneError("a colour is out of range", f"{name}: colors", "expected linear numbers from 0 to 1")
    if smooth and "normals" not in rows:
        rows["normals"] = smooth_normals(positions, faces)
    builder = SceneBuilder(name, materials=[material])
    raw = RawMesh(positions, faces, rows.get("normals"), rows.get("uvs"), colors=add_alpha(rows.get("colors")))
    index = builder.add_mesh(name, raw, 0)
    if index is not None:
        builder.add_instance(name, index, np.eye(4))
    return builder


def _rows(values: ArrayLike, widths: tuple[int, ...], where: str, count: int | None = None) -> F64:
    shapes = " or ".join(f"({count if count is not None else 'V'}, {width})" for width in widths)
    rows = read_array(values, where, f"expected numbers of the shape {shapes}")
    if rows.ndim != 2 or rows.shape[1] not in widths or (count is not None and len(rows) != count):
        raise SceneError(f"bad shape {rows.shape}", where, f"expected {shapes}")
    if not np.isfinite(rows).all():
        raise SceneError("a value is not finite", where, "expected finite numbers")
    return rows
