"""PLY files -> Draft, through trimesh."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from trimesh.exchange.ply import load_ply

from app.load.draft import Draft
from app.load.geometry import Surface, smooth_normals
from app.load.images import read_image, to_linear
from app.load.mtl import locate
from app.scene import F64, Material, Texture

_WHITE = (1.0, 1.0, 1.0)


def read_ply(path: Path, draft: Draft) -> None:
    """Fill ``draft`` from a PLY file; without normals it is taken as smooth."""
    data = path.read_bytes()
    loaded = load_ply(io.BytesIO(data), skip_materials=True)
    if loaded.get("faces") is None:
        return
    positions = np.asarray(loaded["vertices"], np.float64)
    triangles = np.asarray(loaded["faces"], np.int64)
    if triangles.shape[1] == 4:
        triangles = triangles[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        loaded["face_colors"] = None if loaded.get("face_colors") is None else loaded["face_colors"].repeat(2, axis=0)
    normals, colors = loaded.get("vertex_normals"), loaded.get("vertex_colors")
    uvs = loaded["visual"].uv if "visual" in loaded else None
    if normals is None or len(normals) != len(positions):
        normals = smooth_normals(positions, triangles)
    if colors is None and loaded.get("face_colors") is not None:
        positions, normals, uvs = (None if a is None else np.asarray(a)[triangles.ravel()]
                                   for a in (positions, normals, uvs))
        colors = np.repeat(np.asarray(loaded["face_colors"]), 3, axis=0)
        triangles = np.arange(len(triangles) * 3).reshape(-1, 3)

    texture = _texture(path, data, draft)
    has_colors = colors is not None and len(colors) == len(positions)
    tinted = has_colors or (texture is not None and uvs is not None)
    draft.materials.append(Material(name=path.stem, albedo=_WHITE if tinted else Material().albedo, albedo_map=texture))
    surface = Surface(positions, triangles, np.asarray(normals, np.float64), uvs, _linear(colors) if has_colors else None)
    mesh = draft.add_mesh(path.stem, surface, 0)
    if mesh is not None:
        draft.place(path.stem, mesh, np.eye(4))


def _texture(path: Path, data: bytes, draft: Draft) -> Texture | None:
    header = data[:data.find(b"end_header")].decode("ascii", errors="replace")
    match = re.search(r"^comment TextureFile (.+?)\r?$", header, re.MULTILINE | re.IGNORECASE)
    if match is None:
        return None
    file = locate(path.parent, match[1])
    if file is None:
        draft.notice(f"the texture {match[1]!r} is missing: the plain colour is used")
        return None
    return Texture(read_image(file))


def _linear(colors: Any) -> F64:
    """PLY colours as linear RGBA, shape (V, 4): bytes are sRGB, floats are linear."""
    colors = np.asarray(colors)
    if colors.dtype.kind == "f":
        rgb, alpha = colors[:, :3].astype(np.float64), colors[:, 3:].astype(np.float64)
    else:
        rgb, alpha = to_linear(colors[:, :3].clip(0, 255).astype(np.uint8)), colors[:, 3:] / 255
    return np.concatenate([rgb, alpha if alpha.shape[1] else np.ones((len(rgb), 1))], axis=1)
