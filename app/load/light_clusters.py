"""Emission patches -> at most ``MAX_LIGHTS`` lights.

A tree of clusters, of which a cut is used, as in lightcuts (Walter et al. 2005). The error of a cluster is measured
rather than bounded: it is the difference of irradiance between its lights and its patches at points on the scene's
surfaces (as in Hašan, Pellacini and Bala 2007, "Matrix Row-Column Sampling for the Many-Light Problem"). The cut with
the least error for each number of lights follows by dynamic programming.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from app.arrays import F64, Bools, Ints
from app.load.emission_patches import Patches
from app.load.light_fit import Fit, Receivers, fit_lights, form_factors
from app.scene import Light

MAX_LIGHTS = 32
MAX_ERROR = 0.01              # of the irradiance, at which more lights are not worth their time
MAX_EXCESS = 1.05             # times the least error, for which fewer lights will do
MAX_LEAVES = 2 * MAX_LIGHTS   # of a tree
NORMAL_SCALES = (0.3, 3.0)    # sizes of a cluster that a unit of difference between normals counts as: one tree each
MIN_IRRADIANCE = 1e-100       # W/m², summed over receivers; less is none
TIE = 1e-6                    # relative difference that rounding can make; the first of such values counts

MeasuredFit = tuple[float, tuple[Light, ...]]  # error, and the lights that have it


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


def cluster_patches(patches: Patches, receivers: Iterable[Receivers], exact: Mapping[int, Light]) -> list[Cluster]:
    """Divide patches into clusters with ``MAX_LIGHTS`` lights at most.

    Parameters
    ----------
    receivers : iterable of Receivers
        Where the clusters' irradiance is compared: the first that receive any.
    exact : mapping of int to Light
        Lights of patches that are exact, if the patch is alone.
    """
    measure = _Measure(patches, receivers, exact)
    groups = list(_first_groups(patches))
    scales = NORMAL_SCALES if patches.normal.any() else NORMAL_SCALES[:1]
    trees = [_build_tree(measure, groups, scale) for scale in scales]
    errors = np.stack([tree.errors for tree in trees])
    enough = errors.min(axis=0) <= max(MAX_ERROR, MAX_EXCESS * float(errors.min()))
    count = int(np.argmax(enough))  # the smallest
    return list(_cut(trees[_first_smallest(errors[:, count])], count))


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

    def __init__(self, patches: Patches, receivers: Iterable[Receivers], exact: Mapping[int, Light]) -> None:
        self.patches, self._exact = patches, exact
        for self._receivers in receivers:
            self._form_factors = form_factors(patches, self._receivers)
            total = (self._form_factors @ patches.power).sum(axis=1)
            if total.sum() > MIN_IRRADIANCE:
                break
        # Each receiver counts by its relative error, and dark ones for less.
        self._importance = 1 / (total + max(float(total.mean()), MIN_IRRADIANCE))
        self._importance /= max(float(self._importance @ total), MIN_IRRADIANCE)

    def fit(self, rows: Ints) -> list[MeasuredFit]:
        """The best lights of each number, and their error."""
        if len(rows) == 1 and int(rows[0]) in self._exact:
            return [(0.0, (self._exact[int(rows[0])],))]
        irradiance = self._form_factors[:, rows] @ self.patches.power[rows]
        best: dict[int, MeasuredFit] = {}
        for fit in fit_lights(self.patches, rows, self._receivers):
            error, count = self._error(fit, irradiance), len(fit.lights)
            if count not in best or error < (1 - TIE) * best[count][0]:
                best[count] = error, fit.lights
        return list(best.values())

    def _error(self, fit: Fit, irradiance: F64) -> float:
        """Mean relative difference of irradiance."""
        return float(self._importance @ np.abs(fit.irradiance - irradiance).sum(axis=1))


@dataclass(eq=False)
class _Node:
    """A cluster, its fits with their errors, and its halves; one without fits must be divided."""

    patches: Ints
    fits: list[MeasuredFit]
    halves: "tuple[_Node, _Node] | None" = None

    @cached_property
    def errors(self) -> F64:
        """The least error with at most 0, 1, 2 … ``MAX_LIGHTS`` lights."""
        return np.asarray(np.minimum(self.own_errors, _add(*(half.errors for half in self.halves)).min(axis=1))
                          if self.halves else self.own_errors)

    @property
    def own_errors(self) -> F64:
        """The same undivided."""
        errors = np.full(MAX_LIGHTS + 1, np.inf)
        for error, lights in self.fits:
            errors[len(lights):] = np.minimum(errors[len(lights):], error)
        return errors


def _add(one: F64, other: F64) -> F64:
    """Errors of two clusters with n lights in all (rows), of which k are the first one's (columns)."""
    n, k = np.mgrid[:MAX_LIGHTS + 1, :MAX_LIGHTS + 1]
    return np.asarray(np.where(k <= n, one[k] + other[np.maximum(n - k, 0)], np.inf))


