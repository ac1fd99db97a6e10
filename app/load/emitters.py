"""Emissive surfaces -> analytic lights.

All static surfaces that emit become lights. A connected piece that is a flat rectangle is exactly a rectangle light,
with an image of its texture. Other pieces, and pieces of which there are too many, are approximated by few lights with
the same power in all.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from app.arrays import F64, Bools, Ints
from app.load.emission import SurfaceEmission, corner_uvs, triangle_radiance
from app.load.emission_images import with_image
from app.load.emission_patches import EmissiveTriangles, divide_by_texture, divide_into_patches, make_patches
from app.load.emission_points import place_points
from app.load.emissive_pieces import Pieces, find_pieces
from app.load.exact_rectangles import find_rectangles
from app.load.geometry import place
from app.load.light_clusters import cluster_patches
from app.load.light_fit import Receivers
from app.load.light_proxies import ProxySplitter
from app.load.light_views import Views, find_views
from app.load.receivers import sample_receivers, surround
from app.load.scene_builder import MAX_COORDINATE, SceneBuilder, vector
from app.scene import EmissionPoints, Instance, Light, Material, Mesh, PointLight, RectLight

FLAT_COSINE = 0.99  # between the normals of a piece whose light does not meet it again
MIN_AREA = 1e-300


@dataclass(frozen=True, eq=False)
class _Emitters:
    """All static emissive triangles, in an order that depends on where they are only.

    Attributes
    ----------
    triangles : EmissiveTriangles
        Relative to ``origin``.
    textured, turned : ndarray, bool, shape (T,)
        Whether their radiance is the mean of a texture, and whether their corners are in the mesh's reverse order.
    instance, index : ndarray of int, shape (T,)
        Where each is in the builder: the instance, and the row of its mesh's triangles.
    emissions : dict of int to SurfaceEmission
        Of the builder's materials that emit.
    """

    triangles: EmissiveTriangles
    textured: Bools
    turned: Bools
    instance: Ints
    index: Ints
    origin: F64
    emissions: dict[int, SurfaceEmission]


def find_emitters(builder: SceneBuilder) -> None:
    """Add lights for the builder's static emissive surfaces and mark the surfaces as light proxies."""
    emissive = [i for i, instance in enumerate(builder.instances) if _material_of(builder, instance).emits]
    for i in emissive:
        if builder.instances[i].moves:
            builder.notice(f"{builder.instances[i].name!r} moves, so it is emissive geometry and not an analytic light")
    emitters = _collect(builder, [i for i in emissive if not builder.instances[i].moves])
    if emitters is None:
        return
    triangles, count = emitters.triangles, int(emitters.triangles.piece.max()) + 1
    rectangles = find_rectangles(triangles)
    whole = np.isin(np.arange(count), list(rectangles))
    small, patch = divide_into_patches(_divide_textured(builder, emitters, whole), whole)
    patches = make_patches(small, patch)
    exact = {int(np.flatnonzero(patches.piece == number)[0]): light for number, light in rectangles.items()}
    clusters = cluster_patches(patches, _views(builder, emitters, set(emissive), small, patch), exact)
    approximate: dict[Light, EmissionPoints] = {}
    hides_itself = _find_bent(triangles)
    exact_pieces, lights = [], []
    for cluster in clusters:
        if len(cluster.patches) == 1 and int(cluster.patches[0]) in exact:
            number = int(patches.piece[cluster.patches[0]])
            light = _with_image(builder, emitters, number, rectangles[number])
            lights.append(_translate(light, emitters.origin))
            if light.image is None:
                exact_pieces.append(number)
            continue
        lights += [_translate(light, emitters.origin) for light in cluster.lights]
        part = small.select(np.flatnonzero(np.isin(patch, cluster.patches)))
        placed = place_points(part, cluster.lights, bool(hides_itself[part.piece].any()))
        approximate |= {_translate(light, emitters.origin): points for light, points in placed}
    builder.lights += lights
    builder.approximate_lights |= approximate
    if approximate:
        builder.notice(_describe(count, len(lights), len(approximate)))
    _mark_proxies(builder, emitters, np.isin(triangles.piece, exact_pieces))


def _divide_textured(builder: SceneBuilder, emitters: _Emitters, whole: Bools) -> EmissiveTriangles:
    """The triangles, but parts of those that have a texture and are of no piece that is ``whole``, shape (pieces,)."""
    divided = emitters.textured & ~whole[emitters.triangles.piece]
    parts = [emitters.triangles.select(np.flatnonzero(~divided))]
    for mesh, rows in _by_mesh(builder, emitters, np.flatnonzero(divided)):
        parts.append(divide_by_texture(emitters.triangles.select(rows), _uvs(mesh, emitters, rows),
                                       emitters.emissions[mesh.material]))
    return EmissiveTriangles.join(parts)


def _with_image(builder: SceneBuilder, emitters: _Emitters, piece: int, light: RectLight) -> RectLight:
    """The light of a rectangular piece, with its image if it has a texture."""
    textured = np.flatnonzero((emitters.triangles.piece == piece) & emitters.textured)
    for mesh, rows in _by_mesh(builder, emitters, textured):
        light = with_image(light, emitters.triangles.corners[rows], _uvs(mesh, emitters, rows),
                           emitters.emissions[mesh.material])
    return light


def _by_mesh(builder: SceneBuilder, emitters: _Emitters, rows: Ints) -> Iterator[tuple[Mesh, Ints]]:
    """The mesh, and the rows, of those of the emissive triangles ``rows`` that are of one instance."""
    for index in np.unique(emitters.instance[rows]):
        yield builder.meshes[builder.instances[int(index)].mesh], rows[emitters.instance[rows] == index]


