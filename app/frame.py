"""The frame: the only file that names all passes, in the order of their flow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.errors import SettingsError
from app.gl.blur_levels import BlurLevels
from app.gl.lights import LightSet
from app.gl.peeling import PeeledLayer
from app.graph import Absent, Pass, Plan, compile_graph
from app.network.channels import DIFFUSE, GLOBALS, INDIRECT, SCREEN, SPECULAR, SURFEL_INDIRECT
from app.network.selection import Models
from app.passes import (
    accumulate,
    auto_exposure,
    background,
    blend,
    composite,
    direct,
    final_gather,
    front_motion,
    gbuffer,
    labels,
    layer_light,
    lowres_gbuffer,
    missed_pixels,
    network,
    outer_surface,
    pack_globals,
    pack_screen,
    pack_surfels,
    position,
    push_pull,
    reflection,
    reflection_rays,
    shadow,
    shadow_rays,
    sharpen,
    sky_light,
    ssgi,
    surfel_indirect,
    surfel_light,
    taa,
    tonemap,
    unshadowed_environment,
    upsample,
    volume_exit,
)
from app.radiance_scale import reflected_radiance
from app.raycast.caster import Caster
from app.scene import Environment, Scene
from app.settings import TONE_MAPS, Settings
from app.surfels.tracked import TrackedSurfels

if TYPE_CHECKING:
    from app.exchange.selection import Exchanges
    from app.network.bounces import RepeatedNetwork
    from app.network.contract import ModelContract
    from app.network.session import Network

AOVS: dict[str, str] = {
    "final": "the finished picture, linear radiance, W/(sr m²)",
    "albedo": "diffuse reflectance, linear Rec. 709",
    "normal": "unit shading normal towards the viewer, world space",
    "depth": "distance along the camera's -z in scene units; 0 where nothing is seen",
    "position": "surface point, world space, scene units",
    "motion": "pixels moved since the last frame (current - previous, +y down)",
    "instance": "number of the instance, counted from 1; 0 where nothing is seen; never blended",
    "material": "number of the material, counted from 1; 0 where nothing is seen; never blended",
    "flow": "pixels that the surface moves until the next frame (next - current, +y down), never blended",
    "direct": "diffuse radiance by direct light, including that of a shaded environment, W/(sr m²)",
    "specular": "specular radiance by direct light, including that of a shaded environment, W/(sr m²)",
    "reflection": "specular radiance by indirect light, and by the environment where rays are traced, W/(sr m²); also "
                  "of clear coats and of what is seen through",
    "indirect": "indirect radiance divided by albedo, W/(sr m²)",
    "emission": "emitted radiance, W/(sr m²)",
    "background": "radiance of the environment where nothing is seen, W/(sr m²)",
    "lit": "the composite before temporal anti-aliasing, W/(sr m²)",
}
# On the GPU these are multiplied by the scene's radiance scale.
RADIANCE = frozenset({"final", "direct", "specular", "reflection", "indirect", "emission", "background", "lit"})

Step = Pass | Absent
Size = tuple[int, int]

NO_ENVIRONMENT = "the scene has no environment, or a black one"
NO_TAA = "switched off by --no-taa"
NOTHING_TRACED = "the shadows of all lights are in maps"
SHADOW_RAY_PASSES = ("shadow_gbuffer", "shadow_rays", "shadow_history", "shadow_filter_near", "shadow_filter_far")
MAX_LAYERS = 4  # of blended and transmissive surfaces; farther ones of a pixel are not drawn
LAYER_LIGHT_PASSES = (*(f"peel{k}_lowres_gbuffer" for k in range(MAX_LAYERS)), "layer_light")
LAYER_PASSES = (*(f"peel{k}_{name}" for k in range(MAX_LAYERS) for name in ("gbuffer", "exit", "direct", "blend")),
                *LAYER_LIGHT_PASSES, "front_motion")
CUBE_PASSES = ("cube_gbuffer", "cube_shadow_rays", "cube_direct", "cube_background")
GRADIENT_PASSES = ("gradient_filter_near", "gradient_filter_far")
GATHER_PASSES = ("surfel_pack_globals", "surfel_indirect", "gather_rays", "gather_history", *GRADIENT_PASSES)
NETWORK_PASSES = (*CUBE_PASSES, "pack_surfels", *GATHER_PASSES, "pack_globals", "pack_screen", "network")
REFLECTED_RAY_PASSES = ("reflection_gbuffer", "reflection_march", "reflection_rays", "reflection_resolve",
                        "reflection_history", "reflection_filter_far", "reflection_filter_near", "reflection_detail")
OUTER_PASSES = "outer_surface", *(outer_surface.PREFIX + name for name in (*REFLECTED_RAY_PASSES, "reflection"))
REFLECTION_SURFELS = 2048, 1  # and rays of each, where the model reads no surfels
MISSED_PASSES = ("missed_pixels", "missed_light")
SSGI_PASSES = ("ssgi_radiance", "ssgi", "ssgi_filter_near", "ssgi_filter_far")
ENVIRONMENT_NETWORK_PASSES = ("environment_pack_globals", "environment_pack_screen", "environment_network")
ENVIRONMENT_PASSES = ("environment_lowres_gbuffer", "unshadowed_environment", *ENVIRONMENT_NETWORK_PASSES,
                      "push_pull_diffuse", "upsample_diffuse", "push_pull_specular", "upsample_specular")


@dataclass(frozen=True)
class Frame:
    """All steps of a frame, and ``finished``, the resource that the picture ends in."""

    steps: tuple[Step, ...]
    finished: str

    def resource(self, output: str) -> str | None:
        """The resource that holds ``output``; None where the scene can't have it.

        Raises
        ------
        SettingsError
            When there is no output of that name.
        """
        if output not in AOVS:
            raise SettingsError(f"unknown output {output!r}", "outputs", f"expected some of: {', '.join(AOVS)}")
        name = self.finished if output == "final" else output
        return name if any(isinstance(step, Pass) and name in step.writes for step in self.steps) else None

    def compile(self, outputs: Iterable[str]) -> Plan:
        """The plan that delivers ``outputs``, and the display image with ``final``."""
        wanted = [r for o in outputs if (r := self.resource(o)) is not None]
        return compile_graph(self.steps, [*wanted, "display"] if "final" in outputs else wanted)


@dataclass(frozen=True, eq=False)
class FrameInputs:
    """What decides which passes a frame has.

    Attributes
    ----------
    scene : Scene
        Its radiance is scaled already.
    caster : callable
        Gives the caster of ``scene``; only passes that run call it.
    surfels : TrackedSurfels
        Those that the network reads, or others that reflections show; placed by the first pass that runs.
    exchanges : Exchanges
        Through which networks run.
    """

    scene: Scene
    settings: Settings
    lights: LightSet
    caster: Callable[[], Caster]
    models: Models
    surfels: TrackedSurfels
    exchanges: Exchanges

    @property
    def has_specular(self) -> bool:
        return any(m.has_specular for m in self.scene.materials)

    @property
    def has_normal_maps(self) -> bool:
        return any(m.normal_map is not None for m in self.scene.materials)

    @property
    def smooth_normals(self) -> str:
        """The resource of normals without bumps."""
        return "smooth_normal" if self.has_normal_maps else "normal"

    @property
    def has_textures(self) -> bool:
        return any(m.maps for m in self.scene.materials)

    @property
    def layers(self) -> tuple[str, ...]:
        """What lies over some surfaces: names of the G-buffer's targets."""
        return tuple(name for name in ("clearcoat", "sheen")
                     if any(getattr(m, name) is not None for m in self.scene.materials))

    @property
    def has_see_through(self) -> bool:
        """Whether some surface is blended or transmits light."""
        return any(m.is_see_through for m in self.scene.materials)

    @property
    def has_sky(self) -> bool:
        """Whether the environment is direct light with traced shadows; a model that shades it makes them itself."""
        return self.scene.environment is not None and self.models.environment is None

    @property
    def traces_on_gpu(self) -> bool:
        """Whether shaders trace rays."""
        return self.caster().shader_rays is not None

    @property
    def why_no_reflections(self) -> str | None:
        """Why the frame has no indirect specular light; None if it has."""
        if not self.has_specular:
            return "no material has a specular lobe"
        if self.models.indirect is None:
            return "no model was chosen"
        return None if self.settings.reflections else "switched off by --no-reflections"

    @property
    def has_reflected_rays(self) -> bool:
        """Whether some opaque surface is smooth enough for rays."""
        return self.why_no_reflections is None and any(
            reflection.needs_rays(m) for m in self.scene.materials if not m.is_see_through)

    @property
    def has_outer_reflections(self) -> bool:
        """Whether clear coats, or smooth surfaces that are seen through, have reflections of their own."""
        return self.why_no_reflections is None and any(
            reflection.needs_rays(m) if m.is_see_through else m.clearcoat is not None and m.clearcoat.strength > 0
            for m in self.scene.materials)

    @property
    def has_reflection_detail(self) -> bool:
        """Whether reflections are gathered at full resolution while nothing moves."""
        size = self.settings.render_size
        return reflection.has_detail(reflection.grid(size), size, self.settings.taa)

    def has_sharp_images(self, outer: bool = False) -> bool:
        """Whether opaque or ``outer`` surfaces show sharp images, whose details are followed while something moves."""
        coats = (m.clearcoat for m in self.scene.materials if m.clearcoat is not None and m.clearcoat.strength > 0)
        return (any(reflection.is_sharp(m.min_roughness) for m in self.scene.materials if m.is_see_through is outer)
                or (outer and any(reflection.is_sharp(coat.roughness) for coat in coats)))

    @property
    def gathers_reflections(self) -> bool:
        """Whether pixels of a still get reflections of their own one after another."""
        return self.has_reflection_detail and (self.has_reflected_rays or self.has_outer_reflections)

    @property
    def indirect_grid(self) -> Size | None:
        """Width and height of the grid that indirect light is computed on; None without a model."""
        model, size = self.models.indirect, self.settings.render_size
        if model is None:
            return None
        return ssgi.grid(size) if isinstance(model, str) else model.contract.screen_size(size)

    @property
    def has_surfel_indirect(self) -> bool:
        """Whether a network gives the indirect light of surfels."""
        model = self.models.surfels or self.models.indirect
        return not (model is None or isinstance(model, str)) and model.contract.lights_surfels

    @property
    def is_traced(self) -> bool:
        """Whether any shadows are traced."""
        return self.has_sky or self.lights.has_traced


