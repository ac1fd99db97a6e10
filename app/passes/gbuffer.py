"""The G-buffer: attributes of the nearest opaque surface in every texel of the screen or of the cube around the camera.

Layers of blended and transmissive surfaces before it are peeled (Everitt 2001), each into a G-buffer of its own.
"""

from collections.abc import Iterable, Mapping

import moderngl

from app.arrays import F64
from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import write_defines
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.gl.shader import Program
from app.gl.surface import MAP_UNITS
from app.graph import BoundPass, Pass, Resource, Tex
from app.math3d import GOLDEN_RATIO, affine_matrix, cube_rotations, perspective_reversed
from app.scene import Scene

FEATURES = (*(name.upper() for name in MAP_UNITS), "UV", "SECOND_UV", "TANGENT", "VERTEX_COLOR", "ALPHA_MASK",
            "METALLIC", "SPECULAR", "CLEARCOAT", "SHEEN", "UNLIT", "BLENDED", "TRANSMISSION")
MAX_ATTACHMENTS = 8
LOD_BIAS = -2.0  # of frames that are averaged, at the image's size
PEEL_UNITS = {"opaque_depth": 13, "nearer_depth": 14}  # texture units beyond those of materials


def gbuffer_targets(scene: Scene, size: tuple[int, int] | None = None) -> dict[str, Resource]:
    """What a G-buffer of ``scene`` can hold; nothing that the scene does not need."""
    color = Tex("f2", 4, size=size)
    targets: dict[str, Resource] = {"albedo": color, "normal": color, "depth": Tex("f4", 1, size=size)}
    if any(m.emits or m.is_unlit for m in scene.materials):
        targets["emission"] = color
    if any(m.has_specular for m in scene.materials):
        targets["specular_roughness"] = color
    if any(m.occlusion_map is not None for m in scene.materials):
        targets["occlusion"] = Tex("f1", 1, size=size)
    if any(m.normal_map is not None for m in scene.materials):
        targets["smooth_normal"] = color
    return targets


def declare(scene: Scene) -> Pass:
    """The screen's G-buffer."""
    return Pass("gbuffer", writes={**gbuffer_targets(scene), "motion": Tex("f2", 4)}, make=make)


def declare_layers(layers: Iterable[str]) -> Pass:
    """What lies over some surfaces, ``clearcoat`` and ``sheen``; OpenGL promises only 8 targets for one pass."""
    return Pass("gbuffer_layers", writes={name: Tex("f2", 4) for name in layers}, make=make)


def make(device: Device, bound: BoundPass) -> Execute:
    assert len(bound.writes) <= MAX_ATTACHMENTS, bound.writes

    def execute(frame: FrameState, resources: Resources) -> None:
        target = resources.target(with_depth=True)
        target.clear(depth=0.0)
        draw_surfaces(device, frame, frame.view.clip_from_relative(frame.jitter), write_defines(bound.writes))

    return execute


def declare_cube(scene: Scene, face: int, camera_axes: bool) -> Pass:
    """The cube's G-buffer: an atlas row of faces with ``face`` texels a side, in contract order."""
    writes = {f"cube_{name}": tex for name, tex in gbuffer_targets(scene, (6 * face, face)).items()}

    def make_cube(device: Device, bound: BoundPass) -> Execute:
        rotations = cube_rotations()

        def execute(frame: FrameState, resources: Resources) -> None:
            target = resources.target(with_depth=True)
            target.viewport = (0, 0, *target.size)
            target.clear(depth=0.0)
            for index, rotation in enumerate(rotations):
                target.viewport = (index * face, 0, face, face)
                axes = affine_matrix(rotation @ frame.view.rotation if camera_axes else rotation)
                defines = {**write_defines(bound.writes, "cube_"), "GRID_CUBE": 1}
                draw_surfaces(device, frame, perspective_reversed(1.0, 1.0, frame.view.near) @ axes, defines)

        return execute

    return Pass("cube_gbuffer", writes=writes, make=make_cube)


