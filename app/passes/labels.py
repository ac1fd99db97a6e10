"""Which object and which material every pixel shows, and where its surface point is seen in the next frame.

Drawn through the middle of pixels, without the offsets of temporal anti-aliasing, and never blended: the nearest
surface counts, and a see-through one where it covers at least half of what is behind it.
"""

from dataclasses import replace

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.passes.gbuffer import draw_surfaces

DEFINES = {"instance": "WRITE_INSTANCE", "material": "WRITE_MATERIAL", "flow": "WRITE_MOTION"}


def declare() -> Pass:
    """Ids as floats, counted from 1, and 0 where nothing is seen; the flow is the motion from the next frame to this.

    32-bit floats: they hold all ids, and a hundredth of a pixel of any flow.
    """
    return Pass("labels", writes={"instance": Tex("f4", 1), "material": Tex("f4", 1), "flow": Tex("f4", 4)}, make=make)


def make(device: Device, bound: BoundPass) -> Execute:
    defines: dict[str, object] = {"LABELS": 1, **{DEFINES[name]: index for index, name in enumerate(bound.writes)}}

    def execute(frame: FrameState, resources: Resources) -> None:
        target = resources.target(with_depth=True)
        target.clear(depth=0.0)
        centred = replace(frame, previous=frame.following[0], jitter=(0.0, 0.0), accumulates=False)
        with frame.geometry.looking_ahead(frame.following[1]):
            draw_surfaces(device, centred, frame.view.clip_from_relative(), defines, is_see_through=None)

    return execute
