"""The judgement on one golden: how far it is from what was drawn now, and whether that is too far."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from app.errors import MissingExtraError
from app.evaluation.metrics import flip
from app.golden.case import F32, Picture, half
from app.golden.tolerance import PICTURES, Tolerance
from app.io.image import srgb_decode
from app.network.channels import HALF_MAX

EXACT = Tolerance(0.0, 0.0, 0.0)  # of two runs


@dataclass(frozen=True)
class Distance:
    """How far one frame is from its golden.

    Attributes
    ----------
    difference : float
        Largest difference of a component, relative to 1 + |golden|.
    share : float
        Share of the texels whose difference is beyond the tolerance.
    flip : float or None
        Mean HDR-FLIP; None for what is no picture, and without the package that computes it.
    """

    difference: float = 0.0
    share: float = 0.0
    flip: float | None = None

    def within(self, tolerance: Tolerance) -> bool:
        return self.share <= tolerance.share and (self.flip or 0.0) <= tolerance.flip


@dataclass(frozen=True, eq=False)
class Finding:
    """The judgement on one golden.

    Attributes
    ----------
    stage : str
        The pass that wrote it; empty for a file that no pass writes.
    verdict : str
        ``same``, ``close``, ``differs``, ``missing``, ``orphan``, or ``unsteady`` when two runs were not bit-identical.
    tolerance : Tolerance or None
        What held for it; None for a file that no pass writes.
    distance : Distance
        Of the worst frame.
    frame : int
        The worst frame; 0 where none was compared.
    golden, current : ndarray or None
        That frame, float32 [H, W, 1 to 4], where it is not the same; the two runs of an unsteady one.
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


def judge(case: str, picture: Picture, again: Picture, golden: dict[int, F32] | None, tolerance: Tolerance) -> Finding:
    """Compare two runs with each other, then with the golden."""
    same = Finding(case, picture.stage, picture.resource, "same", tolerance)
    for frame, image in picture.frames.items():
        if not np.array_equal(image, again.frames[frame], equal_nan=True):
            return replace(same, verdict="unsteady", tolerance=EXACT, frame=frame, golden=image,
                           current=again.frames[frame],
                           distance=compare(again.frames[frame], image, EXACT, picture.resource))
    current = {n: half(image).astype(np.float32) for n, image in picture.frames.items()}
    if golden is None or not current.keys() <= golden.keys():
        return replace(same, verdict="missing", current=next(iter(current.values())))
    if golden.keys() != current.keys():
        return replace(same, verdict="orphan")
    distances = {n: compare(image, golden[n], tolerance, picture.resource) for n, image in current.items()}
    frame = max(distances, key=lambda n: (not distances[n].within(tolerance), distances[n].share,
                                          distances[n].difference))
    worst = distances[frame]
    if worst.difference == 0.0:
        return same
    return replace(same, verdict="close" if worst.within(tolerance) else "differs", distance=worst, frame=frame,
                   golden=golden[frame], current=current[frame])


def compare(current: F32, golden: F32, tolerance: Tolerance, resource: str) -> Distance:
    """How far an image is from its golden; what is not a number in both is equal."""
    if current.shape != golden.shape:
        return Distance(math.inf, 1.0)
    off = texel_difference(current, golden)
    if not off.any():
        return Distance()
    return Distance(float(off.max()), float((off > tolerance.difference).mean()), _flip(current, golden, resource))


def texel_difference(current: F32, golden: F32) -> F32:
    """Largest difference of each texel's components, relative to 1 + |golden|; shape (H, W)."""
    with np.errstate(invalid="ignore"):
        off = np.abs(current - golden) / (1 + np.abs(golden))
    same = (current == golden) | (np.isnan(current) & np.isnan(golden))
    difference: F32 = np.where(same, 0.0, np.nan_to_num(off, nan=math.inf)).max(axis=2).astype(np.float32)
    return difference


def radiance(image: F32, resource: str) -> F32:
    """The linear colours of a picture, finite, shape (H, W, 3)."""
    colour = np.nan_to_num(image[..., :3], nan=0.0, posinf=HALF_MAX, neginf=0.0)
    return srgb_decode(colour) if resource == "display" else colour


def _flip(current: F32, golden: F32, resource: str) -> float | None:
    if resource not in PICTURES:
        return None
    try:
        return flip(radiance(current, resource), radiance(golden, resource))
    except MissingExtraError:
        return None
