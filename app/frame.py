"""The frame: the only file that names all passes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from app.channels import DIFFUSE, INDIRECT, SPECULAR, VECTOR
from app.errors import SettingsError
from app.gl.lights import LightSet
from app.graph import Pass, Plan, compile_graph
from app.models import Models
from app.passes import (
    accumulate,
    background,
    coarse,
    composite,
    direct,
    downsample,
    fill,
    gbuffer,
    network,
    output,
    pick,
    position,
    shadow,
    ssgi,
    surfel_light,
    surfels,
    taa,
    upsample,
    vector,
)
from app.scene import Environment, Scene
from app.settings import Settings
from app.surfels.tracked import TrackedSurfels

if TYPE_CHECKING:
    from app.bounces import Reapplied
    from app.infer import Network

AOVS: dict[str, str] = {
    "final": "the finished picture, linear radiance, W/(sr m²)",
    "albedo": "diffuse reflectance, linear Rec. 709",
    "normal": "unit shading normal towards the viewer, world space",
    "depth": "distance along the camera's -z in scene units; 0 where nothing is seen",
    "position": "surface point, world space, scene units",
    "motion": "pixels moved since the last frame (current - previous, +y down)",
    "direct": "diffuse radiance by direct light, that of a shaded environment too, W/(sr m²)",
    "specular": "highlights of the same, W/(sr m²)",
    "indirect": "indirect radiance divided by albedo, W/(sr m²)",
    "emission": "emitted radiance, W/(sr m²)",
    "background": "radiance of the environment where nothing is seen, W/(sr m²)",
    "lit": "the composite before temporal anti-aliasing, W/(sr m²)",
}
SHADING_PASSES = ("environment_pick", "coarse", "environment_vector", "environment_downsample",
                  "environment_network", *(f"{step}_{kind}" for kind in ("diffuse", "specular")
                                           for step in ("fill", "upsample")))
AROUND = ("surround", "surround_direct", "surround_background")
NETWORK_PASSES = (*AROUND, "surfel_light", "surfels", "vector", "downsample", "network")
# On the GPU these are multiplied by LightSet.scale.
RADIANCE = frozenset({"final", "direct", "specular", "indirect", "emission", "background", "lit"})


@dataclass(frozen=True)
class Frame:
    """All passes that scene, settings and network allow, and why others are absent.

    ``finished`` names the resource that the picture ends in: ``taa``, or ``lit`` without it.
    """

    passes: tuple[Pass, ...]
    absent: Mapping[str, str]
    finished: str

    def resource(self, output: str) -> str | None:
        """The resource that holds ``output``; None where the scene can't have it.

        Raises
        ------
        SettingsError
            For a name that is no output.
        """
        if output not in AOVS:
            raise SettingsError(f"unknown output {output!r}", "--aov", "expected some of " + ", ".join(AOVS))
        name = self.finished if output == "final" else output
        return name if any(name in p.writes for p in self.passes) else None

    def compile(self, outputs: Iterable[str]) -> Plan:
        """The plan that delivers ``outputs``, and the display image with ``final``."""
        wanted = [r for o in outputs if (r := self.resource(o)) is not None]
        return compile_graph(self.passes, [*wanted, "display"] if "final" in outputs else wanted, self.absent)


def build_frame(scene: Scene, settings: Settings, lights: LightSet, models: Models) -> Frame:
    """List the passes of one frame, in the order of its flow."""
    shiny = any(m.shiny for m in scene.materials)
    absent: dict[str, str] = {}
    passes: list[Pass] = []
    if scene.lights:
        passes.append(shadow.declare(lights))
    else:
        absent["shadow"] = "the scene has no light that casts"
    passes += [gbuffer.declare(scene), position.declare()]
    if scene.environment is None:
        absent |= dict.fromkeys(("background", "surround_background", *SHADING_PASSES),
                                "the scene has no environment, or a black one")
    else:
        passes.append(background.declare(scene.environment, lights.scale))
        if models.environment is not None:
            passes += _shading(scene, scene.environment, settings, lights, models.environment, shiny, absent)
        else:
            absent |= dict.fromkeys(SHADING_PASSES, "no model was chosen that shades an environment")
    passes.append(direct.declare(lights, shiny))
    if models.indirect is not None:
        passes += _indirect(scene, settings, lights, models, models.indirect, absent)
    else:
        absent |= dict.fromkeys((*NETWORK_PASSES, "ssgi", "pick", "accumulate", "fill", "upsample"),
                                "no model was chosen")
    passes.append(composite.declare(has_indirect=models.indirect is not None))
    if settings.taa:
        passes.append(taa.declare(scene.environment is not None))
    else:
        absent |= dict.fromkeys(("accumulate", "taa"), "switched off by --no-taa")
    finished = "taa" if settings.taa else "lit"
    passes.append(output.declare(finished))
    return Frame(tuple(passes), absent, finished)


def _shading(scene: Scene, environment: Environment, settings: Settings, lights: LightSet,
             model: Network | Literal["coarse"], shiny: bool, absent: dict[str, str]) -> list[Pass]:
    """The passes that shade by the environment at low resolution, and those that bring that to the image's."""
    kinds = ("diffuse", "specular") if shiny else ("diffuse",)
    low = {kind: f"environment_{kind}_low" for kind in kinds}
    surface = "environment_surface"
    if isinstance(model, str):
        grid = coarse.grid(settings.size)
        passes = [coarse.declare(environment, lights.scale, grid, low)]
        absent |= dict.fromkeys(SHADING_PASSES[2:5], "the environment is shaded without a network")
    else:
        grid = model.contract.screen_size(settings.size)
        tensors = downsample.tensor_names(model.contract)
        passes = [coarse.declare(environment, lights.scale, grid, {kind: f"coarse_{kind}" for kind in kinds})]
        if _reads_vectors(model):
            passes.append(vector.declare(model.contract, tensors, environment, lights.scale, None,
                                         "environment_vector"))
        else:
            absent["environment_vector"] = "the network reads no vector"
        targets = {name: low[kind] for name, kind in ((DIFFUSE, "diffuse"), (SPECULAR, "specular")) if kind in low}
        passes += [downsample.declare(model.contract, settings.size, scene.longest_edge, "environment_downsample"),
                   network.declare(model, tensors, grid, targets, "environment_network")]
    if not shiny:
        absent |= dict.fromkeys(("fill_specular", "upsample_specular"), "no material has highlights")
    for kind in kinds:
        light = f"environment_{kind}"
        passes += [fill.declare(grid, light, surface, f"fill_{kind}"),
                   upsample.declare(grid, light, surface, f"upsample_{kind}", gathered=False)]
    return [pick.declare(grid, surface, "environment_pick"), *passes]