def build_frame(inputs: FrameInputs) -> Frame:
    """List the passes of one frame in the order of its flow."""
    finished = "lit" if not inputs.settings.taa else "sharpened" if inputs.has_textures else "taa"
    return Frame(tuple(_steps(inputs, finished)), finished)


def _steps(inputs: FrameInputs, finished: str) -> Iterator[Step]:
    scene, settings, lights = inputs.scene, inputs.settings, inputs.lights
    if lights.mapped:
        yield shadow.declare(lights)
    else:
        yield Absent("shadow", "no light has a shadow map" if scene.lights else "the scene has no light")
    yield gbuffer.declare(scene)
    if inputs.layers:
        yield gbuffer.declare_layers(inputs.layers)
    else:
        yield Absent("gbuffer_layers", "no material has a clear coat or sheen")
    yield position.declare()
    yield labels.declare()
    if scene.environment is None:
        yield from _absent(NO_ENVIRONMENT, "background", *ENVIRONMENT_PASSES)
    else:
        yield background.declare(scene.environment)
        yield from _environment_light(inputs, scene.environment)
    yield from _traced_shadows(inputs)
    yield from _low_resolution_surfaces(inputs)
    shadow_grid = shadow_rays.grid(settings.render_size) if inputs.is_traced else None
    yield direct.declare(lights, inputs.has_specular, shadow_grid, inputs.has_sky, inputs.layers,
                         inputs.has_normal_maps, sky_is_reflected=inputs.has_reflected_rays)
    yield from _indirect_light(inputs)
    yield from _reflections(inputs)
    yield _composite(inputs)
    if inputs.has_see_through:
        yield from _peeled_layers(inputs)
    else:
        yield from _absent("no material is blended or transmits light", *LAYER_PASSES)
    if settings.taa:
        prefix = "front_" if inputs.has_see_through else ""
        yield from taa.declare(scene.environment is not None, prefix + "motion", prefix + "depth", inputs.has_textures,
                               settings.size, settings.render_scale < 1, inputs.gathers_reflections)
        yield sharpen.declare(settings.size) if inputs.has_textures else Absent("sharpen", "no material has a texture")
    else:
        yield from _absent(NO_TAA, "taa", "sharpen")
    if settings.auto_exposure:
        yield auto_exposure.declare(finished)
    else:
        yield Absent("auto_exposure", "not asked for by --auto-exposure")
    yield tonemap.declare(finished, settings.tonemap if settings.tonemap in TONE_MAPS else TONE_MAPS[0],
                          settings.auto_exposure, settings.size)


