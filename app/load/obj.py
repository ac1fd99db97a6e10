"""Wavefront OBJ files -> ``SceneBuilder``, through trimesh.

trimesh skips lines whose keyword is followed by a tab, counts relative indices from the end of the file and quantises
colours, so the text is normalised first and the materials are read in ``mtl.py``.
"""

import io
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mapbox_earcut import triangulate_float64
from trimesh.exchange.obj import load_obj

from app.arrays import F64, Ints
from app.io.image import srgb_decode
from app.load.geometry import RawMesh, add_alpha, face_vectors, with_creases
from app.load.mtl import read_mtl
from app.load.scene_builder import SceneBuilder
from app.scene import Material

_MAX_OBJECTS = 64  # names; a file with more is one object
_CREASE_DEG = 40.0  # between triangles, from which on edges are sharp where the file gives neither normals nor groups
_FLAT_GROUPS = "off", "0"


def read_obj(path: Path, builder: SceneBuilder) -> None:
    """Fill ``builder`` from an OBJ file and the MTL files that it names."""
    data = path.read_bytes()
    if b"\0" in data:
        raise ValueError("it is not text")
    text = _normalize(data.decode("utf-8", errors="replace"))
    materials: dict[str, Material] = {}
    for name in re.findall(r"^mtllib (.+)$", text, re.MULTILINE):
        materials |= read_mtl(path.parent, name, builder)
    if re.search(r"^[lp] ", text, re.MULTILINE):
        builder.notice("points and lines are omitted")
    has_normals = re.search(r"^vn ", text, re.MULTILINE) is not None
    has_groups = not has_normals and re.search(r"^s ", text, re.MULTILINE) is not None
    text, parts = _number_parts(text, path.stem, has_groups)
    if re.search(r"^f (.* )?0+[/ \n]", text, re.MULTILINE):
        raise ValueError("a face has the vertex 0, but the first one has the number 1")
    if re.search(r"^f .*-\d", text, re.MULTILINE):
        text = "\n".join(_make_absolute(text))

    indices: dict[str, int] = {}
    # With this MTL file, trimesh keeps the numbers of the parts as material names.
    numbers = "\n".join(f"newmtl {i}" for i in range(len(parts)))
    try:
        content = load_obj(io.StringIO(text), resolver={"parts": numbers})
    except IndexError as error:
        raise ValueError("a face has a vertex, normal or uv that the file does not list") from error
    except ValueError as error:
        raise ValueError("a line of numbers can't be read") from error
    for geometry in content.get("geometry", {}).values():
        name, material, group = parts[int(geometry["visual"].material.name)]
        if material not in indices:
            indices[material] = len(builder.materials)
            builder.materials.append(materials.get(material) or _default_material(material, builder))
        raw = _triangulate(geometry)
        if raw.normals is None and group not in _FLAT_GROUPS:
            raw = with_creases(raw, math.pi if group else math.radians(_CREASE_DEG))
        mesh = builder.add_mesh(name, raw, indices[material])
        if mesh is not None:
            builder.add_instance(name, mesh, np.eye(4))


def _normalize(text: str) -> str:
    """Single spaces between words, none at the ends of lines, and no comments or continued lines."""
    text = re.sub(r"\\\r?\n", " ", text)
    text = re.sub(r"[ \t\r\f\v]+", " ", text)
    text = re.sub(r"^ | $", "", text, flags=re.MULTILINE)
    return re.sub(r"^#.*\n", "", text + "\n", flags=re.MULTILINE)


def _number_parts(text: str, stem: str, has_groups: bool) -> tuple[str, list[tuple[str, str, str]]]:
    """Replace lines of objects, materials and smoothing groups, if the file ``has_groups``, by the number of a part.

    Also return the object, material and smoothing group of each part.
    """
    named = len(set(re.findall(r"^[og] (.+)$", text, re.MULTILINE))) <= _MAX_OBJECTS
    parts: dict[tuple[str, str, str], int] = {}
    current = [stem, "", "off" if has_groups else ""]

    def number(match: re.Match[str]) -> str:
        key, value = match[1], match[2]
        if key == "usemtl":
            current[1] = value
        elif key == "s":
            current[2] = value if has_groups else ""
        elif named:
            current[0] = value
        return f"usemtl {parts.setdefault((current[0], current[1], current[2]), len(parts))}"

    start = f"usemtl {parts.setdefault((stem, '', current[2]), 0)}\n"
    body = re.sub(r"^(o|g|usemtl|s) (.+)$", number, re.sub(r"^mtllib .*$", "", text, flags=re.MULTILINE),
                  flags=re.MULTILINE)
    return f"mtllib parts\n{start}{body}", list(parts)


