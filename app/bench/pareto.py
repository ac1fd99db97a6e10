"""The Pareto front of speed against error, and ratios that compare a point with such a front."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

MIN_ERROR = 1e-9  # keeps logarithms finite

EXACT, AT_LEAST, AT_MOST = "", "≥", "≤"


class Point(NamedTuple):
    """A picture that takes ``ms`` milliseconds and has the given ``error``."""

    ms: float
    error: float


@dataclass(frozen=True)
class Ratio:
    """A factor; ``bound`` says whether the exact one is at least or at most ``value``."""

    value: float
    bound: str = EXACT


def pareto_front(points: Iterable[Point]) -> list[Point]:
    """Points that no other point beats in both time and error, by rising time and falling error."""
    pareto: list[Point] = []
    for point in sorted(points):
        if not pareto or point.error < pareto[-1].error:
            pareto.append(point)
    return pareto


def speed_up(ours: Point, baseline: Sequence[Point]) -> Ratio:
    """Speed-up at equal error: the time in which ``baseline`` reaches the error of ``ours``, divided by our time.

    Between neighbouring points of the baseline's Pareto front log(time) is linear in log(error). If even its fastest
    picture has a smaller error, the ratio to that one is an upper bound; if its best has a larger error, the ratio
    to its best is a lower bound.
    """
    pareto = pareto_front(baseline)
    if pareto[0].error <= ours.error:
        exact = pareto[0].error == ours.error
        return Ratio(pareto[0].ms / ours.ms, EXACT if exact else AT_MOST)
    if pareto[-1].error > ours.error:
        return Ratio(pareto[-1].ms / ours.ms, AT_LEAST)
    slower = next(i for i, p in enumerate(pareto) if p.error <= ours.error)
    a, b = pareto[slower - 1], pareto[slower]
    return Ratio(_interpolate(a.error, b.error, a.ms, b.ms, ours.error) / ours.ms)


def error_ratio(ours: Point, baseline: Sequence[Point]) -> Ratio:
    """Error ratio at equal time: the error of ``baseline`` after our time, divided by our error.

    Interpolated as in ``speed_up``. If the baseline has no picture by then, the ratio to its fastest is a lower
    bound; if its best picture takes less time, the ratio to its best is an upper bound.
    """
    pareto = pareto_front(baseline)
    error = max(ours.error, MIN_ERROR)
    if ours.ms < pareto[0].ms:
        return Ratio(pareto[0].error / error, AT_LEAST)
    if ours.ms >= pareto[-1].ms:
        return Ratio(pareto[-1].error / error, EXACT if ours.ms == pareto[-1].ms else AT_MOST)
    later = next(i for i, p in enumerate(pareto) if p.ms > ours.ms)
    a, b = pareto[later - 1], pareto[later]
    return Ratio(_interpolate(a.ms, b.ms, a.error, b.error, ours.ms) / error)


def mean_ratio(ratios: Sequence[Ratio]) -> Ratio:
    """Geometric mean; a bound if all inexact ratios are bounded on the same side, ``≈`` if on both."""
    value = math.exp(sum(math.log(max(r.value, MIN_ERROR)) for r in ratios) / len(ratios))
    bounds = {r.bound for r in ratios} - {EXACT}
    return Ratio(value, bounds.pop() if len(bounds) == 1 else "≈" if bounds else EXACT)


def _interpolate(x0: float, x1: float, y0: float, y1: float, x: float) -> float:
    """Log-log interpolation of y at ``x``."""
    lx0, lx1, ly0, ly1, lx = (math.log(max(v, MIN_ERROR)) for v in (x0, x1, y0, y1, x))
    return math.exp(ly0 + (ly1 - ly0) * (lx - lx0) / (lx1 - lx0))
