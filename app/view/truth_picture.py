"""The truth as a picture for the pages."""

from __future__ import annotations

from app.bench.truth import Truth
from app.image import srgb_encode, to_8bit
from app.view.encoder import jpeg, packed
from app.view.state import FINAL, State

LAYERS = ("direct", "indirect", "albedo")  # that a truth has besides the finished picture


def truth_picture(truth: Truth, state: State) -> bytes:
    """The layer of ``truth`` that is beside what ``state`` shows, as the message that carries it."""
    layer = state.aov if state.aov in LAYERS else FINAL
    exposure = 1.0 if layer == "albedo" else state.exposure
    picture = to_8bit(srgb_encode(truth.layers[layer] * exposure))
    return packed({"kind": "truth", "spp": truth.about["spp"]}, [jpeg(picture)])