def _peeled_layers(inputs: FrameInputs) -> Iterator[Step]:
    """Layers of blended and transmissive surfaces, lit like the others and laid over each other, the farthest first."""
    layers = [PeeledLayer(index) for index in range(MAX_LAYERS)]
    shadow_grid = shadow_rays.grid(inputs.settings.render_size) if inputs.is_traced else None
    has_volumes = any(m.is_volume for m in inputs.scene.materials)
    levels = BlurLevels() if any(m.is_rough_glass for m in inputs.scene.materials) else None
    for before, layer in zip((None, *layers), layers, strict=False):
        yield gbuffer.declare_peeled(inputs.scene, inputs.layers, layer, before)
        if has_volumes:
            yield volume_exit.declare(layer)
        else:
            yield Absent(layer.prefix + "exit", "no material is a volume")
        # A model shades the G-buffer only, so layers reflect the environment without shadows then.
        yield direct.declare(inputs.lights, inputs.has_specular, shadow_grid, inputs.scene.environment is not None,
                             inputs.layers, inputs.has_normal_maps, layer,
                             inputs.has_outer_reflections and layer.index == 0, inputs.has_surfel_indirect)
    if inputs.has_surfel_indirect:
        grid = layer_light.grid(inputs.settings.render_size)
        for layer in layers:
            yield lowres_gbuffer.declare(layer.prefix + "lowres_gbuffer", grid, layer.prefix + "normal",
                                         layer.prefix + "depth", is_sparse=True)
        yield layer_light.declare(layers, grid, inputs.surfels)
    else:
        yield from _absent("the model gives no light of surfels", *LAYER_LIGHT_PASSES)
    behind, next_depth = "opaque_lit", None
    for layer in reversed(layers):
        result = layer.prefix + "lit" if layer.index else "lit"
        yield blend.declare(layer, behind, result, inputs.models.indirect is not None, inputs.has_surfel_indirect,
                            has_volumes, levels, next_depth)
        behind, next_depth = result, layer.prefix + "depth"
    yield front_motion.declare(layers[0])


