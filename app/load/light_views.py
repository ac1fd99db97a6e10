"""What the points that receive light see of emission patches: walls hide those of the next room."""

from dataclasses import dataclass

import numpy as np

from app.arrays import F64, Ints
from app.embree import Triangles
from app.load.emission_patches import Patches
from app.load.geometry import place
from app.load.light_fit import Receivers
from app.load.scene_builder import SceneBuilder

LOOKS = 256    # patches that each receiver looks at, at most
OFFSET = 1e-4  # of receivers from their surface, relative to the extent of all of them


@dataclass(frozen=True, eq=False)
class Views:
    """What R receivers see of N patches.

    Attributes
    ----------
    receivers : Receivers
    visibility : ndarray, float64, shape (R, N) or (1, 1)
        1 where nothing hides a patch, otherwise 0.
    """

    receivers: Receivers
    visibility: F64


def find_views(builder: SceneBuilder, skipped: set[int], receivers: Receivers, patches: Patches, origin: F64) -> Views:
    """Views past all opaque instances but ``skipped``; of some patches, whose neighbours have the same.

    Receivers and patches are relative to ``origin``, in world space.
    """
    occluders = _opaque_triangles(builder, skipped, origin)
    if not len(occluders):
        return Views(receivers, np.ones((1, 1)))
    looks = _some_of_all_pieces(patches)
    count, extent = len(receivers.position), np.ptp(receivers.position, axis=0).max()
    start = np.repeat(receivers.position + OFFSET * extent * receivers.normal, len(looks), axis=0).astype(np.float32)
    end = np.tile(patches.position[looks], (count, 1)).astype(np.float32)
    seen = ~occluders.meet(start, end - start).reshape(count, -1)
    away = [np.square(patches.position - at).sum(axis=1) for at in patches.position[looks]]
    return Views(receivers, seen[:, np.argmin(away, axis=0)].astype(np.float64))


def _opaque_triangles(builder: SceneBuilder, skipped: set[int], origin: F64) -> Triangles:
    """Those of instances that hide all that is behind them."""
    positions, triangles, first = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for index, instance in enumerate(builder.instances):
        mesh = builder.meshes[instance.mesh]
        material = builder.materials[mesh.material]
        if index in skipped or material.alpha_cutoff is not None or material.is_see_through:
            continue
        positions.append(place(mesh, instance) - origin)
        triangles.append(mesh.triangles.astype(np.int64) + first)
        first += len(mesh.positions)
    every = np.concatenate(triangles)
    return Triangles(np.concatenate(positions).astype(np.float32), every, np.arange(len(every)))


def _some_of_all_pieces(patches: Patches) -> Ints:
    """Indices of ``LOOKS`` patches at most, as many of each piece, or one of each of some."""
    order = np.argsort(patches.piece, kind="stable")
    _, start, size = np.unique(patches.piece[order], return_index=True, return_counts=True)
    each = max(LOOKS // len(start), 1)
    within = (np.arange(each) + 0.5) / each
    chosen = np.unique(order[(start[:, None] + within * size[:, None]).astype(np.int64)])
    return chosen[np.unique(np.linspace(0, len(chosen) - 1, LOOKS).astype(np.int64))]
