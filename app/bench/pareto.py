"""Speed against error: the Pareto front, and the two headline figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

MIN_ERROR = 1e-9  # keeps logarithms finite

EXACT, AT_LEAST, AT_MOST = "", "≥", "≤"


@dataclass(frozen=True)
class Point:
    """A picture that takes ``ms`` milliseconds and is ``error`` away from the reference."""

    name: str
    ms: float
    error: float


@dataclass(frozen=True)
class Ratio:
    """A factor; ``bound`` says whether the true one is at least or at most that much."""

    value: float
    bound: str = EXACT

    def to_json(self) -> dict[str, float | str]:
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.bound}{self.value:.3g}×"


def pareto_front(points: Iterable[Point]) -> list[Point]:
    """Points that no other one beats in both time and error, by rising time and falling error."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (p.ms, p.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


def speed_up(ours: Point, baseline: Sequence[Point]) -> Ratio:
    """Speed-up at equal error: the time in which ``baseline`` gets as near to the reference as ``ours``, over our time.

    Between two of the baseline's points on its front, log(time) is linear in log(error). When even its fastest
    picture is nearer, this is at most the ratio to that one; when its best is farther, at least that to its best.
    """
    front = pareto_front(baseline)
    if front[0].error <= ours.error:
        exact = front[0].error == ours.error
        return Ratio(front[0].ms / ours.ms, EXACT if exact else AT_MOST)
    if front[-1].error > ours.error:
        return Ratio(front[-1].ms / ours.ms, AT_LEAST)
    slow = next(i for i, p in enumerate(front) if p.error <= ours.error)
    a, b = front[slow - 1], front[slow]
    return Ratio(_between(a.error, b.error, a.ms, b.ms, ours.error) / ours.ms)


def error_ratio(ours: Point, baseline: Sequence[Point]) -> Ratio:
    """Error ratio at equal time: the error that ``baseline`` has left after our time, over our error.

    Interpolated as in ``speed_up``. When the baseline has no picture in that time, this is at least the ratio to its
    fastest; when it has long finished its best, at most that to its best.
    """
    front = pareto_front(baseline)
    least = max(ours.error, MIN_ERROR)
    if ours.ms < front[0].ms:
        return Ratio(front[0].error / least, AT_LEAST)
    if ours.ms >= front[-1].ms:
        return Ratio(front[-1].error / least, EXACT if ours.ms == front[-1].ms else AT_MOST)
    late = next(i for i, p in enumerate(front) if p.ms > ours.ms)
    a, b = front[late - 1], front[late]
    return Ratio(_between(a.ms, b.ms, a.error, b.error, ours.ms) / least)


def mean_ratio(ratios: Sequence[Ratio]) -> Ratio:
    """Geometric mean; a bound only where every inexact ratio is bounded on the same side, else ``≈``."""
    value = math.exp(sum(math.log(max(r.value, MIN_ERROR)) for r in ratios) / len(ratios))
    bounds = {r.bound for r in ratios} - {EXACT}
    return Ratio(value, bounds.pop() if len(bounds) == 1 else "≈" if bounds else EXACT)


def _between(x0: float, x1: float, y0: float, y1: float, x: float) -> float:
    """Log-log interpolation."""
    lx0, lx1, ly0, ly1, lx = (math.log(max(v, MIN_ERROR)) for v in (x0, x1, y0, y1, x))
    return math.exp(ly0 + (ly1 - ly0) * (lx - lx0) / (lx1 - lx0))
