"""Wavefront OBJ files -> SceneBuilder, through trimesh.

trimesh skips lines whose key is followed by a tab, counts relative indices from the end of the file
and quantises colours, so the text is put in order first and the materials are read in ``mtl.py``.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.exchange.obj import load_obj

from app.load.geometry import Surface
from app.load.mtl import read_mtl
from app.load.scene_builder import SceneBuilder
from app.scene import Material

_MAX_OBJECTS = 64


def read_obj(path: Path, builder: SceneBuilder) -> None:
    """Fill ``builder`` from an OBJ file and the MTL files that it names."""
    text = _tidy(path.read_bytes().decode("utf-8", errors="replace"))
    materials: dict[str, Material] = {}
    for name in re.findall(r"^mtllib (.+)$", text, re.MULTILINE):
        materials |= read_mtl(path.parent, name, builder)
    if re.search(r"^[lp] ", text, re.MULTILINE):
        builder.notice("points and lines are left out")
    text, parts = _number_parts(text, path.stem)
    if re.search(r"^f .*-\d", text, re.MULTILINE):
        text = "\n".join(_absolute(text))

    indices: dict[str, int] = {}
    # A made-up MTL file makes trimesh keep the numbers of the parts as material names.
    numbers = "\n".join(f"newmtl {i}" for i in range(len(parts)))
    loaded = load_obj(io.StringIO(text), resolver={"parts": numbers})
    for geometry in loaded.get("geometry", {}).values():
        name, material = parts[int(geometry["visual"].material.name)]
        if material not in indices:
            indices[material] = len(builder.materials)
            builder.materials.append(materials.get(material) or _undefined(material, builder))
        mesh = builder.add_mesh(name, _surface(geometry), indices[material])
        if mesh is not None:
            builder.place(name, mesh, np.eye(4))


def _tidy(text: str) -> str:
    """One blank between words, none at the ends of lines, no comments and no continued lines."""
    text = re.sub(r"\\\r?\n", " ", text)
    text = re.sub(r"[ \t\r\f\v]+", " ", text)
    text = re.sub(r"^ | $", "", text, flags=re.MULTILINE)
    return re.sub(r"^#.*\n", "", text + "\n", flags=re.MULTILINE)


def _number_parts(text: str, stem: str) -> tuple[str, list[tuple[str, str]]]:
    """Replace all object, group and material lines by the number of an (object, material) pair."""
    named = len(set(re.findall(r"^[og] (.+)$", text, re.MULTILINE))) <= _MAX_OBJECTS
    parts: dict[tuple[str, str], int] = {}
    current = [stem, ""]

    def number(match: re.Match[str]) -> str:
        key, value = match[1], match[2]
        if key == "usemtl":
            current[1] = value
        elif named:
            current[0] = value
        return f"usemtl {parts.setdefault((current[0], current[1]), len(parts))}"

    start = f"usemtl {parts.setdefault((stem, ''), 0)}\n"
    body = re.sub(r"^(o|g|usemtl) (.+)$", number, re.sub(r"^mtllib .*$", "", text, flags=re.MULTILINE),
                  flags=re.MULTILINE)
    return f"mtllib parts\n{start}{body}", list(parts)


def _absolute(text: str) -> Iterator[str]:
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


def _undefined(name: str, builder: SceneBuilder) -> Material:
    if not name:
        return Material(double_sided=False)
    builder.notice(f"material {name!r} is not defined: the default material is used")
    return Material(name=name, double_sided=False)


def _surface(geometry: dict[str, Any]) -> Surface:
    positions = np.asarray(geometry["vertices"], np.float64)
    uvs = geometry["visual"].uv
    return Surface(
        positions=positions,
        triangles=_fan(np.asarray(geometry["faces"], np.int64)),
        normals=_per_vertex(geometry.get("vertex_normals"), positions, 3),
        uvs=_per_vertex(uvs, positions, 2),
        colors=_colors(_per_vertex(geometry.get("vertex_colors"), positions, 3)),
    )


def _fan(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Polygons of equal length, shape (N, K), as triangles."""
    corners = [faces[:, [0, i, i + 1]] for i in range(1, faces.shape[1] - 1)]
    return np.stack(corners, axis=1).reshape(-1, 3)


def _per_vertex(values: Any, positions: NDArray[np.float64], width: int) -> NDArray[np.float64] | None:
    if values is None or np.shape(values) != (len(positions), width):
        return None
    return np.asarray(values, np.float64)


def _colors(colors: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    return None if colors is None else np.concatenate([colors, np.ones((len(colors), 1))], axis=1)
