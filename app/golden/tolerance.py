"""How much each stage may differ from its golden."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerance:
    """Bounds on the difference of one stage.

    Attributes
    ----------
    difference : float
        A texel differs if one of its components differs by more than this times 1 + |golden|.
    share : float
        Largest share of texels that may differ.
    flip : float
        Largest mean HDR-FLIP, for pictures only; one unit in the last place of a half in every texel gives 0.004.
    """

    difference: float
    share: float
    flip: float


PICTURES = frozenset({"direct", "specular", "indirect", "emission", "lit", "taa", "sharpened", "display"})

OTHER_STAGES = "all others"

# Surfels are chosen by a chain of comparisons, so rounding may replace some of them and renumber others. Gathered rays,
# those of layers and reflected ones end at their light.
_SURFELS = {
    **{stage: Tolerance(2e-2, 1e-1, 0.0) for stage in ("surfel_light", "pack_surfels", "gather_history")},
    **{stage: Tolerance(1.5e-2, 5e-4, 5e-3) for stage in (
        "reflection_rays", "reflection_resolve", "reflection_history", "reflection_filter_far",
        "reflection_filter_near", "reflection")},
}
# The same renderer may round differently on another CPU. TAA's frame count depends on rounding most; one of the 255
# levels of the display image is 0.004.
SAME_RENDERER = {
    **_SURFELS,
    "gather_rays": Tolerance(1.5e-2, 5e-4, 0.0),
    **{stage: Tolerance(2e-2, 1e-2, 0.0) for stage in ("gradient_filter_near", "gradient_filter_far")},
    "layer_light": Tolerance(2e-2, 2e-2, 0.0),  # one of 80 texels: on some CPUs it differs by 0.022
    # Rounding moves what is refracted, and which pixel of a tile is the first that the low-resolution grid misses. Few
    # gathered rays light what is seen through.
    **{stage: Tolerance(1.5e-2, 5e-4, 8e-3) for stage in ("peel0_blend", "peel1_blend")},
    "missed_pixels": Tolerance(2e-3, 1e-2, 0.0),
    **{stage: Tolerance(2e-2, 1e-2, 5e-3) for stage in ("taa", "upscale_guide", "upscale")},
    "tonemap": Tolerance(5e-3, 1e-3, 5e-3),
    OTHER_STAGES: Tolerance(2e-3, 5e-4, 5e-3),
}
# Another renderer also rasterises edges, filters textures and orders sums differently.
OTHER_RENDERER = {
    **_SURFELS,
    "direct": Tolerance(2e-2, 2e-2, 2e-2),
    "composite": Tolerance(2e-2, 2e-2, 2e-2),
    **{stage: Tolerance(2e-1, 5e-2, 2e-2) for stage in ("taa", "upscale_guide", "upscale")},
    "sharpen": Tolerance(2e-1, 5e-2, 2e-2),
    "tonemap": Tolerance(2e-2, 2e-2, 2e-2),
    OTHER_STAGES: Tolerance(2e-2, 1e-2, 2e-2),
}


def tolerance(stage: str, foreign: bool) -> Tolerance:
    """The tolerance of a stage; ``foreign`` if its golden comes from another renderer."""
    table = OTHER_RENDERER if foreign else SAME_RENDERER
    return table.get(stage, table[OTHER_STAGES])
