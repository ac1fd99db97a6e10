"""PLY files -> ``SceneBuilder``, through trimesh."""

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from trimesh.exchange.ply import load_ply

from app.arrays import F64
from app.load.geometry import RawMesh, add_alpha, smooth_normals
from app.load.images import read_image, to_linear
from app.load.mtl import find_file
from app.load.scene_builder import SceneBuilder
from app.scene import Material, Texture


def read_ply(path: Path, builder: SceneBuilder) -> None:
    """Fill ``builder`` from a PLY file; a mesh without normals is shaded smoothly."""
    data = path.read_bytes()
    content = load_ply(io.BytesIO(data), skip_materials=True)
    if content.get("faces") is None:
        return
    raw = _triangulate(content)
    texture = _texture(path, data, builder) if raw.uvs is not None else None
    albedo = Material().albedo if raw.colors is None and texture is None else (1.0, 1.0, 1.0)
    builder.materials.append(Material(name=path.stem, albedo=albedo, albedo_map=texture))
    mesh = builder.add_mesh(path.stem, raw, 0)
    if mesh is not None:
        builder.add_instance(path.stem, mesh, np.eye(4))


def _triangulate(content: dict[str, Any]) -> RawMesh:
    """The content that trimesh read, as triangles with normals."""
    positions, faces = np.asarray(content["vertices"], np.float64), np.asarray(content["faces"], np.int64)
    if faces.size and not 0 <= faces.min() <= faces.max() < len(positions):
        raise ValueError("a face has a vertex that the file does not list")
    face_colors = _linear_colors(content.get("face_colors"), len(faces))
    if faces.shape[1] == 4:
        faces = faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        face_colors = None if face_colors is None else face_colors.repeat(2, axis=0)
    normals = content.get("vertex_normals")
    if normals is None or len(normals) != len(positions):
        normals = smooth_normals(positions, faces)
    uvs = content["visual"].uv if "visual" in content else None
    colors = _linear_colors(content.get("vertex_colors"), len(positions))
    raw = RawMesh(positions, faces, np.asarray(normals, np.float64), uvs, colors)
    return raw if colors is not None or face_colors is None else _split_vertices(raw, face_colors)


def _split_vertices(raw: RawMesh, face_colors: F64) -> RawMesh:
    """Triangles that share no vertices, so that each can have its own colour."""
    corners = raw.triangles.ravel()
    return RawMesh(
        positions=raw.positions[corners],
        triangles=np.arange(len(corners)).reshape(-1, 3),
        normals=None if raw.normals is None else raw.normals[corners],
        uvs=None if raw.uvs is None else raw.uvs[corners],
        colors=face_colors.repeat(3, axis=0),
    )


def _texture(path: Path, data: bytes, builder: SceneBuilder) -> Texture | None:
    header = data[:data.find(b"end_header")].decode("ascii", errors="replace")
    match = re.search(r"^comment TextureFile (.+?)\r?$", header, re.MULTILINE | re.IGNORECASE)
    if match is None:
        return None
    file = find_file(path.parent, match[1])
    if file is None:
        builder.notice(f"the mesh is drawn without its texture {match[1]!r}, which is missing")
        return None
    return Texture(read_image(file))


def _linear_colors(colors: Any, count: int) -> F64 | None:
    """PLY colours as linear RGBA, shape (count, 4): bytes are sRGB-encoded, floats are linear."""
    if colors is None or len(colors) != count:
        return None
    values = np.asarray(colors)
    if values.dtype.kind == "f":
        return add_alpha(values.astype(np.float64))
    rgb = to_linear(values[:, :3].clip(0, 255).astype(np.uint8))
    return add_alpha(np.concatenate([rgb, values[:, 3:] / 255], axis=1))
