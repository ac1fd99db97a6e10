"""Tangents of vertices for normal maps, by the method that baking tools share.

Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited" (MikkTSpace), without its test that the triangles of a
vertex touch each other at an edge.
"""

from dataclasses import replace

import numpy as np

from app.arrays import F64, Ints
from app.load.geometry import RawMesh, face_vectors, number_rows, take_vertices
from app.scene import Material


def add_tangents(mesh: RawMesh, uvs: F64) -> RawMesh:
    """The mesh with tangents along u of ``uvs``, shape (V, 2), v upwards.

    A vertex at which mirrored and other triangles meet becomes two; without normals each triangle has its own vertices.
    """
    if mesh.normals is None:
        corners = mesh.triangles.ravel()
        mesh, uvs = take_vertices(mesh, corners, np.arange(len(corners)).reshape(-1, 3)), uvs[corners]
        mesh = replace(mesh, normals=np.repeat(face_vectors(mesh.positions, mesh.triangles), 3, axis=0))
    assert mesh.normals is not None
    normals = _unit(mesh.normals)
    along_u, is_mirrored = _directions(mesh.positions, uvs, mesh.triangles)
    corners, side = mesh.triangles.ravel(), np.repeat(is_mirrored, 3)

    at = normals[corners]
    weight = _corner_angles(mesh.positions, mesh.triangles, at)
    projected = _unit(_project(np.repeat(along_u, 3, axis=0), at)) * weight[:, None]
    # Vertices that differ in no attribute of the tangent space share theirs.
    same = number_rows(np.concatenate([mesh.positions, normals, uvs], axis=1))[corners] * 2 + side
    sums = np.stack([np.bincount(same, projected[:, axis], 2 * len(normals)) for axis in range(3)], axis=1)

    vertices, first, renumber = np.unique(corners * 2 + side, return_index=True, return_inverse=True)
    mesh = take_vertices(mesh, vertices // 2, renumber.reshape(-1, 3))
    return replace(mesh, tangents=np.column_stack([_unit(sums[same[first]]), 1.0 - 2.0 * (vertices % 2)]))


def with_tangents(raw: RawMesh, material: Material) -> RawMesh:
    """The mesh with tangents if a normal map of the material needs them, and without if not."""
    texture = material.maps.get("normal_map", material.maps.get("clearcoat_normal_map"))
    uvs = raw.uvs if texture is None or texture.uv_set == 0 else raw.second_uvs
    if texture is None or uvs is None:
        return replace(raw, tangents=None)
    if raw.tangents is not None and raw.normals is not None:
        return raw
    return add_tangents(raw, uvs @ texture.transform[:2, :2].T)


def _directions(positions: F64, uvs: F64, triangles: Ints) -> tuple[F64, Ints]:
    """The direction of growing u in each triangle, shape (T, 3), and 1 where the image is mirrored, shape (T,)."""
    a, b, c = (positions[triangles[:, i]] for i in range(3))
    p, q, r = (uvs[triangles[:, i]] for i in range(3))
    du_b, dv_b = (q - p).T
    du_c, dv_c = (r - p).T
    area = du_b * dv_c - dv_b * du_c
    along = (dv_c[:, None] * (b - a) - dv_b[:, None] * (c - a)) * np.sign(area)[:, None]
    return _unit(along), (area < 0).astype(np.int64)


def _corner_angles(positions: F64, triangles: Ints, normals: F64) -> F64:
    """Angle of each corner in the plane across its normal, shape (3 T,)."""
    here = positions[triangles]
    to_next = _unit(_project((np.roll(here, -1, axis=1) - here).reshape(-1, 3), normals))
    to_last = _unit(_project((np.roll(here, 1, axis=1) - here).reshape(-1, 3), normals))
    return np.asarray(np.arccos(np.clip((to_next * to_last).sum(axis=1), -1.0, 1.0)))


def _project(vectors: F64, normals: F64) -> F64:
    return vectors - (vectors * normals).sum(axis=1, keepdims=True) * normals


def _unit(vectors: F64) -> F64:
    """Unit vectors; zero for what has no direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.nan_to_num(vectors / np.where(length > 0, length, 1.0), posinf=0.0, neginf=0.0)
