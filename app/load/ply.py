"""PLY files -> SceneBuilder, through trimesh."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from trimesh.exchange.ply import load_ply

from app.load.geometry import Surface, smooth_normals
from app.load.images import read_image, to_linear
from app.load.mtl import locate
from app.load.scene_builder import SceneBuilder
from app.scene import F64, Material, Texture

_WHITE = (1.0, 1.0, 1.0)


def read_ply(path: Path, builder: SceneBuilder) -> None:
    """Fill ``builder`` from a PLY file; without normals it is taken as smooth."""
    data = path.read_bytes()
    loaded = load_ply(io.BytesIO(data), skip_materials=True)
    if loaded.get("faces") is None:
        return
    surface = _surface(loaded)
    texture = _texture(path, data, builder) if surface.uvs is not None else None
    tinted = surface.colors is not None or texture is not None
    builder.materials.append(Material(name=path.stem, albedo=_WHITE if tinted else Material().albedo, albedo_map=texture))
    mesh = builder.add_mesh(path.stem, surface, 0)
    if mesh is not None:
        builder.place(path.stem, mesh, np.eye(4))


def _surface(loaded: dict[str, Any]) -> Surface:
    """What trimesh read, as triangles with normals."""
    positions, faces = np.asarray(loaded["vertices"], np.float64), np.asarray(loaded["faces"], np.int64)
    face_colors = _linear(loaded.get("face_colors"), len(faces))
    if faces.shape[1] == 4:
        faces = faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        face_colors = None if face_colors is None else face_colors.repeat(2, axis=0)
    normals = loaded.get("vertex_normals")
    if normals is None or len(normals) != len(positions):
        normals = smooth_normals(positions, faces)
    uvs = loaded["visual"].uv if "visual" in loaded else None
    colors = _linear(loaded.get("vertex_colors"), len(positions))
    surface = Surface(positions, faces, np.asarray(normals, np.float64), uvs, colors)
    return surface if colors is not None or face_colors is None else _taken_apart(surface, face_colors)


def _taken_apart(surface: Surface, face_colors: F64) -> Surface:
    """Every triangle with its own corners, so that each can have its own colour."""
    corners = surface.triangles.ravel()
    return Surface(
        positions=surface.positions[corners],
        triangles=np.arange(len(corners)).reshape(-1, 3),
        normals=None if surface.normals is None else surface.normals[corners],
        uvs=None if surface.uvs is None else surface.uvs[corners],
        colors=face_colors.repeat(3, axis=0),
    )


def _texture(path: Path, data: bytes, builder: SceneBuilder) -> Texture | None:
    header = data[:data.find(b"end_header")].decode("ascii", errors="replace")
    match = re.search(r"^comment TextureFile (.+?)\r?$", header, re.MULTILINE | re.IGNORECASE)
    if match is None:
        return None
    file = locate(path.parent, match[1])
    if file is None:
        builder.notice(f"the texture {match[1]!r} is missing: the plain colour is used")
        return None
    return Texture(read_image(file))


def _linear(colors: Any, count: int) -> F64 | None:
    """PLY colours as linear RGBA, shape (count, 4): bytes are sRGB, floats are linear."""
    if colors is None or len(colors) != count:
        return None
    values = np.asarray(colors)
    if values.dtype.kind == "f":
        rgb, alpha = values[:, :3].astype(np.float64), values[:, 3:].astype(np.float64)
    else:
        rgb, alpha = to_linear(values[:, :3].clip(0, 255).astype(np.uint8)), values[:, 3:] / 255
    return np.concatenate([rgb, alpha if alpha.shape[1] else np.ones((count, 1))], axis=1)
