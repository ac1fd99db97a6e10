"""What the points that receive light see of emission patches: walls hide those of the next room."""

from dataclasses import dataclass

import numpy as np

from app.arrays import F64, Bools, Ints
from app.embree import Triangles
from app.load.emission_patches import EmissiveTriangles
from app.load.geometry import place
from app.load.light_fit import Receivers
from app.load.scene_builder import SceneBuilder
from app.math3d import unit_rows

LOOKS = 256    # patches that each receiver looks at, at most
POINTS = 4     # of each of them
OFFSET = 1e-4  # of receivers and points from their surface, relative to the extent of all receivers
MIN_SHARE = 0.1  # by which errors of light count that is hidden from all of a patch's points, since these are few


@dataclass(frozen=True, eq=False)
class Views:
    """What R receivers see of N patches.

    Attributes
    ----------
    receivers : Receivers
    visibility : ndarray, float64, shape (R, N) or (1, 1)
        1 where some of a patch is seen, otherwise ``MIN_SHARE``.
    """

    receivers: Receivers
    visibility: F64


def find_views(builder: SceneBuilder, skipped: set[int], receivers: Receivers, triangles: EmissiveTriangles,
               patch: Ints, origin: F64) -> Views:
    """Views past all opaque instances but ``skipped``, of some patches, whose neighbours have the same.

    Parameters
    ----------
    triangles : EmissiveTriangles
        Relative to ``origin``, as the receivers are.
    patch : ndarray of int, shape (T,)
        The patch of each of them.
    """
    count = int(patch.max()) + 1
    occluders = _opaque_triangles(builder, skipped, origin)
    if not len(occluders):
        return Views(receivers, np.ones((1, 1)))
    looks = np.unique(np.linspace(0, count - 1, LOOKS).astype(np.int64))
    order = np.argsort(patch, kind="stable")
    first, end = (np.searchsorted(patch[order], looks, side) for side in ("left", "right"))
    shares = (np.arange(POINTS) + 0.5) / POINTS
    chosen = order[(first[:, None] + shares * (end - first)[:, None]).astype(np.int64)]
    seen = _seen(occluders, receivers, triangles.select(chosen.ravel())).reshape(-1, len(looks), POINTS).any(axis=2)
    sums = [np.bincount(patch, values) for values in triangles.corners.mean(axis=1).T]
    middle = np.stack(sums, axis=1) / np.bincount(patch)[:, None]
    away = [np.square(middle - middle[look]).sum(axis=1) for look in looks]
    return Views(receivers, np.where(seen, 1.0, MIN_SHARE)[:, np.argmin(away, axis=0)])


def _seen(occluders: Triangles, receivers: Receivers, triangles: EmissiveTriangles) -> Bools:
    """Whether each receiver sees the middle of each triangle, shape (R, T); not where its back is dark."""
    offset = OFFSET * np.ptp(receivers.position, axis=0).max()
    count = len(receivers.position)
    start = np.repeat(receivers.position + offset * receivers.normal, len(triangles.piece), axis=0)
    middle, normal = triangles.corners.mean(axis=1), unit_rows(triangles.normals)
    behind = np.einsum("rtc,tc->rt", receivers.position[:, None] - middle, normal) < 0
    side = np.where(behind & triangles.two_sided, -1.0, 1.0)
    end = (middle + offset * side[..., None] * normal).reshape(-1, 3)
    hidden = occluders.meet(start.astype(np.float32), (end - start).astype(np.float32)).reshape(count, -1)
    return np.asarray(~hidden & (~behind | triangles.two_sided))


def _opaque_triangles(builder: SceneBuilder, skipped: set[int], origin: F64) -> Triangles:
    """Those of instances that hide all that is behind them, at all times."""
    positions, triangles, first = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for index, instance in enumerate(builder.instances):
        mesh = builder.meshes[instance.mesh]
        material = builder.materials[mesh.material]
        passes = material.alpha_cutoff is not None or material.is_see_through or material.is_lit_through
        if index in skipped or passes or instance.moves:
            continue
        positions.append(place(mesh, instance) - origin)
        triangles.append(mesh.triangles.astype(np.int64) + first)
        first += len(mesh.positions)
    every = np.concatenate(triangles)
    return Triangles(np.concatenate(positions).astype(np.float32), every, np.arange(len(every)))