def _traced_shadows(inputs: FrameInputs) -> Iterator[Step]:
    """How much of the light of large lights, and of the environment, reaches what the screen shows."""
    environment, settings = inputs.scene.environment, inputs.settings
    if environment is None:
        yield Absent("sky_light", NO_ENVIRONMENT)
    elif not inputs.has_sky and not inputs.has_see_through:
        yield Absent("sky_light", "a model shades surfaces by the environment")
    else:
        yield sky_light.declare(environment)
    if not inputs.is_traced:
        yield from _absent(NOTHING_TRACED, *SHADOW_RAY_PASSES)
        return
    yield lowres_gbuffer.declare("shadow_gbuffer", shadow_rays.grid(settings.render_size), inputs.smooth_normals)
    yield from shadow_rays.declare(inputs.lights, inputs.has_specular, inputs.has_sky, inputs.caster,
                                   settings.render_size, has_history=settings.taa)
    if not settings.taa:
        yield Absent("shadow_history", NO_TAA)


def _environment_light(inputs: FrameInputs, environment: Environment) -> Iterator[Step]:
    """Light straight from the environment at low resolution, with shadows by a network if there is one, upsampled."""
    settings, model = inputs.settings, inputs.models.environment
    if model is None:
        yield from _absent("no model was chosen that shades an environment", *ENVIRONMENT_PASSES)
        return
    kinds = ("diffuse", "specular") if inputs.has_specular else ("diffuse",)
    low = {kind: f"environment_{kind}_low" for kind in kinds}
    if isinstance(model, str):
        grid = unshadowed_environment.grid(settings.render_size)
        yield lowres_gbuffer.declare("environment_lowres_gbuffer", grid)
        yield unshadowed_environment.declare(environment, grid, low)
        yield from _absent("the environment is shaded without a network", *ENVIRONMENT_NETWORK_PASSES)
    else:
        grid = model.contract.screen_size(settings.render_size)
        yield lowres_gbuffer.declare("environment_lowres_gbuffer", grid)
        yield from _environment_network(inputs, environment, model, grid, low)
    for kind, light in low.items():
        filled = f"environment_{kind}_filled"
        yield push_pull.declare(f"push_pull_{kind}", grid, light, "environment_lowres_gbuffer", filled)
        yield upsample.declare(f"upsample_{kind}", grid, filled, "environment_lowres_gbuffer", f"environment_{kind}")
    if not inputs.has_specular:
        yield from _absent("no material has a specular lobe", "push_pull_specular", "upsample_specular")


