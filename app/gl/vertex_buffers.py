"""Vertices and triangles on the GPU: meshes of equal attributes share buffers, deforming instances have their own."""

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np

from app.arrays import F32
from app.scene import Mesh

Attributes = dict[str, tuple[moderngl.Buffer, str]]
Arrays = dict[str, tuple[F32, str]]


@dataclass(frozen=True, eq=False)
class VertexBuffers:
    """Attributes and triangles of one or more meshes.

    Attributes
    ----------
    attributes : dict of str to (Buffer, str)
        By name, with their format.
    ranges : sequence of (int, int, int)
        For each mesh the number of its indices, the first of them, and its first vertex.
    """

    attributes: Attributes
    indices: moderngl.Buffer
    ranges: Sequence[tuple[int, int, int]]

    def release(self) -> None:
        self.indices.release()
        for buffer, _ in self.attributes.values():
            buffer.release()


class DeformedVertices:
    """Vertices of one instance that deforms, now and in the previous frame, in buffers of its own."""

    def __init__(self, ctx: moderngl.Context, mesh: Mesh) -> None:
        self._arrays = _deforming_arrays(mesh)
        self.buffers = upload_meshes(ctx, [mesh])
        self._now = self._before = mesh.positions
        self._previous = ctx.buffer(mesh.positions.tobytes())
        self.buffers.attributes["in_previous_position"] = (self._previous, "3f4")

    def replace(self, mesh: Mesh) -> bool:
        """Take the vertices of ``mesh``; False, and no change, if they are the same."""
        arrays = _deforming_arrays(mesh)
        if all(np.array_equal(values, self._arrays[name][0]) for name, (values, _) in arrays.items()):
            return False
        self._now, self._arrays = mesh.positions, arrays
        for name, (values, _) in arrays.items():
            self.buffers.attributes[name][0].write(np.ascontiguousarray(values, np.float32))
        return True

    def advance(self) -> None:
        """Make the present vertices the previous ones."""
        if self._before is not self._now:
            self._before = self._now
            self.restore_previous()

    def write_previous(self, positions: F32) -> None:
        """Have other previous positions until ``restore_previous``."""
        self._previous.write(np.ascontiguousarray(positions, np.float32))

    def restore_previous(self) -> None:
        self.write_previous(self._before)


def attribute_names(mesh: Mesh) -> tuple[str, ...]:
    """The attributes that ``mesh`` has."""
    return tuple(_arrays(mesh))


def upload_meshes(ctx: moderngl.Context, meshes: Sequence[Mesh]) -> VertexBuffers:
    """Upload meshes of the same attributes one after the other; triangles with a non-finite corner are left out."""
    vertices = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    attributes = {name: (ctx.buffer(reserve=max(int(vertices[-1]) * values.shape[1] * 4, 4)), kind)
                  for name, (values, kind) in _arrays(meshes[0]).items()}
    for mesh, first in zip(meshes, vertices, strict=False):
        for name, (values, _) in _arrays(mesh).items():
            attributes[name][0].write(np.ascontiguousarray(values, np.float32), offset=int(first) * values.shape[1] * 4)
    triangles = [_finite_triangles(mesh) for mesh in meshes]
    first_index = np.cumsum([0, *(t.size for t in triangles)])
    indices = ctx.buffer(reserve=max(int(first_index[-1]) * 4, 4))  # GL refuses empty buffers
    for part, first in zip(triangles, first_index, strict=False):
        indices.write(np.ascontiguousarray(part, np.uint32), offset=int(first) * 4)
    ranges = [(part.size, int(first), int(vertex))
              for part, first, vertex in zip(triangles, first_index, vertices, strict=False)]
    return VertexBuffers(attributes, indices, ranges)


def _arrays(mesh: Mesh) -> Arrays:
    others = {"in_uv": (mesh.uvs, "2f4"), "in_color": (mesh.colors, "4f4"), "in_second_uv": (mesh.second_uvs, "2f4")}
    return _deforming_arrays(mesh) | {name: (values, kind) for name, (values, kind) in others.items()
                                      if values is not None}


def _deforming_arrays(mesh: Mesh) -> Arrays:
    arrays = {"in_position": (mesh.positions, "3f4"), "in_normal": (mesh.normals, "3f4")}
    return arrays if mesh.tangents is None else arrays | {"in_tangent": (mesh.tangents, "4f4")}


def _finite_triangles(mesh: Mesh) -> np.ndarray:
    finite = np.asarray(np.isfinite(mesh.positions).all(axis=1))
    return mesh.triangles if finite.all() else mesh.triangles[finite[mesh.triangles].all(axis=1)]