def _make_absolute(text: str) -> Iterator[str]:
    """The lines of the file with relative indices made absolute."""
    counts = {"v": 0, "vt": 0, "vn": 0}
    for line in text.split("\n"):
        key, _, rest = line.partition(" ")
        if key in counts:
            counts[key] += 1
        elif key == "f" and "-" in rest:
            line = "f " + " ".join(_absolute_corner(corner, counts) for corner in rest.split())
        yield line


def _absolute_corner(corner: str, counts: dict[str, int]) -> str:
    return "/".join(str(int(i) + count + 1) if i.startswith("-") else i
                    for i, count in zip(corner.split("/"), counts.values(), strict=False))


def _default_material(name: str, builder: SceneBuilder) -> Material:
    if not name:
        return Material(double_sided=False)
    builder.notice(f"material {name!r} is not defined, so the default material is used")
    return Material(name=name, double_sided=False)


def _triangulate(geometry: dict[str, Any]) -> RawMesh:
    """The content that trimesh read, whose faces are polygons of equal length, as triangles."""
    positions, faces = np.asarray(geometry["vertices"], np.float64), np.asarray(geometry["faces"], np.int64)
    colors = _per_vertex(geometry.get("vertex_colors"), positions, 3)
    return RawMesh(
        positions=positions,
        triangles=_cut_polygons(positions, faces),
        normals=_per_vertex(geometry.get("vertex_normals"), positions, 3),
        uvs=_per_vertex(geometry["visual"].uv, positions, 2),
        colors=None if colors is None else add_alpha(srgb_decode(colors)),
    )


@np.errstate(over="ignore", invalid="ignore")
def _cut_polygons(positions: F64, faces: Ints) -> Ints:
    """Triangles, shape (T, 3), of polygons with as many corners each, shape (N, corners): fans, if they are convex."""
    count = faces.shape[1]
    fans = faces[:, [corner for i in range(1, count - 1) for corner in (0, i, i + 1)]].reshape(-1, count - 2, 3)
    if count == 3:
        return fans.reshape(-1, 3)
    normals = face_vectors(positions, fans.reshape(-1, 3)).reshape(-1, count - 2, 3)
    around = [[(i - 1) % count, i, (i + 1) % count] for i in range(count)]
    turns = face_vectors(positions, faces[:, around].reshape(-1, 3)).reshape(-1, count, 3)
    is_concave = (np.einsum("nkc,nc->nk", turns, normals.sum(axis=1)) < 0).any(axis=1)
    cut = [_cut_concave(positions, polygon, normal)
           for polygon, normal in zip(faces[is_concave], normals[is_concave].sum(axis=1), strict=True)]
    return np.concatenate([fans[~is_concave].reshape(-1, 3), *cut])


def _cut_concave(positions: F64, polygon: Ints, normal: F64) -> Ints:
    """The triangles of one polygon, shape (T, 3), which face along its ``normal``."""
    axis = int(np.abs(normal).argmax())  # along which the polygon is seen
    flat = np.ascontiguousarray(positions[polygon][:, [(axis + 1) % 3, (axis + 2) % 3]])
    cut = triangulate_float64(flat, np.array([len(polygon)], np.uint32)).astype(np.int64).reshape(-1, 3)
    return polygon[cut if normal[axis] > 0 else cut[:, ::-1]]


def _per_vertex(values: Any, positions: F64, width: int) -> F64 | None:
    if values is None or np.shape(values) != (len(positions), width):
        return None
    return np.asarray(values, np.float64)