def _environment_network(inputs: FrameInputs, environment: Environment, model: Network, grid: Size,
                         low: dict[str, str]) -> Iterator[Step]:
    """A network that puts shadows into the unshadowed light of the environment."""
    contract = model.contract
    tensors = pack_screen.tensor_names(contract)
    yield unshadowed_environment.declare(environment, grid, {kind: f"unshadowed_{kind}" for kind in low})
    yield _pack_globals("environment_pack_globals", contract, tensors, environment, None)
    yield pack_screen.declare("environment_pack_screen", contract, inputs.settings.render_size, inputs.scene)
    targets = {name: low[kind] for name, kind in ((DIFFUSE, "diffuse"), (SPECULAR, "specular")) if kind in low}
    yield network.declare("environment_network", model, inputs.exchanges, tensors, grid, targets)


def _low_resolution_surfaces(inputs: FrameInputs) -> Iterator[Step]:
    """The points of the grid of indirect light; before direct light, which is drawn while their rays are traced."""
    grid = inputs.indirect_grid
    if grid is None:
        yield from _absent("no model was chosen", "lowres_gbuffer", "gather_receivers", "gather_surfaces")
        return
    yield lowres_gbuffer.declare("lowres_gbuffer", grid, inputs.smooth_normals,
                                 least_glow=reflected_radiance(inputs.scene) if inputs.has_surfel_indirect else None)
    if inputs.models.surfels is None:
        yield from _absent("the network reads no gathered light", "gather_receivers", "gather_surfaces")
        return
    if inputs.settings.taa:
        yield final_gather.declare_receivers(grid)
    else:
        yield Absent("gather_receivers", NO_TAA)
    if inputs.traces_on_gpu:
        yield Absent("gather_surfaces", "the GPU traces the rays")
    else:
        yield final_gather.declare_surfaces(grid, inputs.settings.taa)


