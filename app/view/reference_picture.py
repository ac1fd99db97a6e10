"""The reference as a picture for the pages."""

from __future__ import annotations

from app.evaluation.reference import Reference
from app.io.image import srgb_encode, to_8bit
from app.view.encoder import jpeg, packed
from app.view.state import FINAL, State

LAYERS = ("direct", "indirect", "albedo")  # that a reference has besides the finished picture


def reference_picture(reference: Reference, state: State) -> bytes:
    """The layer of ``reference`` that is beside what ``state`` shows, as the message that carries it."""
    layer = state.aov if state.aov in LAYERS else FINAL
    exposure = 1.0 if layer == "albedo" else state.exposure
    picture = to_8bit(srgb_encode(reference.layers[layer] * exposure))
    return packed({"kind": "reference", "spp": reference.about["spp"]}, [jpeg(picture)])