def _indirect(scene: Scene, settings: Settings, lights: LightSet, models: Models,
              model: Network | Reapplied | Literal["ssgi"], absent: dict[str, str]) -> list[Pass]:
    """The passes that make indirect light at low resolution, and those that bring it to the image's."""
    target = "indirect_now" if settings.taa else "indirect_low"
    if isinstance(model, str):
        grid = ssgi.grid(settings.size)
        passes = [ssgi.declare_picks(grid), ssgi.declare(grid, settings.taa), *ssgi.declare_filters(grid, target)]
        absent |= dict.fromkeys(NETWORK_PASSES, "the model is no network")
    else:
        grid = model.contract.screen_size(settings.size)
        passes = _network(scene, settings, lights, model, grid, target, models.environment is not None, absent)
        absent["ssgi"] = "a network was chosen"
    if settings.taa:
        passes.append(accumulate.declare(grid, noisy=isinstance(model, str)))
    return [pick.declare(grid, "surface_low", "pick"), *passes, fill.declare(grid, "indirect", "surface_low", "fill"),
            upsample.declare(grid, "indirect", "surface_low", "upsample", settings.taa)]


def _network(scene: Scene, settings: Settings, lights: LightSet, model: Network | Reapplied, grid: tuple[int, int],
             target: str, sky_is_direct: bool, absent: dict[str, str]) -> list[Pass]:
    """A network that writes ``target``, and the passes that make what it reads, for the grids that it asks for."""
    contract = model.contract
    passes: list[Pass] = []
    camera_axes = contract.cube_axes == "camera"
    if contract.face is not None:
        passes += [gbuffer.declare_surround(scene, contract.face, camera_axes),
                   direct.declare_surround(lights, contract.face, camera_axes)]
        if scene.environment is not None:
            passes.append(background.declare_surround(scene.environment, lights.scale, contract.face, camera_axes))
    else:
        absent |= dict.fromkeys(AROUND, "the network reads no cube")
    tensors = downsample.tensor_names(contract)
    if contract.surfels is not None:
        world = TrackedSurfels(scene, *contract.surfels)
        passes += [surfel_light.declare(world, lights),
                   surfels.declare(world, contract, tensors, scene.longest_edge, sky_is_direct)]
    else:
        absent |= dict.fromkeys(("surfel_light", "surfels"), "the network reads no surfels")
    if _reads_vectors(model):
        passes.append(vector.declare(contract, tensors, scene.environment, lights.scale, settings.bounces))
    else:
        absent["vector"] = "the network reads no vector"
    passes.append(downsample.declare(contract, settings.size, scene.longest_edge))
    return [*passes, network.declare(model, tensors, grid, {INDIRECT: target})]


def _reads_vectors(model: Network | Reapplied) -> bool:
    return any(spec.grid == VECTOR for spec in model.contract.inputs.values())