def _indirect_light(inputs: FrameInputs) -> Iterator[Step]:
    """Indirect light at low resolution, accumulated over frames, and upsampled."""
    settings, model, grid = inputs.settings, inputs.models.indirect, inputs.indirect_grid
    if model is None or grid is None:
        yield from _absent("no model was chosen", "surfel_light", *NETWORK_PASSES, *SSGI_PASSES, "accumulate",
                           "push_pull", *MISSED_PASSES, "upsample")
        return
    target = "indirect_now" if settings.taa else "indirect_low"
    if inputs.models.surfels_read is not None or inputs.has_reflected_rays or inputs.has_outer_reflections:
        yield surfel_light.declare(inputs.surfels, inputs.lights)
    else:
        yield Absent("surfel_light", "neither the model nor a reflection reads surfels")
    if isinstance(model, str):
        yield from _absent("the model is no network", *NETWORK_PASSES)
        yield from ssgi.declare(grid, settings.taa, target)
    else:
        yield from _absent("a network was chosen", *SSGI_PASSES)
        yield from _network(inputs, model, grid, target)
    if settings.taa:
        still_frames = accumulate.STILL_FRAMES if inputs.models.surfels is None else final_gather.STILL_FRAMES
        yield accumulate.declare(grid, noisy=isinstance(model, str), still_frames=still_frames)
    else:
        yield Absent("accumulate", NO_TAA)
    yield push_pull.declare("push_pull", grid, "indirect_low", "lowres_gbuffer", "indirect_filled")
    missed_tile = missed_pixels.tile_side(settings.render_size) if inputs.has_surfel_indirect else None
    if missed_tile:
        yield from missed_pixels.declare(settings.render_size, grid, inputs.surfels, settings.taa,
                                         inputs.smooth_normals)
    else:
        yield from _absent("the model gives no light of surfels", *MISSED_PASSES)
    has_gradient = inputs.models.surfels is not None and inputs.has_normal_maps
    yield upsample.declare("upsample", grid, "indirect_filled", "lowres_gbuffer", "indirect", has_history=settings.taa,
                           missed_tile=missed_tile, normals=inputs.smooth_normals,
                           gradient="light_gradient" if has_gradient else None)


def _reflections(inputs: FrameInputs) -> Iterator[Step]:
    """Indirect light on glossy surfaces."""
    settings = inputs.settings
    if inputs.why_no_reflections is not None:
        yield from _absent(inputs.why_no_reflections, *REFLECTED_RAY_PASSES, *OUTER_PASSES, "reflection")
        return
    grid = reflection.grid(settings.render_size)
    too_rough = "all opaque surfaces are too rough for rays"
    if inputs.has_reflected_rays or inputs.has_outer_reflections:
        yield lowres_gbuffer.declare("reflection_gbuffer", grid)
    else:
        yield Absent("reflection_gbuffer", too_rough)
    if inputs.has_reflected_rays:
        yield from _reflected_rays(inputs, grid)
    else:
        yield from _absent(too_rough, *REFLECTED_RAY_PASSES[1:])
    if inputs.has_outer_reflections:
        yield from _outer_reflections(inputs, grid)
    else:
        yield from _absent("there is no clear coat, and nothing smooth that is seen through", *OUTER_PASSES)
    if "reflection" in settings.outputs:
        yield reflection.declare(grid, _reflecting(inputs), inputs.has_sharp_images())
    else:
        yield Absent("reflection", "not asked for by --aov; composite adds reflections itself")


def _reflected_rays(inputs: FrameInputs, grid: Size, prefix: str = "") -> Iterator[Step]:
    """Rays of the surfaces whose resources begin with ``prefix``, and their light."""
    scene, settings = inputs.scene, inputs.settings
    yield reflection.declare_march(grid, scene.longest_edge, settings.taa, prefix)
    yield reflection_rays.declare(grid, inputs.surfels, inputs.lights, scene.environment, settings.taa, prefix)
    yield from reflection.declare_gathering(grid, settings.taa, prefix)
    if inputs.has_reflection_detail:
        yield reflection.declare_detail(grid, inputs.has_sharp_images(outer=bool(prefix)), prefix)
    else:
        yield Absent(prefix + "reflection_detail",
                     "the image is no larger than the grid of reflections" if settings.taa else NO_TAA)


def _outer_reflections(inputs: FrameInputs, grid: Size) -> Iterator[Step]:
    """Reflections of clear coats, and of the nearest layer of what is seen through."""
    prefix = outer_surface.PREFIX
    yield outer_surface.declare("clearcoat" in inputs.layers, PeeledLayer(0) if inputs.has_see_through else None,
                                inputs.settings.taa)
    yield lowres_gbuffer.declare(prefix + "reflection_gbuffer", grid, prefix + "normal", prefix + "depth")
    yield from _reflected_rays(inputs, grid, prefix)
    yield reflection.declare_outer(grid, inputs.has_reflection_detail, inputs.has_sharp_images(outer=True), prefix)


