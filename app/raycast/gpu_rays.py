"""What shaders need to trace rays through a caster's scene: shaders/include/ray_scene.glsl and ray_surface.glsl.

Buffers hold the bodies' triangles with their bounding volumes, and the surfaces' properties as ``Body.interact`` takes
them. Scenes in which rays pass parts of surfaces, and those with bodies that change their shape, are left to the CPU.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32
from app.gl.context import Device
from app.math3d import affine_inverse
from app.raycast.body import Body
from app.raycast.caster import Caster
from app.raycast.hierarchy import LEAF, Hierarchy, build_hierarchy
from app.raycast.prefiltered_textures import PrefilteredTextures
from app.scene import Material, Texture

# Binding points, as in the shaders.
NODES, TRIANGLES, BODIES, CORNERS, VERTICES, MATERIALS, TEXELS = range(1, 8)
IS_PROXY, IS_ONE_SIDED, IS_LIT_THROUGH, IS_MIRRORED = 1, 2, 4, 8  # of a triangle
HAS_SPECULAR, IS_DOUBLE_SIDED, EMITS = 1, 2, 4  # of a material
BODY_BYTES = 4 * 16  # as in ray_scene.glsl
NO_TEXTURE = -1
REPEATS_U, REPEATS_V, SECOND_UVS = 1, 2, 4


def can_trace(caster: Caster) -> bool:
    """Whether shaders can trace rays through the scene."""
    return caster.animated is None and not any(b.alpha_tested[b.material].any() for b in caster.bodies)


@dataclass(frozen=True, eq=False)
class PackedScene:
    """A caster's scene as shaders read it.

    Attributes
    ----------
    bodies : list of int
        Indices of the bodies that have triangles.
    places : list of tuple of int
        For each of them its first node, its number of leaves, its first triangle, and 0.
    buffers : dict of int to bytes
        By binding point; all but that of the bodies, which move.
    """

    bodies: list[int]
    places: list[tuple[int, ...]]
    buffers: dict[int, bytes]


def pack_scene(caster: Caster) -> PackedScene:
    """Pack the scene of a caster for which ``can_trace`` holds."""
    numbers = [index for index, body in enumerate(caster.bodies) if len(body.triangles)]
    places: list[tuple[int, ...]] = []
    materials: list[Material] = []
    bounds, triangles, corners, vertices = [], [], [], []
    first_node = first_slot = first_triangle = first_vertex = 0  # of all bodies
    for body in (caster.bodies[index] for index in numbers):
        hierarchy = build_hierarchy(body.positions[body.triangles])
        places.append((first_node, hierarchy.leaves, first_slot, 0))
        bounds.append(_padded(hierarchy.bounds))
        triangles.append(_triangles(body, hierarchy, first_triangle))
        corners.append(np.concatenate([body.triangles + first_vertex,
                                       body.material[:, None] + len(materials)], axis=1).astype(np.int32))
        vertices.append(_vertices(body))
        materials += body.materials
        first_node += 2 * hierarchy.leaves
        first_slot += hierarchy.leaves * LEAF
        first_triangle += len(body.triangles)
        first_vertex += len(body.positions)
    records, texels = _materials(materials, caster.textures)
    return PackedScene(numbers, places, {
        NODES: _joined(bounds), TRIANGLES: _joined(triangles), CORNERS: _joined(corners), VERTICES: _joined(vertices),
        MATERIALS: _joined([records]), TEXELS: _joined(texels)})


def _joined(arrays: Sequence[NDArray[Any]]) -> bytes:
    return b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)


class GpuRays:
    """The buffers of one caster's scene, with bodies where the caster has them."""

    def __init__(self, device: Device, caster: Caster, scene: PackedScene) -> None:
        self._caster, self._scene = caster, scene
        self._buffers = {binding: device.ctx.buffer(data or bytes(16)) for binding, data in scene.buffers.items()}
        self._buffers[BODIES] = device.ctx.buffer(reserve=max(1, len(scene.bodies)) * BODY_BYTES)
        self._revision = -1

    def bind(self, program: Any) -> None:
        """Let ``program`` trace rays, with bodies where the caster has them now."""
        if self._revision != self._caster.revision:
            self._revision = self._caster.revision
            records = map(self._body, self._scene.bodies, self._scene.places)
            self._buffers[BODIES].write(b"".join(records))
        for binding, buffer in self._buffers.items():
            buffer.bind_to_storage_buffer(binding)
        program.set(body_count=len(self._scene.bodies))

    def _body(self, index: int, place: tuple[int, ...]) -> bytes:
        """A body's matrix from local space, by rows, and where its nodes and triangles are."""
        inverse = affine_inverse(self._caster.matrices[index])
        if inverse is None:  # scaled to nothing
            inverse, place = np.eye(4), (place[0], 0, *place[2:])
        return inverse[:3].astype(np.float32).tobytes() + np.array(place, np.int32).tobytes()


