"""Trees of clusters of emission patches, with lights for each cluster, and the best cut through a tree."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from app.arrays import F64, Bools, Ints
from app.load.emission_patches import Patches
from app.scene import Light

MAX_LIGHTS = 32
MAX_LEAVES = 2 * MAX_LIGHTS   # of a tree
TIE = 1e-6                    # relative difference that rounding can make; the first of such values counts


@dataclass(frozen=True)
class MeasuredFit:
    """Lights of a cluster.

    Attributes
    ----------
    error : float
        Mean relative difference of irradiance.
    cost : float
        The error, and more for lights that look unlike their patches.
    lights : tuple of Light
    """

    error: float
    cost: float
    lights: tuple[Light, ...]


@dataclass(eq=False)
class Node:
    """A cluster, its fits, and its halves; one without fits must be divided."""

    patches: Ints
    fits: list[MeasuredFit]
    halves: "tuple[Node, Node] | None" = None

    @property
    def least_error(self) -> float:
        """Of its own fits."""
        return min(fit.error for fit in self.fits)

    @property
    def least_cost(self) -> float:
        """The same of the cost."""
        return min(fit.cost for fit in self.fits)

    @cached_property
    def least_errors(self) -> F64:
        """The least error with at most 0, 1, 2 … ``MAX_LIGHTS`` lights."""
        return self._least(np.array([fit.error for fit in self.fits]), lambda half: half.least_errors)

    @cached_property
    def least_costs(self) -> F64:
        """The same of the cost."""
        return self._least(np.array([fit.cost for fit in self.fits]), lambda half: half.least_costs)

    def _least(self, values: F64, of_half: "Callable[[Node], F64]") -> F64:
        least = np.full(MAX_LIGHTS + 1, np.inf)
        for value, fit in zip(values, self.fits, strict=True):
            least[len(fit.lights):] = np.minimum(least[len(fit.lights):], value)
        return np.asarray(np.minimum(least, _add(*map(of_half, self.halves)).min(axis=1)) if self.halves else least)


FitLights = Callable[[Ints], list[MeasuredFit]]


def _add(one: F64, other: F64) -> F64:
    """Errors of two clusters with n lights in all (rows), of which k are the first one's (columns)."""
    n, k = np.mgrid[:MAX_LIGHTS + 1, :MAX_LIGHTS + 1]
    return np.asarray(np.where(k <= n, one[k] + other[np.maximum(n - k, 0)], np.inf))


def build_tree(patches: Patches, fit: FitLights, groups: Sequence[Ints], normal_scale: float, enough: float) -> Node:
    """A tree whose upper nodes join the groups, and that is finest where errors are large.

    Parameters
    ----------
    normal_scale : float
        Sizes of a cluster that a unit of difference between normals counts as.
    enough : float
        Sum of errors at which nothing is divided further.
    """
    def halve(node: Node) -> tuple[Node, Node]:
        rows = node.patches
        gains, sides = _divisions(patches.position[rows], patches.normal[rows], patches.weight[rows], normal_scale)
        return _halves(node, sides[_first_largest(np.array(gains))], fit)

    roots = [Node(rows, fit(rows)) for rows in groups]
    _grow(roots, halve, lambda node: len(node.patches) > 1, enough)
    return reduce(lambda a, b: Node(np.concatenate([a.patches, b.patches]), [], (a, b)), roots)


def build_tree_of_pieces(patches: Patches, fit: FitLights, enough: float) -> Node:
    """A tree of whole pieces, divided so that the halves' lights cost least: a row of tubes is a line."""
    def halve(node: Node) -> tuple[Node, Node]:
        pairs = [_halves(node, side, fit) for side in _sides_of_pieces(patches, node.patches)]
        return pairs[first_smallest(np.array([one.least_cost + other.least_cost for one, other in pairs]))]

    every = np.arange(len(patches.piece))
    root = Node(every, fit(every))
    _grow([root], halve, lambda node: len(np.unique(patches.piece[node.patches])) > 1, enough)
    return root


def _halves(node: Node, side: Bools, fit: FitLights) -> tuple[Node, Node]:
    one, other = (Node(rows, fit(rows)) for rows in (node.patches[side], node.patches[~side]))
    return one, other


def _grow(leaves: Iterable[Node], halve: Callable[[Node], tuple[Node, Node]], is_divisible: Callable[[Node], bool],
          enough: float) -> None:
    """Divide the leaves, the worst first, until there are ``MAX_LEAVES`` or their errors are ``enough`` in all."""
    leaves = list(leaves)
    while len(leaves) < MAX_LEAVES:
        costs = np.array([leaf.least_error * is_divisible(leaf) for leaf in leaves])
        if costs.sum() <= enough:
            return
        worst = _first_largest(costs)
        leaves[worst].halves = halves = halve(leaves[worst])
        leaves[worst:worst + 1] = halves


def cut(node: Node, count: int) -> Iterator[tuple[Node, tuple[Light, ...]]]:
    """The clusters, and their lights, of the cut that has the least cost with at most ``count`` lights."""
    own = min((fit for fit in node.fits if len(fit.lights) <= count), key=lambda fit: fit.cost, default=None)
    if own is not None and (node.halves is None or own.cost <= (1 + TIE) * node.least_costs[count]):
        yield node, own.lights
        return
    assert node.halves is not None, "a leaf has lights"
    one, other = node.halves
    first = first_smallest(_add(one.least_costs, other.least_costs)[count])
    yield from cut(one, first)
    yield from cut(other, count - first)


def _sides_of_pieces(patches: Patches, rows: Ints) -> Iterator[Bools]:
    """Different divisions of the patches ``rows`` in space that leave pieces whole, as one side of each."""
    piece, weight = np.unique(patches.piece[rows], return_inverse=True)[1].reshape(-1), patches.weight[rows]
    total = np.bincount(piece, weight).astype(np.float64)
    position = np.stack([np.bincount(piece, weight * values) for values in patches.position[rows].T], axis=1)
    known: set[bytes] = set()
    for side in _divisions(position / total[:, None], np.zeros_like(position), total, 0.0)[1]:
        code = (side ^ side[0]).tobytes()
        if side.any() and not side.all() and code not in known:
            known.add(code)
            yield side[piece]


def _divisions(position: F64, normal: F64, weight: F64, normal_scale: float) -> tuple[Sequence[float], Sequence[Bools]]:
    """One half of N patches for each of several axes of space and of normals, so that both halves vary least.

    Also how much less position and normal vary within the halves.
    """
    away = position - weight @ position / weight.sum()
    variances, axes = np.linalg.eigh(np.einsum("n,ni,nj->ij", weight, away, away) / weight.sum())
    size = float(np.sqrt(max(variances.sum(), 1e-300)))
    features = np.concatenate([away, normal_scale * size * normal], axis=1)
    keys = [*away.T, away @ axes[:, 2], *normal.T]
    gains, sides = zip(*(_split_along(key, features, weight) for key in keys), strict=True)
    return gains, sides


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


def first_smallest(values: F64) -> int:
    """Index of the first value that is smallest but for rounding."""
    return int(np.argmax(values <= values.min() * (1 + TIE)))


def _first_largest(values: F64) -> int:
    """Index of the first value that is largest but for rounding."""
    return int(np.argmax(values >= values.max() * (1 - TIE)))