def declare_peeled(scene: Scene, layers: Iterable[str], peeled: PeeledLayer, before: PeeledLayer | None) -> Pass:
    """The nearest surfaces that are seen through, behind those of the layer before and before the screen's G-buffer.

    Their albedo and emission are multiplied by their coverage.
    """
    prefix = peeled.prefix
    depths = {"opaque_depth": "depth", **({"nearer_depth": before.prefix + "depth"} if before is not None else {})}
    color = Tex("f2", 4)
    writes = {name: tex for name, tex in gbuffer_targets(scene).items() if name != "occlusion"}
    writes |= dict.fromkeys((*layers, "passage"), color)
    if any(m.transmission is not None for m in scene.materials):
        writes["refraction"] = color
    if any(m.is_volume for m in scene.materials):
        writes["volume"] = color
    if before is None:
        writes["motion"] = color

    def make_layer(device: Device, bound: BoundPass) -> Execute:
        defines = {"SEE_THROUGH": 1, **{f"HAS_{sampler.upper()}": 1 for sampler in depths}}

        def execute(frame: FrameState, resources: Resources) -> None:
            for sampler, resource in depths.items():
                resources[resource].use(PEEL_UNITS[sampler])
            for group in _attachments(bound):
                resources.target(*group, with_depth=True).clear(depth=0.0)
                with peeled.watch(device):
                    draw_surfaces(device, frame, frame.view.clip_from_relative(frame.jitter),
                                  {**defines, **write_defines(group, prefix)}, True,
                                  {sampler: PEEL_UNITS[sampler] for sampler in depths})

        return execute

    return Pass(f"{prefix}gbuffer", reads=tuple(depths.values()),
                writes={prefix + name: tex for name, tex in writes.items()}, make=make_layer)


def _attachments(bound: BoundPass) -> list[tuple[str, ...]]:
    """What the pass writes, in groups that fit into one framebuffer; OpenGL promises only 8 targets."""
    return [bound.writes[start:start + MAX_ATTACHMENTS] for start in range(0, len(bound.writes), MAX_ATTACHMENTS)]


def draw_surfaces(device: Device, frame: FrameState, clip: F64, defines: dict[str, object],
                  is_see_through: bool | None = False, samplers: Mapping[str, int] | None = None) -> None:
    """Draw what the frustum of ``clip`` may see into the bound target, reversed Z.

    Parameters
    ----------
    is_see_through : bool or None
        Which surfaces to draw: those that are blended or transmit light, or the others; None for all.
    samplers : mapping of str to int, optional
        Texture units of samplers that are no maps of materials.
    """
    device.ctx.enable_only(moderngl.DEPTH_TEST)
    device.ctx.depth_func = ">"
    moving = "WRITE_MOTION" in defines
    previous_clip = frame.previous.clip_from_relative()
    averages = frame.accumulates and "GRID_CUBE" not in defines
    dithers = averages and not device.mixes_levels
    if averages:
        defines = {**defines, "ACCUMULATES": 1}
    footprint = frame.size[1] / frame.output_size[1] * 2.0 ** (LOD_BIAS + (_dither(frame) if dithers else 0.0))

    def program_of(features: tuple[str, ...]) -> Program:
        used = {f: 1 for f in features if f in FEATURES or (moving and f == "DEFORMED")}
        program = device.program("gbuffer.vert", "gbuffer.frag", defines={**defines, **used})
        program.set(clip_from_relative=clip, **(samplers or {}))
        if averages:
            program.set(footprint=footprint)
        if moving:
            program.set(previous_clip=previous_clip, jitter=frame.jitter)
            if frame.view.is_orthographic:
                program.set(near=frame.view.near, far=(frame.view.far, frame.previous.far))
        return program

    visible = frame.geometry.visible(clip, frame.view.eye)
    if is_see_through is not None:
        visible &= frame.geometry.is_see_through == is_see_through
    frame.geometry.draw(visible, program_of, frame.view.eye, frame.previous.eye if moving else None,
                        one_level=dithers)


def _dither(frame: FrameState) -> float:
    """Levels of detail, in [-0.5, 0.5), by which this frame's lookups are off: over frames, one level mixes two."""
    return (frame.noise_phase + 0.5 + GOLDEN_RATIO * frame.index) % 1.0 - 0.5
