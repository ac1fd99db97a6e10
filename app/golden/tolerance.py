"""How far each stage may be from its golden."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerance:
    """Bounds of one stage's difference.

    Attributes
    ----------
    difference : float
        A texel is off when one of its components differs by more than this times 1 + |golden|.
    share : float
        Largest share of the texels that may be off.
    flip : float
        Largest mean HDR-FLIP, of pictures alone; a last bit of half precision off in every texel makes 0.004.
    """

    difference: float
    share: float
    flip: float


PICTURES = frozenset({"direct", "specular", "indirect", "emission", "lit", "taa", "display"})

REST = "every other stage"

# Where surfels lie is a chain of comparisons, so rounding moves some of them, and the numbers of those between.
_SURFELS = {stage: Tolerance(2e-2, 1e-1, 0.0) for stage in ("surfel_light", "pack_surfels")}
# The same renderer may round otherwise on another CPU. TAA's count of frames hangs on rounding most of all; one of the
# 255 levels of the display image is 0.004.
SAME_RENDERER = {
    **_SURFELS,
    "taa": Tolerance(2e-2, 1e-2, 5e-3),
    "tonemap": Tolerance(5e-3, 1e-3, 5e-3),
    REST: Tolerance(2e-3, 5e-4, 5e-3),
}
# Another one also rasterises edges, filters textures and orders sums otherwise.
OTHER_RENDERER = {
    **_SURFELS,
    "direct": Tolerance(2e-2, 2e-2, 2e-2),
    "composite": Tolerance(2e-2, 2e-2, 2e-2),
    "taa": Tolerance(2e-1, 5e-2, 2e-2),
    "tonemap": Tolerance(2e-2, 2e-2, 2e-2),
    REST: Tolerance(2e-2, 1e-2, 2e-2),
}


def tolerance(stage: str, foreign: bool) -> Tolerance:
    """Of a stage; ``foreign`` when its golden comes from another renderer."""
    table = OTHER_RENDERER if foreign else SAME_RENDERER
    return table.get(stage, table[REST])
