"""Small shadow maps, for tests that draw a lot and where the edge of a shadow plays no part.

On a software renderer full ones take most of the time of a small picture.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from app.gl import shadow_atlas

FACTOR = 8


@contextmanager
def coarse_shadow_maps() -> Iterator[None]:
    """Renderers that are made inside have shadow maps with an eighth of their usual sides."""
    with pytest.MonkeyPatch.context() as patch:
        faces = {kind: side // FACTOR for kind, side in shadow_atlas.FACE_TEXELS.items()}
        patch.setattr(shadow_atlas, "FACE_TEXELS", faces)
        patch.setattr(shadow_atlas, "HARD_CUBE_TEXELS", shadow_atlas.HARD_CUBE_TEXELS // FACTOR)
        yield