def _build_tree(measure: _Measure, groups: list[Ints], normal_scale: float) -> _Node:
    """A tree whose upper nodes join the groups, and that is finest where errors are large."""
    roots = [_Node(rows, measure.fit(rows)) for rows in groups]
    leaves = list(roots)
    while len(leaves) < MAX_LEAVES:
        costs = np.array([min(error for error, _ in leaf.fits) * (len(leaf.patches) > 1) for leaf in leaves])
        if costs.sum() <= MAX_ERROR / 2:
            break
        worst = _first_largest(costs)
        leaf = leaves[worst]
        side = _divide(measure.patches, leaf.patches, normal_scale)
        one, other = (_Node(rows, measure.fit(rows)) for rows in (leaf.patches[side], leaf.patches[~side]))
        leaf.halves = one, other
        leaves[worst:worst + 1] = leaf.halves
    return reduce(lambda a, b: _Node(np.concatenate([a.patches, b.patches]), [], (a, b)), roots)


def _cut(node: _Node, count: int) -> Iterator[Cluster]:
    """The clusters of the cut that has the least error with at most ``count`` lights."""
    if node.halves is None or node.own_errors[count] <= (1 + TIE) * node.errors[count]:
        fits = (fit for fit in node.fits if len(fit[1]) <= count)
        yield Cluster(node.patches, min(fits, key=lambda fit: fit[0])[1])
        return
    one, other = node.halves
    first = _first_smallest(_add(one.errors, other.errors)[count])
    yield from _cut(one, first)
    yield from _cut(other, count - first)


def _divide(patches: Patches, rows: Ints, normal_scale: float) -> Bools:
    """One half of the patches, so that both halves vary least in position and normal.

    The candidates are divisions along axes of space and of normals.
    """
    position, normal, weight = patches.position[rows], patches.normal[rows], patches.weight[rows]
    away = position - weight @ position / weight.sum()
    variances, axes = np.linalg.eigh(np.einsum("n,ni,nj->ij", weight, away, away) / weight.sum())
    size = float(np.sqrt(max(variances.sum(), 1e-300)))
    features = np.concatenate([away, normal_scale * size * normal], axis=1)
    keys = [*away.T, away @ axes[:, 2], *normal.T]
    gains, sides = zip(*(_split_along(key, features, weight) for key in keys), strict=True)
    return sides[_first_largest(np.array(gains))]


def _split_along(key: F64, features: F64, weight: F64) -> tuple[float, Bools]:
    """The best division between lower and higher values of ``key``.

    Parameters
    ----------
    key, weight : ndarray, float64, shape (N,)
    features : ndarray, float64, shape (N, C)

    Returns
    -------
    gain : float
        How much less the features vary within the halves.
    side : ndarray, bool, shape (N,)
        The lower half.
    """
    order = np.argsort(key, kind="stable")
    below, mass = np.cumsum(weight[order, None] * features[order], axis=0), np.cumsum(weight[order])[:, None]
    gain = (below[:-1] ** 2 / mass[:-1] + (below[-1] - below[:-1]) ** 2 / (mass[-1] - mass[:-1])).sum(axis=1)
    same = np.diff(key[order]) <= TIE * float(np.ptp(key))  # equal but for rounding, so that their order is arbitrary
    best = _first_largest(np.where(same & ~same.all(), 0.0, gain))
    side = np.zeros(len(key), np.bool_)
    side[order[:best + 1]] = True
    return 0.0 if same.all() else float(gain[best]), side


def _first_smallest(values: F64) -> int:
    """Index of the first value that is smallest but for rounding."""
    return int(np.argmax(values <= values.min() * (1 + TIE)))


def _first_largest(values: F64) -> int:
    """Index of the first value that is largest but for rounding."""
    return int(np.argmax(values >= values.max() * (1 - TIE)))
