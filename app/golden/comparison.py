"""Comparison of a picture with its golden."""

import math
from dataclasses import dataclass, replace

import numpy as np

from app.arrays import F32
from app.errors import MissingExtraError
from app.evaluation.metrics import flip
from app.golden.case import Picture, half
from app.golden.tolerance import PICTURES, Tolerance
from app.io.image import srgb_decode
from app.network.channels import HALF_MAX

EXACT = Tolerance(0.0, 0.0, 0.0)  # between two runs


@dataclass(frozen=True)
class Distance:
    """Difference of one frame from its golden.

    Attributes
    ----------
    difference : float
        Largest difference of a component, relative to 1 + |golden|.
    share : float
        Share of texels whose difference exceeds the tolerance.
    flip : float or None
        Mean HDR-FLIP; None for resources that are not pictures, and without the package that computes it.
    """

    difference: float = 0.0
    share: float = 0.0
    flip: float | None = None

    def within(self, tolerance: Tolerance) -> bool:
        return self.share <= tolerance.share and (self.flip or 0.0) <= tolerance.flip


@dataclass(frozen=True, eq=False)
class Finding:
    """The result of comparing one picture with its golden.

    Attributes
    ----------
    stage : str
        Pass that wrote it; empty for a file that no pass writes.
    verdict : str
        ``same``, ``close`` (within tolerance), ``differs``, ``missing``, ``orphan`` (no pass writes it), or
        ``unsteady`` (two runs were not bit-identical).
    tolerance : Tolerance or None
        The tolerance that applied; None for a file that no pass writes.
    distance : Distance
        Difference of the worst frame.
    frame : int
        Number of the worst frame; 0 if none was compared.
    golden, current : ndarray or None
        That frame, float32, shape (H, W, 1 to 4), unless it is the same; for an unsteady one, the two runs.
    """

    case: str
    stage: str
    resource: str
    verdict: str
    tolerance: Tolerance | None = None
    distance: Distance = Distance()
    frame: int = 0
    golden: F32 | None = None
    current: F32 | None = None

    @property
    def ok(self) -> bool:
        return self.verdict in ("same", "close")


def compare(case: str, picture: Picture, second_run: Picture, golden: dict[int, F32] | None,
            tolerance: Tolerance) -> Finding:
    """Compare two runs with each other, then the first with the golden."""
    same = Finding(case, picture.stage, picture.resource, "same", tolerance)
    for frame, image in picture.frames.items():
        second = second_run.frames[frame]
        if not np.array_equal(image, second, equal_nan=True):
            return replace(same, verdict="unsteady", tolerance=EXACT, frame=frame, golden=image, current=second,
                           distance=measure_distance(second, image, EXACT, picture.resource))
    current = {n: half(image).astype(np.float32) for n, image in picture.frames.items()}
    if golden is None or not current.keys() <= golden.keys():
        return replace(same, verdict="missing", current=next(iter(current.values())))
    if golden.keys() != current.keys():
        return replace(same, verdict="orphan")
    distances = {n: measure_distance(image, golden[n], tolerance, picture.resource) for n, image in current.items()}
    frame = max(distances, key=lambda n: (not distances[n].within(tolerance), distances[n].share,
                                          distances[n].difference))
    worst = distances[frame]
    if worst.difference == 0.0:
        return same
    return replace(same, verdict="close" if worst.within(tolerance) else "differs", distance=worst, frame=frame,
                   golden=golden[frame], current=current[frame])


def measure_distance(current: F32, golden: F32, tolerance: Tolerance, resource: str) -> Distance:
    """Difference of an image from its golden; NaN equals NaN."""
    if current.shape != golden.shape:
        return Distance(math.inf, 1.0)
    difference = texel_difference(current, golden)
    if not difference.any():
        return Distance()
    share = float((difference > tolerance.difference).mean())
    return Distance(float(difference.max()), share, _flip(current, golden, resource))


def texel_difference(current: F32, golden: F32) -> F32:
    """Largest difference of each texel's components, relative to 1 + |golden|; shape (H, W)."""
    with np.errstate(invalid="ignore"):
        relative = np.abs(current - golden) / (1 + np.abs(golden))
    same = (current == golden) | (np.isnan(current) & np.isnan(golden))
    difference: F32 = np.where(same, 0.0, np.nan_to_num(relative, nan=math.inf)).max(axis=2).astype(np.float32)
    return difference


def radiance(image: F32, resource: str) -> F32:
    """The linear, finite colours of a picture, shape (H, W, 3)."""
    color = np.nan_to_num(image[..., :3], nan=0.0, posinf=HALF_MAX, neginf=0.0)
    return srgb_decode(color) if resource == "display" else color


def _flip(current: F32, golden: F32, resource: str) -> float | None:
    if resource not in PICTURES:
        return None
    try:
        return flip(radiance(current, resource), radiance(golden, resource))
    except MissingExtraError:
        return None