def _padded(vectors: F32) -> F32:
    """Vectors of three as of four, the last 0."""
    return np.pad(vectors, [(0, 0)] * (vectors.ndim - 1) + [(0, 1)])


def _triangles(body: Body, hierarchy: Hierarchy, first: int) -> F32:
    """First corner and edges of the leaves' triangles, shape (N, 3, 4); in the last column their numbers and flags.

    ``first`` is the number of the body's first triangle.
    """
    a, b, c = np.moveaxis(body.positions[body.triangles[hierarchy.order]], 1, 0)
    packed = _padded(np.stack([a, b - a, c - a], axis=1))
    material = body.material[hierarchy.order]
    flags = (body.light_proxies[material] * IS_PROXY + body.one_sided[material] * IS_ONE_SIDED
             + body.lit_through[material] * IS_LIT_THROUGH + body.mirrored[hierarchy.order] * IS_MIRRORED)
    packed[:, 0, 3] = (hierarchy.order + first).astype(np.int32).view(np.float32)
    packed[:, 1, 3] = flags.astype(np.int32).view(np.float32)
    return packed


def _vertices(body: Body) -> F32:
    """Normal, both sets of texture coordinates and colour of each vertex, shape (V, 3, 4)."""
    packed = np.zeros((len(body.positions), 3, 4), np.float32)
    packed[:, 0, :3] = body.normals
    for number, uvs in enumerate(body.uvs):
        packed[:, 1, 2 * number:2 * number + 2] = uvs
    packed[:, 2] = 1 if body.colors is None else body.colors
    return packed


def _materials(materials: Sequence[Material], textures: PrefilteredTextures) -> tuple[F32, list[F32]]:
    """What ``ray_surface.glsl`` reads of materials, shape (M, 15, 4), and their texels, each of shape (h, w, 3)."""
    packed = np.zeros((max(1, len(materials)), 15, 4), np.float32)
    bits = packed.view(np.int32)
    texels: list[F32] = []
    offsets: dict[int, int] = {}  # in texels, by the copy

    def place(texture: Texture) -> tuple[int, int, int]:
        copy = textures.copy_of(texture)
        if id(copy) not in offsets:
            offsets[id(copy)] = sum(t.shape[0] * t.shape[1] for t in texels)
            texels.append(copy)
        return offsets[id(copy)], copy.shape[1], copy.shape[0]

    for row, (m, record) in enumerate(zip(materials, packed, strict=False)):
        record[0, :3], record[1, :3], record[2, :3] = (0, 0, 0) if m.is_unlit else m.albedo, m.specular, m.emission
        record[1, 3], record[2, 3] = m.roughness, m.metallic
        bits[row, 0, 3] = ((m.has_specular and not m.is_unlit) * HAS_SPECULAR + m.double_sided * IS_DOUBLE_SIDED
                           + m.emits * EMITS)
        for number, texture in enumerate((m.albedo_map, m.specular_map, m.metallic_roughness_map, m.emission_map)):
            at = 3 + 3 * number
            bits[row, at, 0] = NO_TEXTURE
            if texture is not None:
                repeats = texture.repeat[0] * REPEATS_U + texture.repeat[1] * REPEATS_V
                bits[row, at] = *place(texture), repeats + bool(texture.uv_set) * SECOND_UVS
                transform = np.asarray(texture.transform, np.float32)
                record[at + 1], record[at + 2, :2] = (*transform[0], transform[1, 0]), transform[1, 1:]
    return packed, texels


def choose_rays(device: Device, caster: Caster, method: str) -> GpuRays | None:
    """The rays that shaders trace, or None where the CPU traces them.

    Parameters
    ----------
    method : str
        One of ``RAY_METHODS`` of app/settings.py: ``auto`` is the GPU if there is one. Shaders trace no rays that they
        can't, and none through scenes that are too large for a buffer.
    """
    if method == "cpu" or (method == "auto" and device.software) or not can_trace(caster):
        return None
    scene = pack_scene(caster)
    if max(map(len, scene.buffers.values())) > device.max_storage_bytes:
        return None
    return GpuRays(device, caster, scene)
