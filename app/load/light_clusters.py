"""Emission patches -> at most ``MAX_LIGHTS`` lights.

Trees of clusters, of which a cut is used, as in lightcuts (Walter et al. 2005). The error of a cluster is measured
rather than bounded: it is the difference of irradiance between its lights and its patches at points on the scene's
surfaces, as far as these see the patches (as in Hašan, Pellacini and Bala 2007, "Matrix Row-Column Sampling for the
Many-Light Problem"). The cuts with the least error and cost for each number of lights follow by dynamic programming.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from app.arrays import F64, Ints
from app.load.emission_patches import Patches
from app.load.light_fit import Fit, fit_lights, form_factors
from app.load.light_tree import MAX_LIGHTS, MeasuredFit, build_tree, build_tree_of_pieces, cut, first_smallest
from app.load.light_views import Views
from app.scene import Light

MAX_ERROR = 0.01              # of the irradiance, at which more lights are not worth their time
MAX_EXCESS = 1.05             # times the least error, for which fewer lights will do
NORMAL_SCALES = (0.3, 3.0)    # sizes of a cluster that a unit of difference between normals counts as
MAX_PIECES = 2**10            # of which a tree of pieces is built; it takes longer than the others
MIN_IRRADIANCE = 1e-100       # W/m², summed over receivers; less is none
SPREAD_COST = 0.2             # of light that leaves an area far larger than that of its patches, which highlights show
MAX_SPREAD = 4.0              # times the patches' area, up to which it costs nothing


@dataclass(frozen=True, eq=False)
class Cluster:
    """Patches and the lights that stand for them.

    Attributes
    ----------
    patches : ndarray of int
        Indices, increasing.
    lights : tuple of Light
    """

    patches: Ints
    lights: tuple[Light, ...]


def cluster_patches(patches: Patches, views: Iterable[Views], exact: Mapping[int, Light]) -> list[Cluster]:
    """Divide patches into clusters with ``MAX_LIGHTS`` lights at most.

    Parameters
    ----------
    views : iterable of Views
        From where the clusters' irradiance is compared: the first that receive any.
    exact : mapping of int to Light
        Lights of patches that are exact, if the patch is alone.
    """
    if len(exact) == len(patches.piece) <= MAX_LIGHTS:
        return [Cluster(np.array([number]), (exact[number],)) for number in range(len(exact))]
    measure = _Measure(patches, views, exact)
    groups = list(_first_groups(patches))
    scales = NORMAL_SCALES if patches.normal.any() else NORMAL_SCALES[:1]
    trees = [build_tree(patches, measure.fit, groups, scale, MAX_ERROR / 2) for scale in scales]
    if len(groups) < len(np.unique(patches.piece)) <= MAX_PIECES:
        trees.append(build_tree_of_pieces(patches, measure.fit, MAX_ERROR / 2))
    errors = np.stack([tree.least_errors for tree in trees])
    enough = errors.min(axis=0) <= max(MAX_ERROR, MAX_EXCESS * float(errors.min()))
    count = int(np.argmax(enough))  # the smallest
    best = trees[first_smallest(np.array([tree.least_costs[count] for tree in trees]))]
    return [Cluster(node.patches, lights) for node, lights in cut(best, count)]


def _first_groups(patches: Patches) -> Iterator[Ints]:
    """Patches that no cluster joins: all pieces if there are lights enough, otherwise the strongest, and all others."""
    weight = np.bincount(patches.piece, patches.weight)
    alone = (np.full(len(weight), True) if np.count_nonzero(weight) <= MAX_LIGHTS
             else weight >= weight.sum() / MAX_LIGHTS)[patches.piece]
    for number in np.unique(patches.piece[alone]):
        yield np.flatnonzero(patches.piece == number)
    if not alone.all():
        yield np.flatnonzero(~alone)


class _Measure:
    """Fits lights to clusters and measures their errors."""

    def __init__(self, patches: Patches, views: Iterable[Views], exact: Mapping[int, Light]) -> None:
        self._patches, self._exact = patches, exact
        for view in views:
            self._receivers = view.receivers
            form = form_factors(patches, view.receivers)
            seen = form * view.visibility
            total = (seen @ patches.power).sum(axis=1)
            self._form_factors, self._seen = (np.ascontiguousarray(values.T) for values in (form, seen))
            if total.sum() > MIN_IRRADIANCE:
                break
        # Each receiver counts by its relative error, and dark ones for less.
        self._importance = 1 / (total + max(float(total.mean()), MIN_IRRADIANCE))
        self._importance /= max(float(self._importance @ total), MIN_IRRADIANCE)

    def fit(self, rows: Ints) -> list[MeasuredFit]:
        """Lights for the patches ``rows``, and their errors."""
        if len(rows) == 1 and int(rows[0]) in self._exact:
            return [MeasuredFit(0.0, 0.0, (self._exact[int(rows[0])],))]
        power = self._patches.power[rows]
        irradiance, seen = (factors.take(rows, axis=0).T @ power for factors in (self._form_factors, self._seen))
        # Rays find the shadows of the patches, whatever lights stand for them.
        share = seen.sum(axis=1) / np.maximum(irradiance.sum(axis=1), MIN_IRRADIANCE)
        return [self._measured(fit, rows, irradiance, self._importance * share)
                for fit in fit_lights(self._patches, rows, self._receivers)]

    def _measured(self, fit: Fit, rows: Ints, irradiance: F64, importance: F64) -> MeasuredFit:
        error = float(importance @ np.abs(fit.irradiance - irradiance).sum(axis=1))
        area = float(self._patches.area[rows].sum())
        spread = max(1 - MAX_SPREAD * area / fit.area, 0.0) if fit.area > 0 else 0.0
        return MeasuredFit(error, error + SPREAD_COST * spread * float(importance @ irradiance.sum(axis=1)), fit.lights)
