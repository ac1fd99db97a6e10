"""Wavefront OBJ files -> ``SceneBuilder``, through trimesh.

trimesh skips lines whose keyword is followed by a tab, counts relative indices from the end of the file, cuts polygons
into fans where their lengths differ, ignores smoothing groups and quantises colours. So the text is normalised and
sorted first, and the materials are read in ``mtl.py``.
"""

import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mapbox_earcut import triangulate_float64
from trimesh.exchange.obj import load_obj

from app.arrays import F64, Ints
from app.io.image import srgb_decode
from app.load.geometry import RawMesh, add_alpha, face_vectors, join_meshes, with_creases
from app.load.mtl import read_mtl
from app.load.scene_builder import SceneBuilder
from app.scene import Material

_MAX_OBJECTS = 64  # names; a file with more is one object
_CREASE_DEG = 40.0  # between triangles, from which on edges are sharp where the file gives neither normals nor groups
_FLAT_GROUPS = "", "off", "null"  # smoothing groups that are none; 0 is written without its zeros here
_MAX_QUOTED = 60  # characters of a line
_MAX_NAMED = 4  # materials that a notice names
_VERTEX_KEYS = frozenset(("v", "vt", "vn"))


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
    if re.search(r"^f (.* )?0+[/ \n]", text, re.MULTILINE):
        raise ValueError("a face has the vertex 0, but the first one has the number 1")
    if re.search(r"^f .*-\d", text, re.MULTILINE):
        text = "\n".join(_make_absolute(text))
    parts = [part for part in _read_parts(text, path.stem) if len(part.raw.triangles)]
    bare = [part for part in parts if part.raw.normals is None]
    smooth = iter(with_creases([part.raw for part in bare], [part.groups for part in bare],
                               math.radians(_CREASE_DEG)))
    _notice_undefined({part.material for part in parts if part.material} - set(materials), builder)
    indices: dict[str, int] = {}
    for part in parts:
        if part.material not in indices:
            indices[part.material] = len(builder.materials)
            builder.materials.append(materials.get(part.material) or _default_material(part.material))
        raw = next(smooth) if part.raw.normals is None else part.raw
        mesh = builder.add_mesh(part.name, raw, indices[part.material])
        if mesh is not None:
            builder.add_instance(part.name, mesh, np.eye(4))


@dataclass(frozen=True, eq=False)
class _Part:
    """The triangles of one object and material, and the smoothing group of each, or None if the file has none."""

    name: str
    material: str
    raw: RawMesh
    groups: Ints | None


@dataclass(eq=False)
class _Faces:
    """Lines of polygons with as many corners each, and their smoothing groups."""

    lines: list[str] = field(default_factory=list)
    groups: list[int] = field(default_factory=list)


def _read_parts(text: str, stem: str) -> Iterator[_Part]:
    """What trimesh reads of each object and material, cut into triangles."""
    has_groups = re.search(r"^s ", text, re.MULTILINE) is not None
    vertices, faces = _sort_faces(text, stem)
    body = "".join(f"usemtl {i}\n" + "\n".join(f.lines) + "\n" for i, f in enumerate(faces.values()))
    # With this MTL file, trimesh keeps the numbers of what is sorted as material names.
    numbers = "\n".join(f"newmtl {i}" for i in range(len(faces)))
    try:
        content = load_obj(io.StringIO(f"mtllib parts\n{vertices}\n{body}"), resolver={"parts": numbers})
    except IndexError as error:
        raise ValueError("a face has a vertex, normal or uv that the file does not list") from error
    except ValueError as error:
        raise ValueError(_unreadable_line(text)) from error
    keys, lists = list(faces), list(faces.values())
    pieces: dict[tuple[str, str, bool, bool], list[tuple[RawMesh, Ints]]] = {}
    for geometry in content.get("geometry", {}).values():
        number = int(geometry["visual"].material.name)
        raw = _triangulate(geometry)
        name, material, corners = keys[number]
        groups = np.repeat(np.array(lists[number].groups, np.int64), corners - 2)
        if len(groups) != len(raw.triangles):  # trimesh has left something out
            groups = np.zeros(len(raw.triangles), np.int64)
        has = raw.normals is not None, raw.uvs is not None
        pieces.setdefault((name, material, *has), []).append((raw, groups))
    for (name, material, *_), same in pieces.items():
        groups = np.concatenate([groups for _, groups in same])
        yield _Part(name, material, join_meshes([raw for raw, _ in same]), groups if has_groups else None)


def _unreadable_line(text: str) -> str:
    """Says which line of coordinates holds something else than numbers."""
    for line in text.splitlines():
        key, *words = line.split() or ("",)
        if key in _VERTEX_KEYS and not all(map(_is_number, words)):
            return f"the line {line[:_MAX_QUOTED]!r} holds something else than numbers"
    return "a line of numbers can't be read"


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _sort_faces(text: str, stem: str) -> tuple[str, dict[tuple[str, str, int], _Faces]]:
    """Lines of vertices, and those of faces by object, material and number of corners."""
    named = len(set(re.findall(r"^[og] (.+)$", text, re.MULTILINE))) <= _MAX_OBJECTS
    faces: dict[tuple[str, str, int], _Faces] = {}
    numbers: dict[str, int] = {}
    vertices, name, material, group = [], stem, "", 0
    for line in text.split("\n"):
        key, _, rest = line.partition(" ")
        if key == "f":
            corners = rest.count(" ") + 1
            if corners >= 3:
                chosen = faces.setdefault((name, material, corners), _Faces())
                chosen.lines.append(line)
                chosen.groups.append(group)
        elif key in _VERTEX_KEYS:
            vertices.append(line)
        elif key == "usemtl":
            material = rest
        elif key in ("o", "g") and named and rest:
            name = rest
        elif key == "s":
            word = rest.lower().lstrip("0")
            group = 0 if word in _FLAT_GROUPS else numbers.setdefault(word, len(numbers) + 1)
    return "\n".join(vertices), faces


def _normalize(text: str) -> str:
    """Single spaces between words, none at the ends of lines, and no comments or continued lines."""
    text = re.sub(r"\\\r?\n", " ", text)
    text = re.sub(r"[ \t\r\f\v]+", " ", text)
    text = re.sub(r"^ | $", "", text, flags=re.MULTILINE)
    return re.sub(r"^#.*\n", "", text + "\n", flags=re.MULTILINE)


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


def _notice_undefined(names: set[str], builder: SceneBuilder) -> None:
    named = ", ".join(map(repr, sorted(names)[:_MAX_NAMED])) + ", …" * (len(names) > _MAX_NAMED)
    if len(names) == 1:
        builder.notice(f"material {named} is not defined, so the default material is used")
    elif names:
        builder.notice(f"{len(names)} materials are not defined, so the default material is used: {named}")


def _default_material(name: str) -> Material:
    return Material(name=name, double_sided=False) if name else Material(double_sided=False)


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