def _reflecting(inputs: FrameInputs) -> tuple[str, ...]:
    """What reflections of opaque surfaces are made of."""
    return reflection.surfaces_read(inputs.has_reflected_rays, inputs.has_reflection_detail,
                                    "clearcoat" in inputs.layers)


def _composite(inputs: FrameInputs) -> Pass:
    surfaces = _reflecting(inputs) if inputs.why_no_reflections is None else ()
    return composite.declare(inputs.models.indirect is not None, "opaque_lit" if inputs.has_see_through else "lit",
                             surfaces, reflection.grid(inputs.settings.render_size), inputs.has_sharp_images())


def _network(inputs: FrameInputs, model: Network | RepeatedNetwork, grid: Size, target: str) -> Iterator[Step]:
    """A network that writes ``target``, and the passes for the grids that it reads."""
    contract, scene, settings = model.contract, inputs.scene, inputs.settings
    tensors = pack_screen.tensor_names(contract)
    if contract.face is None:
        yield from _absent("the network reads no cube", *CUBE_PASSES)
    else:
        yield from _cube(inputs, contract.face, contract.cube_axes == "camera")
    if inputs.models.surfels is not None:
        yield from _gathered_light(inputs, inputs.models.surfels, grid)
    else:
        yield from _absent("the network reads no gathered light", *GATHER_PASSES)
        if contract.surfels is None:
            yield Absent("pack_surfels", "the network reads no surfels")
        else:
            yield pack_surfels.declare(inputs.surfels, contract, tensors, scene.longest_edge)
    yield _pack_globals("pack_globals", contract, tensors, scene.environment, settings.bounces)
    yield pack_screen.declare("pack_screen", contract, settings.render_size, scene, inputs.smooth_normals)
    targets = {INDIRECT: target}
    if contract.lights_surfels:
        targets[SURFEL_INDIRECT] = "surfel_indirect"
    yield network.declare("network", model, inputs.exchanges, tensors, grid, targets)


def _gathered_light(inputs: FrameInputs, source: Network, grid: Size) -> Iterator[Step]:
    """Light along rays that end at surfels, whose indirect light the network ``source`` computes."""
    contract, settings = source.contract, inputs.settings
    tensors = {t: f"surfel_tensor_{t}" for t, spec in contract.inputs.items() if spec.grid != SCREEN}
    yield pack_surfels.declare(inputs.surfels, contract, tensors, inputs.scene.longest_edge)
    yield _pack_globals("surfel_pack_globals", contract, tensors, inputs.scene.environment, None)
    yield surfel_indirect.declare(source, tensors, inputs.surfels)
    yield from final_gather.declare(inputs.surfels, inputs.lights, grid, settings.taa, inputs.traces_on_gpu,
                                    inputs.has_normal_maps)
    if not inputs.has_normal_maps:
        yield from _absent("no material has a normal map", *GRADIENT_PASSES)
    if not settings.taa:
        yield Absent("gather_history", NO_TAA)


def _cube(inputs: FrameInputs, face: int, camera_axes: bool) -> Iterator[Step]:
    """What is seen from the eye in all directions, with direct light."""
    lights, has_sky = inputs.lights, inputs.has_sky
    yield gbuffer.declare_cube(inputs.scene, face, camera_axes)
    if inputs.is_traced:
        yield shadow_rays.declare_cube(lights, has_sky, inputs.caster, face, camera_axes)
    else:
        yield Absent("cube_shadow_rays", NOTHING_TRACED)
    yield direct.declare_cube(lights, face, camera_axes, inputs.is_traced, has_sky, inputs.has_normal_maps)
    if inputs.scene.environment is None:
        yield Absent("cube_background", NO_ENVIRONMENT)
    else:
        yield background.declare_cube(inputs.scene.environment, face, camera_axes)


def _pack_globals(name: str, contract: ModelContract, tensors: dict[str, str], environment: Environment | None,
                  bounces: int | None) -> Step:
    if all(spec.grid != GLOBALS for spec in contract.inputs.values()):
        return Absent(name, "the network reads no globals")
    return pack_globals.declare(name, contract, tensors, environment, bounces)


def _absent(reason: str, *names: str) -> Iterator[Absent]:
    return (Absent(name, reason) for name in names)
