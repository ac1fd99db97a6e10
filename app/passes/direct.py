"""Direct light: diffuse radiance of lights with shadows, and specular light where a material has any."""

from collections.abc import Callable, Mapping
from functools import partial

import moderngl
import numpy as np

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import CUBE_PREFIX, always, cube_defines, make_fullscreen, quads_share_taps, ratio_to
from app.gl.lights import LightSet
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.gl.receiver_tiles import TILE
from app.gl.shadow_rays import specular_defines
from app.graph import BoundPass, Pass, Resource, Tex
from app.math3d import GOLDEN_RATIO
from app.paths import data_dir

MAX_SPLIT_LIGHTS = 2  # with shadow maps, whose unlit sides are left out in a step of their own; more leave little unlit
LTC_UNIT = 32  # texture unit of the table of specular lobes, beyond the 16 or 32 that one stage can have samplers for


def declare(lights: LightSet, has_specular: bool, shadow_grid: tuple[int, int] | None, has_sky: bool,
            layers: tuple[str, ...], has_normal_maps: bool, layer: PeeledLayer | None = None,
            sky_is_reflected: bool = False, sky_is_gathered: bool = False) -> Pass:
    """On the screen; specular light only where a material has a specular lobe.

    With TAA each frame samples penumbrae at other points; without it the points are fixed per texel, so that static
    pictures stay static.

    Parameters
    ----------
    shadow_grid : tuple of int or None
        Width and height of the grid of traced shadows; None where there are none.
    has_sky : bool
        Whether the environment is direct light, with traced shadows if there is a ``shadow_grid``.
    layers : tuple of str
        Those of ``clearcoat`` and ``sheen`` that the G-buffer has.
    has_normal_maps : bool
        Whether shading normals can face lights that the surface does not.
    layer : PeeledLayer or None
        What to light, instead of the G-buffer.
    sky_is_reflected : bool
        Whether smooth surfaces reflect the environment elsewhere, by rays; of a layer, where it is an outer surface.
    sky_is_gathered : bool
        Whether diffuse light of the environment is added elsewhere.
    """
    prefix = "" if layer is None else layer.prefix
    writes: dict[str, Resource] = {prefix + "direct": Tex("f2", 4)}
    if has_specular:
        writes[prefix + "specular"] = Tex("f2", 4)
    surface = (prefix + name for name in (
        "albedo", "normal", "depth", *(("specular_roughness",) if has_specular else ()), *layers))
    reads = (*surface, *lights.shadow_maps, *(("shadow_ratio", "shadow_gbuffer") if shadow_grid is not None else ()),
             *(("sky_irradiance",) if has_sky else ()), *(("sky_specular",) if has_sky and has_specular else ()),
             *(("smooth_normal",) if layer is None and has_normal_maps and shadow_grid is not None else ()))
    defines = {**lights.defines, **({"HAS_NEAR_CASCADE": 1} if lights.has_cascades else {}),
               "SKY_TILE": f"{TILE}.0", **({"NORMAL_MAPS": 1} if has_normal_maps else {}),
               **{f"HAS_{name.upper()}": 1 for name in layers}, **({"WIDE_SHADOW_RATIO": 1} if prefix else {}),
               **({"SKY_IS_REFLECTED" if layer is None else "IS_OUTER": 1} if sky_is_reflected else {}),
               **({"SKY_IS_GATHERED": 1} if sky_is_gathered else {}),
               **({"HAS_SPECULAR_SURFACES": 1} if has_specular else {})}

    has_outer = has_sky and (sky_is_reflected if layer is not None else "clearcoat" in layers)
    optional = ("sky_visible", *(("outer_depth",) if has_outer else ()),
                *(("environment_diffuse", "environment_specular") if layer is None else ()))
    return Pass(prefix + "direct", reads=reads, optional=optional, writes=writes,
                make=lambda device, bound: _make(device, bound, defines, shadow_grid, bool(layers), layer))


def declare_cube(lights: LightSet, face: int, camera_axes: bool, is_traced: bool, has_sky: bool,
                 has_normal_maps: bool) -> Pass:
    """On the cube around the camera; diffuse only, since networks read no specular light."""
    reads = ("cube_albedo", "cube_normal", "cube_depth", *lights.shadow_maps,
             *(("cube_shadow_ratio",) if is_traced else ()), *(("sky_irradiance",) if has_sky else ()))
    defines = {**lights.defines, **cube_defines(face, camera_axes), **({"NORMAL_MAPS": 1} if has_normal_maps else {})}
    return Pass("cube_direct", reads=reads, writes={"cube_direct": Tex("f2", 4, size=(6 * face, face))},
                make=make_fullscreen("direct.frag", lambda frame: {
                    "noise_phase": frame.noise_phase % 1.0, **frame.lights.bind_light_images()}, defines, CUBE_PREFIX))


def _make(device: Device, bound: BoundPass, defines: Mapping[str, object], shadow_grid: tuple[int, int] | None,
          has_layers: bool, layer: PeeledLayer | None) -> Execute:
    prefix = "" if layer is None else layer.prefix
    has_specular = prefix + "specular" in bound.writes
    if shadow_grid is not None and layer is None:
        defines = {**defines, **specular_defines(defines, has_specular)}
    has_lobes = has_specular and "HAS_RECT_LIGHT" in defines
    if has_layers and has_specular:
        defines = {**defines, "LAYERS": 1}
    lobes = device.shared_texture("ltc", lambda: _upload_lobes(device)) if has_lobes else None

    def uniforms(frame: FrameState) -> Mapping[str, object]:
        values: dict[str, object] = {
            "noise_phase": (frame.noise_phase + GOLDEN_RATIO * frame.index * frame.accumulates) % 1.0,
            **frame.lights.bind_light_images()}
        if shadow_grid is not None:
            values["shadow_grid_ratio"] = ratio_to(shadow_grid, frame)
        if lobes is not None:
            lobes.use(LTC_UNIT)
            values["ltc"] = LTC_UNIT
        if has_specular and "HAS_SPARSE_LIGHT" in defines:
            values |= frame.lights.bind_emission_points()
        return values

    fast_path = None if layer is not None or has_layers else _fast_path(defines, shadow_grid)
    draw = make_fullscreen("direct.frag", uniforms, defines, prefix, layer=layer, fast_path=fast_path)(device, bound)
    if layer is None:
        return draw

    def execute(frame: FrameState, resources: Resources) -> None:
        resources.target().clear()  # texels without the layer, which nothing draws, would be undefined
        draw(frame, resources)

    return execute


def _fast_path(defines: Mapping[str, object],
               shadow_grid: tuple[int, int] | None) -> Callable[[FrameState], bool] | None:
    """When a first step does quads whose traced visibility four texels know, or without any light of mapped lights."""
    if shadow_grid is None:
        return always if 1 <= int(str(defines["LIGHT_COUNT"])) <= MAX_SPLIT_LIGHTS else None
    # Rectangles cost so much that it does not pay to light the rest twice.
    return None if "HAS_TRACED_RECT" in defines else partial(quads_share_taps, shadow_grid)


def _upload_lobes(device: Device) -> moderngl.TextureArray:
    """The table of ``shaders/include/ltc.glsl``; its file has shape (roughnesses, angles, layers, 4)."""
    table = np.load(data_dir() / "ltc.npy").transpose(2, 0, 1, 3)
    layers, height, width, components = table.shape
    texture = device.ctx.texture_array((width, height, layers), components, np.ascontiguousarray(table).tobytes(),
                                       dtype="f2")
    texture.filter = moderngl.LINEAR, moderngl.LINEAR
    texture.repeat_x = texture.repeat_y = False
    return texture
