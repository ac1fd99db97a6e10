"""The frame: the only file that names all passes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from app.errors import SettingsError
from app.gl.lights import LightSet
from app.graph import Pass, Plan, compile_graph
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
    from app.network.bounces import Reapplied
    from app.network.session import Network

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
SHADING_PASSES = ("environment_lowres_gbuffer", "unshadowed_environment", "environment_pack_globals", "environment_pack_screen",
                  "environment_network", *(f"{step}_{kind}" for kind in ("diffuse", "specular")
                                           for step in ("push_pull", "upsample")))
CUBE_PASSES = ("cube_gbuffer", "cube_direct", "cube_background")
NETWORK_PASSES = (*CUBE_PASSES, "surfel_light", "pack_surfels", "pack_globals", "pack_screen", "network")
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
    has_specular = any(m.has_specular for m in scene.materials)
    absent: dict[str, str] = {}
    passes: list[Pass] = []
    if scene.lights:
        passes.append(shadow.declare(lights))
    else:
        absent["shadow"] = "the scene has no light that casts"
    passes += [gbuffer.declare(scene), position.declare()]
    if scene.environment is None:
        absent |= dict.fromkeys(("background", "cube_background", *SHADING_PASSES),
                                "the scene has no environment, or a black one")
    else:
        passes.append(background.declare(scene.environment, lights.scale))
        if models.environment is not None:
            passes += _shading(scene, scene.environment, settings, lights, models.environment, has_specular, absent)
        else:
            absent |= dict.fromkeys(SHADING_PASSES, "no model was chosen that shades an environment")
    passes.append(direct.declare(lights, has_specular))
    if models.indirect is not None:
        passes += _indirect(scene, settings, lights, models, models.indirect, absent)
    else:
        absent |= dict.fromkeys((*NETWORK_PASSES, "ssgi", "lowres_gbuffer", "accumulate", "push_pull", "upsample"),
                                "no model was chosen")
    passes.append(composite.declare(has_indirect=models.indirect is not None))
    if settings.taa:
        passes.append(taa.declare(scene.environment is not None))
    else:
        absent |= dict.fromkeys(("accumulate", "taa"), "switched off by --no-taa")
    finished = "taa" if settings.taa else "lit"
    passes.append(tonemap.declare(finished))
    return Frame(tuple(passes), absent, finished)


def _shading(scene: Scene, environment: Environment, settings: Settings, lights: LightSet,
             model: Network | Literal["unshadowed_environment"], has_specular: bool, absent: dict[str, str]) -> list[Pass]:
    """The passes that shade by the environment at low resolution, and those that bring that to the image's."""
    kinds = ("diffuse", "specular") if has_specular else ("diffuse",)
    low = {kind: f"environment_{kind}_low" for kind in kinds}
    surface = "environment_lowres_gbuffer"
    if isinstance(model, str):
        grid = unshadowed_environment.grid(settings.size)
        passes = [unshadowed_environment.declare(environment, lights.scale, grid, low)]
        absent |= dict.fromkeys(SHADING_PASSES[2:5], "the environment is shaded without a network")
    else:
        grid = model.contract.screen_size(settings.size)
        tensors = pack_screen.tensor_names(model.contract)
        passes = [unshadowed_environment.declare(environment, lights.scale, grid, {kind: f"unshadowed_{kind}" for kind in kinds})]
        if _reads_vectors(model):
            passes.append(pack_globals.declare(model.contract, tensors, environment, lights.scale, None,
                                         "environment_pack_globals"))
        else:
            absent["environment_pack_globals"] = "the network reads no vector"
        targets = {name: low[kind] for name, kind in ((DIFFUSE, "diffuse"), (SPECULAR, "specular")) if kind in low}
        passes += [pack_screen.declare(model.contract, settings.size, scene.longest_edge, "environment_pack_screen"),
                   network.declare(model, tensors, grid, targets, "environment_network")]
    if not has_specular:
        absent |= dict.fromkeys(("push_pull_specular", "upsample_specular"), "no material has highlights")
    for kind in kinds:
        light = f"environment_{kind}"
        passes += [push_pull.declare(grid, light, surface, f"push_pull_{kind}"),
                   upsample.declare(grid, light, surface, f"upsample_{kind}", gathered=False)]
    return [lowres_gbuffer.declare(grid, surface, "environment_lowres_gbuffer"), *passes]


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
    return [lowres_gbuffer.declare(grid, "lowres_gbuffer", "lowres_gbuffer"), *passes, push_pull.declare(grid, "indirect", "lowres_gbuffer", "push_pull"),
            upsample.declare(grid, "indirect", "lowres_gbuffer", "upsample", settings.taa)]


def _network(scene: Scene, settings: Settings, lights: LightSet, model: Network | Reapplied, grid: tuple[int, int],
             target: str, sky_is_direct: bool, absent: dict[str, str]) -> list[Pass]:
    """A network that writes ``target``, and the passes that make what it reads, for the grids that it asks for."""
    contract = model.contract
    passes: list[Pass] = []
    camera_axes = contract.cube_axes == "camera"
    if contract.face is not None:
        passes += [gbuffer.declare_cube(scene, contract.face, camera_axes),
                   direct.declare_cube(lights, contract.face, camera_axes)]
        if scene.environment is not None:
            passes.append(background.declare_cube(scene.environment, lights.scale, contract.face, camera_axes))
    else:
        absent |= dict.fromkeys(CUBE_PASSES, "the network reads no cube")
    tensors = pack_screen.tensor_names(contract)
    if contract.surfels is not None:
        world = TrackedSurfels(scene, *contract.surfels)
        passes += [surfel_light.declare(world, lights),
                   pack_surfels.declare(world, contract, tensors, scene.longest_edge, sky_is_direct)]
    else:
        absent |= dict.fromkeys(("surfel_light", "pack_surfels"), "the network reads no surfels")
    if _reads_vectors(model):
        passes.append(pack_globals.declare(contract, tensors, scene.environment, lights.scale, settings.bounces))
    else:
        absent["pack_globals"] = "the network reads no vector"
    passes.append(pack_screen.declare(contract, settings.size, scene.longest_edge))
    return [*passes, network.declare(model, tensors, grid, {INDIRECT: target})]


def _reads_vectors(model: Network | Reapplied) -> bool:
    return any(spec.grid == GLOBALS for spec in model.contract.inputs.values())
