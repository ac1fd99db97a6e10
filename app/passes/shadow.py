"""Shadow maps: linear distance from each light, in one atlas, redrawn only when a caster or a light moved."""

import moderngl

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.lights import NEAREST_TRANSMITTANCE, TRANSMITTANCE_MAPS, LightSet, ShadowFace
from app.gl.pool import Resources
from app.gl.shader import Program
from app.graph import BoundPass, Pass, Tex

TILE = 8      # texels along the edge of one texel of the nearest map, as in shadow_tile.glsl
NEAREST_OF = {"shadow_nearest": "shadow", NEAREST_TRANSMITTANCE: TRANSMITTANCE_MAPS[1]}
EMPTY = 1e30  # distance where nothing casts a shadow
MASK_FEATURES = ("ALPHA_MASK", "ALBEDO_MAP", "UV", "SECOND_UV", "VERTEX_COLOR", "BLENDED")
TRANSMITTANCE_FEATURES = (*MASK_FEATURES, "METALLIC", "METALLIC_ROUGHNESS_MAP", "TRANSMISSION_MAP")


def declare(lights: LightSet) -> Pass:
    """The pass for the atlas that ``lights`` laid out; it keeps its texels while nothing moves.

    ``shadow`` holds distances, ``shadow_slope`` how surfaces lie in the map, for hard shadows, and ``shadow_nearest``
    the smallest distance in each tile, for soft ones. ``shadow_transmittance`` holds the share of light that passes all
    blended and transmissive surfaces before the opaque one, ``shadow_transmittance_depth`` the distance of the nearest,
    and ``shadow_transmittance_nearest`` the smallest of these in each tile.
    """
    width, height = lights.atlas_size
    tiles = max(1, width // TILE), max(1, height // TILE)
    return Pass("shadow", writes={
        "shadow": Tex("f4", 1, size=(width, height)),
        "shadow_slope": Tex("f2", 2, size=(width, height)),
        "shadow_nearest": Tex("f4", 1, size=tiles),
        TRANSMITTANCE_MAPS[0]: Tex("f1", 4, size=(width, height)),
        TRANSMITTANCE_MAPS[1]: Tex("f4", 1, size=(width, height)),
        NEAREST_TRANSMITTANCE: Tex("f4", 1, size=tiles),
    }, make=make)


def make(device: Device, bound: BoundPass) -> Execute:
    reduced = {name: of for name, of in NEAREST_OF.items() if name in bound.writes}
    nearest = device.fullscreen("shadow_nearest.frag") if reduced else None
    maps = tuple(w for w in bound.writes if w in ("shadow", "shadow_slope"))

    is_tinted = TRANSMITTANCE_MAPS[0] in bound.writes

    def draw(frame: FrameState, resources: Resources, faces: list[ShadowFace]) -> None:
        target = resources.target(*maps, with_depth=True)
        device.ctx.enable_only(moderngl.DEPTH_TEST)
        device.ctx.depth_func = "<"
        for face in faces:
            target.clear(EMPTY, depth=1.0, viewport=face.rect)
            target.viewport, target.scissor = face.rect, _inner(face)
            _draw_face(device, frame, face, {"WRITE_" + name.upper(): i for i, name in enumerate(maps)})
        target.scissor = 0, 0, *target.size
        if is_tinted:
            _draw_transmittance(device, frame, resources, faces)
        device.ctx.enable_only(moderngl.NOTHING)
        for name, of in reduced.items():
            assert nearest is not None
            target = resources.target(name)
            resources[of].use(0)
            nearest.set(shadow=0)
            for face in faces:
                x, y, width, height = face.rect
                target.scissor = x // TILE, y // TILE, width // TILE, height // TILE
                device.draw_fullscreen(nearest)
            target.scissor = 0, 0, *target.size

    cascades: object = None  # that the atlas shows

    def execute(frame: FrameState, resources: Resources) -> None:
        nonlocal cascades
        if not resources.is_current(frame.lighting):
            draw(frame, resources, frame.lights.faces())
            resources.set_current(frame.lighting)
            cascades = None
        # Only the picture reads cascades, so what was made from the maps of the whole scene stays.
        if cascades != frame.lights.cascades:
            draw(frame, resources, frame.lights.cascade_faces())
            cascades = frame.lights.cascades

    return execute


def _draw_transmittance(device: Device, frame: FrameState, resources: Resources, faces: list[ShadowFace]) -> None:
    """Multiply what blended and transmissive surfaces leave of the light before what is opaque, then find the nearest.

    Both are drawn against the depth buffer of the opaque surfaces.
    """
    for name, empty, defines in ((TRANSMITTANCE_MAPS[0], 1.0, {"WRITE_SHADOW_TRANSMITTANCE": 0}),
                                 (TRANSMITTANCE_MAPS[1], EMPTY, {"WRITE_SHADOW": 0})):
        target = resources.target(name, with_depth=True)
        multiplies = "WRITE_SHADOW" in defines
        device.ctx.enable_only(moderngl.DEPTH_TEST if multiplies else moderngl.DEPTH_TEST | moderngl.BLEND)
        device.ctx.blend_func = moderngl.DST_COLOR, moderngl.ZERO
        for face in faces:
            target.depth_mask = False
            target.clear(empty, empty, empty, empty, viewport=face.rect)
            target.depth_mask = multiplies
            target.viewport, target.scissor = face.rect, _inner(face)
            _draw_face(device, frame, face, {**defines, "SEE_THROUGH": 1})
        target.scissor = 0, 0, *target.size


def _draw_face(device: Device, frame: FrameState, face: ShadowFace, writes: dict[str, object]) -> None:
    is_see_through = "SEE_THROUGH" in writes
    features = TRANSMITTANCE_FEATURES if "WRITE_SHADOW_TRANSMITTANCE" in writes else MASK_FEATURES

    def program_of(of_surface: tuple[str, ...]) -> Program:
        used = features if "ALPHA_MASK" in of_surface or is_see_through else ()
        defines = {**writes, **{f: 1 for f in of_surface if f in used}}
        if face.axis is not None:
            defines["PARALLEL"] = 1
        program = device.program("shadow.vert", "shadow.frag", defines=defines)
        program.set(clip_from_relative=face.clip, frame=face.frame)
        return program

    geometry = frame.geometry
    casters = geometry.is_see_through == is_see_through
    if face.axis is None:
        casters &= ~geometry.is_light_proxy  # which might be the light's own surfaces; none are those of parallel light
    geometry.draw(casters & geometry.visible(face.clip, face.origin), program_of, face.origin, for_light=True)


def _inner(face: ShadowFace) -> tuple[int, int, int, int]:
    """The square; of parallel light without the texels at its edge, which stand for all that lies outside: nothing."""
    if face.axis is None:
        return face.rect
    x, y, width, height = face.rect
    return x + 1, y + 1, width - 2, height - 2
