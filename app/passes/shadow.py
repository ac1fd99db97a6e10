"""Shadow maps: linear distance from each light, in one atlas, redrawn only when a caster or a light moved."""

import moderngl

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import write_defines
from app.gl.geometry import Drawable
from app.gl.lights import LightSet, ShadowFace
from app.gl.pool import Resources
from app.gl.shader import Program
from app.graph import BoundPass, Pass, Tex

TILE = 8      # texels along the edge of one texel of the nearest map, as in shadow_tile.glsl
EMPTY = 1e30  # distance where nothing casts a shadow
MASK_FEATURES = ("ALPHA_MASK", "ALBEDO_MAP", "VERTEX_COLOR")


def declare(lights: LightSet) -> Pass:
    """The pass for the atlas that ``lights`` laid out; it keeps its texels while nothing moves.

    ``shadow`` holds distances, ``shadow_slope`` how surfaces lie in the map, for hard shadows, and ``shadow_nearest``
    the smallest distance in each tile, for soft ones.
    """
    width, height = lights.atlas_size
    return Pass("shadow", writes={
        "shadow": Tex("f4", 1, size=(width, height)),
        "shadow_slope": Tex("f2", 2, size=(width, height)),
        "shadow_nearest": Tex("f4", 1, size=(max(1, width // TILE), max(1, height // TILE))),
    }, make=make)


def make(device: Device, bound: BoundPass) -> Execute:
    nearest = device.fullscreen("shadow_nearest.frag") if "shadow_nearest" in bound.writes else None
    maps = tuple(w for w in bound.writes if w != "shadow_nearest")

    def execute(frame: FrameState, resources: Resources) -> None:
        if resources.is_current(frame.lighting):
            return
        target = resources.target(*maps, with_depth=True)
        target.viewport = (0, 0, *target.size)
        target.clear(EMPTY, depth=1.0)
        device.ctx.enable_only(moderngl.DEPTH_TEST)
        device.ctx.depth_func = "<"
        for face in frame.lights.faces():
            target.viewport = face.rect
            _draw_face(device, frame, face, write_defines(bound))
        if nearest is not None:
            resources.target("shadow_nearest")
            device.ctx.enable_only(moderngl.NOTHING)
            resources["shadow"].use(0)
            nearest.set(shadow=0)
            device.draw_fullscreen(nearest)
        resources.set_current(frame.lighting)

    return execute


def _draw_face(device: Device, frame: FrameState, face: ShadowFace, writes: dict[str, object]) -> None:
    def program_of(d: Drawable) -> Program:
        defines = {**writes, **{f: 1 for f in d.features if f in MASK_FEATURES and d.masked}}
        if face.axis is not None:
            defines["PARALLEL"] = 1
        program = device.program("shadow.vert", "shadow.frag", defines=defines)
        program.set(clip_from_relative=face.clip, frame=face.frame)
        return program

    casters = frame.geometry.visible(face.clip, face.origin, lambda d: not d.material.is_light_proxy)
    frame.geometry.draw(casters, program_of, face.origin)
