"""The frame: the only file that names all passes, in the order of their flow."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from app.errors import SettingsError
from app.gl.lights import LightSet
from app.graph import Absent, Pass, Plan, compile_graph
from app.network.channels import DIFFUSE, GLOBALS, INDIRECT, SPECULAR
from app.network.selection import Models
from app.passes import (
    accumulate,
    background,
    composite,
    direct,
    gbuffer,
    lowres_gbuffer,
    network,
    pack_globals,
    pack_screen,
    pack_surfels,
    position,
    push_pull,
    shadow,
    ssgi,
    surfel_light,
    taa,
    tonemap,
    unshadowed_environment,
    upsample,
)
from app.scene import Environment, Scene
from app.settings import Settings
from app.surfels.tracked import TrackedSurfels

if TYPE_CHECKING:
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
    "direct": "diffuse radiance by direct light, including that of a shaded environment, W/(sr m²)",
    "specular": "specular radiance by direct light, including that of a shaded environment, W/(sr m²)",
    "indirect": "indirect radiance divided by albedo, W/(sr m²)",
    "emission": "emitted radiance, W/(sr m²)",
    "background": "radiance of the environment where nothing is seen, W/(sr m²)",
    "lit": "the composite before temporal anti-aliasing, W/(sr m²)",
}
# On the GPU these are multiplied by the scene's radiance scale.
RADIANCE = frozenset({"final", "direct", "specular", "indirect", "emission", "background", "lit"})

Step = Pass | Absent
Size = tuple[int, int]

NO_ENVIRONMENT = "the scene has no environment, or a black one"
CUBE_PASSES = ("cube_gbuffer", "cube_direct", "cube_background")
NETWORK_PASSES = (*CUBE_PASSES, "surfel_light", "pack_surfels", "pack_globals", "pack_screen", "network")
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
            raise SettingsError(f"unknown output {output!r}", "--aov", f"expected some of: {', '.join(AOVS)}")
        name = self.finished if output == "final" else output
        return name if any(isinstance(step, Pass) and name in step.writes for step in self.steps) else None

    def compile(self, outputs: Iterable[str]) -> Plan:
        """The plan that delivers ``outputs``, and the display image with ``final``."""
        wanted = [r for o in outputs if (r := self.resource(o)) is not None]
        return compile_graph(self.steps, [*wanted, "display"] if "final" in outputs else wanted)


def build_frame(scene: Scene, settings: Settings, lights: LightSet, models: Models) -> Frame:
    """List the passes of one frame in the order of its flow; radiance in ``scene`` is scaled already."""
    finished = "taa" if settings.taa else "lit"
    return Frame(tuple(_steps(scene, settings, lights, models, finished)), finished)


def _steps(scene: Scene, settings: Settings, lights: LightSet, models: Models, finished: str) -> Iterator[Step]:
    has_specular = any(m.has_specular for m in scene.materials)
    yield shadow.declare(lights) if scene.lights else Absent("shadow", "the scene has no light that casts shadows")
    yield gbuffer.declare(scene)
    yield position.declare()
    if scene.environment is None:
        yield from _absent(NO_ENVIRONMENT, "background", *ENVIRONMENT_PASSES)
    else:
        yield background.declare(scene.environment)
        yield from _environment_light(scene, scene.environment, settings, models.environment, has_specular)
    yield direct.declare(lights, has_specular)
    yield from _indirect_light(scene, settings, lights, models)
    yield composite.declare(has_indirect=models.indirect is not None)
    yield taa.declare(scene.environment is not None) if settings.taa else Absent("taa", "switched off by --no-taa")
    yield tonemap.declare(finished)


def _environment_light(scene: Scene, environment: Environment, settings: Settings,
                       model: Network | Literal["unshadowed_environment"] | None, has_specular: bool) -> Iterator[Step]:
    """Light straight from the environment at low resolution, with shadows by a network if there is one, upsampled."""
    if model is None:
        yield from _absent("no model was chosen that shades an environment", *ENVIRONMENT_PASSES)
        return
    low = {kind: f"environment_{kind}_low" for kind in (("diffuse", "specular") if has_specular else ("diffuse",))}
    if isinstance(model, str):
        grid = unshadowed_environment.grid(settings.size)
        yield lowres_gbuffer.declare("environment_lowres_gbuffer", grid)
        yield unshadowed_environment.declare(environment, grid, low)
        yield from _absent("the environment is shaded without a network", *ENVIRONMENT_NETWORK_PASSES)
    else:
        grid = model.contract.screen_size(settings.size)
        yield lowres_gbuffer.declare("environment_lowres_gbuffer", grid)
        yield from _environment_network(scene, environment, settings, model, grid, low)
    for kind, light in low.items():
        filled = f"environment_{kind}_filled"
        yield push_pull.declare(f"push_pull_{kind}", grid, light, "environment_lowres_gbuffer", filled)
        yield upsample.declare(f"upsample_{kind}", grid, filled, "environment_lowres_gbuffer", f"environment_{kind}")
    if not has_specular:
        yield from _absent("no material has a specular lobe", "push_pull_specular", "upsample_specular")


def _environment_network(scene: Scene, environment: Environment, settings: Settings, model: Network, grid: Size,
                         low: dict[str, str]) -> Iterator[Step]:
    """A network that puts shadows into the unshadowed light of the environment."""
    contract = model.contract
    tensors = pack_screen.tensor_names(contract)
    yield unshadowed_environment.declare(environment, grid, {kind: f"unshadowed_{kind}" for kind in low})
    yield _pack_globals("environment_pack_globals", contract, tensors, environment, None)
    yield pack_screen.declare("environment_pack_screen", contract, settings.size, scene.longest_edge)
    targets = {name: low[kind] for name, kind in ((DIFFUSE, "diffuse"), (SPECULAR, "specular")) if kind in low}
    yield network.declare("environment_network", model, tensors, grid, targets)


def _indirect_light(scene: Scene, settings: Settings, lights: LightSet, models: Models) -> Iterator[Step]:
    """Indirect light at low resolution, accumulated over frames, and upsampled."""
    model = models.indirect
    if model is None:
        yield from _absent("no model was chosen", *NETWORK_PASSES, *SSGI_PASSES, "lowres_gbuffer", "accumulate",
                           "push_pull", "upsample")
        return
    target = "indirect_now" if settings.taa else "indirect_low"
    if isinstance(model, str):
        grid = ssgi.grid(settings.size)
        yield lowres_gbuffer.declare("lowres_gbuffer", grid)
        yield from _absent("the model is no network", *NETWORK_PASSES)
        yield from ssgi.declare(grid, settings.taa, target)
    else:
        grid = model.contract.screen_size(settings.size)
        yield lowres_gbuffer.declare("lowres_gbuffer", grid)
        yield from _absent("a network was chosen", *SSGI_PASSES)
        yield from _network(scene, settings, lights, model, grid, target, models.environment is not None)
    if settings.taa:
        yield accumulate.declare(grid, noisy=isinstance(model, str))
    else:
        yield Absent("accumulate", "switched off by --no-taa")
    yield push_pull.declare("push_pull", grid, "indirect_low", "lowres_gbuffer", "indirect_filled")
    yield upsample.declare("upsample", grid, "indirect_filled", "lowres_gbuffer", "indirect", has_history=settings.taa)


def _network(scene: Scene, settings: Settings, lights: LightSet, model: Network | RepeatedNetwork, grid: Size,
             target: str, sky_is_direct: bool) -> Iterator[Step]:
    """A network that writes ``target``, and the passes for the grids that it reads."""
    contract = model.contract
    tensors = pack_screen.tensor_names(contract)
    if contract.face is None:
        yield from _absent("the network reads no cube", *CUBE_PASSES)
    else:
        camera_axes = contract.cube_axes == "camera"
        yield gbuffer.declare_cube(scene, contract.face, camera_axes)
        yield direct.declare_cube(lights, contract.face, camera_axes)
        if scene.environment is None:
            yield Absent("cube_background", NO_ENVIRONMENT)
        else:
            yield background.declare_cube(scene.environment, contract.face, camera_axes)
    if contract.surfels is None:
        yield from _absent("the network reads no surfels", "surfel_light", "pack_surfels")
    else:
        surfels = TrackedSurfels(scene, *contract.surfels)
        yield surfel_light.declare(surfels, lights)
        yield pack_surfels.declare(surfels, contract, tensors, scene.longest_edge, sky_is_direct)
    yield _pack_globals("pack_globals", contract, tensors, scene.environment, settings.bounces)
    yield pack_screen.declare("pack_screen", contract, settings.size, scene.longest_edge)
    yield network.declare("network", model, tensors, grid, {INDIRECT: target})


def _pack_globals(name: str, contract: ModelContract, tensors: dict[str, str], environment: Environment | None,
                  bounces: int | None) -> Step:
    if all(spec.grid != GLOBALS for spec in contract.inputs.values()):
        return Absent(name, "the network reads no globals")
    return pack_globals.declare(name, contract, tensors, environment, bounces)


def _absent(reason: str, *names: str) -> Iterator[Absent]:
    return (Absent(name, reason) for name in names)
