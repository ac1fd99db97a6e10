"""Emissive surfaces -> analytic lights.

All static surfaces that emit become lights. A connected piece that is a flat rectangle is a rectangle light, exactly or
with an image of its texture. Other pieces, and pieces of which there are too many, are approximated by few lights with
the same power in all.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from app.arrays import F64, Bools, Ints
from app.load.emission import SurfaceEmission, corner_uvs, is_dark, triangle_radiance
from app.load.emission_images import with_image
from app.load.emission_patches import EmissiveTriangles, divide, divide_into_patches, divide_triangle, make_patches
from app.load.emission_points import place_points
from app.load.emissive_pieces import Pieces, find_pieces
from app.load.exact_rectangles import find_rectangles
from app.load.geometry import face_vectors, place
from app.load.light_clusters import cluster_patches
from app.load.light_fit import Receivers
from app.load.light_proxies import ProxySplitter
from app.load.light_views import Views, find_views
from app.load.receivers import sample_receivers, surround
from app.load.scene_builder import MAX_COORDINATE, SceneBuilder, vector
from app.scene import EmissionPoints, Instance, Light, Material, Mesh, PointLight, RectLight

MAX_IMAGES = 8      # of textured rectangles, each of which costs time in every frame; the others are approximated
MAX_TEXTURED = 2**13  # parts of other textured triangles, roughly
MAX_SIDE = 16         # of them, along the edge of a triangle
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
    rectangles = _brightest_images(triangles, emitters.textured, find_rectangles(triangles))
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
    side = int(np.clip(np.sqrt(MAX_TEXTURED / max(int(divided.sum()), 1)), 1, MAX_SIDE))
    if side == 1:
        return emitters.triangles
    parts = [emitters.triangles.select(np.flatnonzero(~divided))]
    radiances: dict[int, F64] = {}
    for index in np.unique(emitters.instance[divided]).tolist():
        number = builder.instances[index].mesh
        mesh = builder.meshes[number]
        if number not in radiances:
            radiances[number] = _radiance_of_parts(mesh, emitters.emissions[mesh.material], side)
        of_instance = divided & (emitters.instance == index)
        for is_turned in (False, True):  # whose parts are in another order
            rows = np.flatnonzero(of_instance & (emitters.turned == is_turned))
            triangles = emitters.triangles.select(rows)
            corners = triangles.corners[:, ::-1] if is_turned else triangles.corners
            of_rows = divide(replace(triangles, corners=corners), radiances[number][emitters.index[rows]])
            parts.append(replace(of_rows, corners=of_rows.corners[:, ::-1]) if is_turned else of_rows)
    return EmissiveTriangles.join(parts)


def _radiance_of_parts(mesh: Mesh, emission: SurfaceEmission, side: int) -> F64:
    """Of each triangle's side² equal parts, shape (T, side², 3); 0 of what gives next to nothing."""
    uvs = np.einsum("pcs,utsi->utpci", divide_triangle(side), corner_uvs(mesh, np.arange(len(mesh.triangles))))
    radiance = emission.mean(uvs.reshape(2, -1, 3, 2))
    area = np.linalg.norm(face_vectors(mesh.positions.astype(np.float64), mesh.triangles), axis=1)
    radiance[is_dark(radiance, np.repeat(area, side**2))] = 0
    return radiance.reshape(-1, side**2, 3)


def _brightest_images(triangles: EmissiveTriangles, textured: Bools,
                      rectangles: dict[int, RectLight]) -> dict[int, RectLight]:
    """The rectangles without those with a texture that are not among the ``MAX_IMAGES`` with the most power."""
    count = int(triangles.piece.max()) + 1
    power = np.bincount(triangles.piece, triangles.power.sum(axis=1), count)
    has_texture = np.bincount(triangles.piece, textured, count) > 0
    with_texture = sorted((number for number in rectangles if has_texture[number]), key=lambda number: -power[number])
    left_out = set(with_texture[MAX_IMAGES:])
    return {number: light for number, light in rectangles.items() if number not in left_out}


def _with_image(builder: SceneBuilder, emitters: _Emitters, piece: int, light: RectLight) -> RectLight:
    """The light of a rectangular piece, with its image if it has a texture."""
    textured = np.flatnonzero((emitters.triangles.piece == piece) & emitters.textured)
    if len(textured) == 0:
        return light
    mesh = builder.meshes[builder.instances[int(emitters.instance[textured[0]])].mesh]
    uvs = corner_uvs(mesh, emitters.index[textured])
    uvs = np.where(emitters.turned[textured, None, None], uvs[:, :, ::-1], uvs)
    return with_image(light, emitters.triangles.corners[textured], uvs, emitters.emissions[mesh.material])


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