def _uvs(mesh: Mesh, emitters: _Emitters, rows: Ints) -> F64:
    """Texture coordinates at the corners of triangles of a mesh, in both sets; shape (2, N, 3, 2)."""
    uvs = corner_uvs(mesh, emitters.index[rows])
    return np.where(emitters.turned[rows, None, None], uvs[:, :, ::-1], uvs)


def _find_bent(triangles: EmissiveTriangles) -> Bools:
    """Which pieces emit from both sides and are not flat, shape (pieces,): some of that light meets them again."""
    normal = triangles.normals
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), MIN_AREA)
    _, first = np.unique(triangles.piece, return_index=True)
    turned = np.abs((normal * normal[first[triangles.piece]]).sum(axis=1)) < FLAT_COSINE
    return np.asarray(np.bincount(triangles.piece, turned & triangles.two_sided) > 0)


def _mark_proxies(builder: SceneBuilder, emitters: _Emitters, is_exact: Bools) -> None:
    """Mark all emitters as light proxies; ``is_exact``, shape (T,), says which triangles are exactly lights."""
    order = np.argsort(emitters.instance, kind="stable")
    instances, start = np.unique(emitters.instance[order], return_index=True)
    splitter = ProxySplitter(builder)
    for instance, rows in zip(instances.tolist(), np.split(order, start[1:]), strict=True):
        splitter.split(instance, emitters.index[rows[is_exact[rows]]])


def _describe(pieces: int, lights: int, approximate: int) -> str:
    return (f"{pieces} emissive piece{'s' * (pieces > 1)} became {lights} light{'s' * (lights > 1)}, "
            f"{approximate} of them approximate")


def _material_of(builder: SceneBuilder, instance: Instance) -> Material:
    return builder.materials[builder.meshes[instance.mesh].material]


def _collect(builder: SceneBuilder, instances: list[int]) -> _Emitters | None:
    """All triangles of ``instances`` with an area; None without any, or in a scene that is too large to be drawn."""
    pieces: dict[int, Pieces] = {}
    radiances: dict[int, F64] = {}
    emissions: dict[int, SurfaceEmission] = {}
    parts, rows, first = [], [], 0
    for i in instances:
        instance = builder.instances[i]
        mesh, material = builder.meshes[instance.mesh], _material_of(builder, instance)
        if instance.mesh not in pieces:
            emission = emissions[mesh.material] = emissions.get(mesh.material) or SurfaceEmission(material)
            pieces[instance.mesh], radiances[instance.mesh] = find_pieces(mesh), triangle_radiance(mesh, emission)
        of_mesh = pieces[instance.mesh]
        # Of a closed piece only the outside counts.
        turned = (of_mesh.is_inside_out & material.double_sided)[of_mesh.label]
        turned ^= np.linalg.det(instance.transform[:3, :3]) < 0
        corners = place(mesh, instance)[mesh.triangles]
        corners[turned] = corners[turned][:, ::-1]
        two_sided = material.double_sided & ~of_mesh.is_closed[of_mesh.label]
        parts.append(EmissiveTriangles(corners, radiances[instance.mesh], two_sided, first + of_mesh.label))
        first += len(of_mesh.is_closed)
        rows.append(np.stack([np.full(len(corners), i), np.arange(len(corners)),
                              np.full(len(corners), emissions[mesh.material].is_textured), turned]))
    if not parts:
        return None
    every = EmissiveTriangles.join(parts)
    instance_of, index, textured, turned = np.concatenate(rows, axis=1)
    if not np.abs(every.corners).max() < MAX_COORDINATE:
        return None
    origin = (every.corners.min(axis=(0, 1)) + every.corners.max(axis=(0, 1))) / 2
    every = replace(every, corners=every.corners - origin)
    order = _sort(every)
    order = order[np.asarray(every.power.any(axis=1))[order]]
    if len(order) == 0:
        return None
    chosen = every.select(order)
    _, appears, number = np.unique(chosen.piece, return_index=True, return_inverse=True)
    chosen = replace(chosen, piece=np.argsort(np.argsort(appears))[number.reshape(-1)])
    return _Emitters(chosen, textured[order].astype(bool), turned[order].astype(bool), instance_of[order], index[order],
                     origin, emissions)


def _sort(triangles: EmissiveTriangles) -> Ints:
    """The order of the triangles by what they are, whatever order they come in."""
    return np.lexsort([*triangles.radiance.T, *triangles.corners.reshape(-1, 9).T]).astype(np.int64)


def _views(builder: SceneBuilder, emitters: _Emitters, emissive: set[int], triangles: EmissiveTriangles,
           patch: Ints) -> Iterator[Views]:
    """From other surfaces, and from around the emitters, relative to the emitters' origin."""
    surfaces = sample_receivers(builder, emissive)
    if len(surfaces.position):
        receivers = Receivers(surfaces.position - emitters.origin, surfaces.normal)
        yield find_views(builder, emissive, receivers, triangles, patch, emitters.origin)
    corners = emitters.triangles.corners.reshape(-1, 3)
    yield Views(surround(corners.min(axis=0), corners.max(axis=0)), np.ones((1, 1)))


def _translate(light: Light, offset: F64) -> Light:
    if isinstance(light, RectLight):
        return replace(light, center=vector(light.center + offset))
    assert isinstance(light, PointLight)
    return replace(light, position=vector(light.position + offset))
