"""The catalogue: which scenes are drawn with which model, and which of their frames become goldens."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from app.exchange.mapped import MappedExchange
from app.golden import scenes
from app.golden.case import Case
from app.golden.copy_case import CopyCase
from app.golden.network_case import NetworkCase
from app.golden.scene_case import OUTPUTS, SceneCase, Shot
from app.network.contract_json import read_contract
from app.network.selection import SSGI, UNSHADOWED, Model, bundled_models, find_model
from app.scene import Scene
from app.settings import TONE_MAPS

PROBE = Path(__file__).with_name("probe.onnx")  # reads every channel, with a cube in camera axes
PROBE_ENVIRONMENT = PROBE.with_name("probe_environment.onnx")  # the same for networks that shade an environment
NOON_STAGES = ("environment_lowres_gbuffer", "unshadowed_environment", "environment_pack_globals",
               "environment_pack_screen", "environment_network", "push_pull_diffuse", "upsample_specular", "direct")
SKY_STAGES = ("cube_background", "background", "pack_globals", "pack_screen", "composite", "taa")
SKY_LIGHT_STAGES = ("sky_light", "shadow_gbuffer", "shadow_rays", "shadow_history", "shadow_filter_near",
                    "shadow_filter_far", "direct")
WAVING_STAGES = "shadow", "gbuffer", "direct", "surfel_light", "pack_surfels"
SSGI_STAGES = ("lowres_gbuffer", "ssgi_radiance", "ssgi", "ssgi_filter_near", "ssgi_filter_far", "accumulate",
               "push_pull", "upsample")
MATERIALS_STAGES = ("gbuffer", "gbuffer_layers", "direct", "composite")
GLASS_STAGES = ("shadow", "peel0_gbuffer", "peel0_exit", "peel0_direct", "peel1_gbuffer", "peel1_blend", "peel0_blend",
                "front_motion")
PARALLEL_STAGES = "gbuffer", "background", "shadow_filter_far", "direct", "pack_screen", "upsample", "taa"
BUMPS_STAGES = "gather_history", "gradient_filter_near", "gradient_filter_far", "upsample"
PARALLEL_GLASS_STAGES = "position", "ssgi", "ssgi_filter_near", "accumulate", "upsample", "peel0_direct", "peel0_blend"
LABELS = "instance", "material", "flow"
REFLECTION_STAGES = ("reflection_march", "reflection_rays", "reflection_resolve", "reflection_history",
                     "reflection_filter_far", "reflection_filter_near", "reflection")
WITH_REFLECTION = (*OUTPUTS, "reflection")  # which ``composite`` has no need of
AREA_LIGHTS_STAGES = ("shadow", "gbuffer", "position", "shadow_gbuffer", "shadow_rays", "shadow_history",
                      "shadow_filter_near", "shadow_filter_far", "direct", "composite", "taa", "tonemap")
OUTDOOR_STAGES = ("shadow", "gbuffer", "shadow_gbuffer", "shadow_rays", "shadow_history", "shadow_filter_near",
                  "shadow_filter_far", "direct", "lowres_gbuffer", "cube_gbuffer", "cube_shadow_rays", "cube_direct",
                  "pack_screen", "network", "accumulate", "push_pull", "upsample", "taa")
SETTLING_FRAMES = 3  # after which accumulation and TAA have a history


def catalogue() -> dict[str, Case]:
    """All cases by name in checking order; bundled networks that no scene case uses are checked alone."""
    ember, radiosity, gather = find_model("ember"), find_model("radiosity"), find_model("gather")
    # The sequence ends a few frames after its cut, while histories are still short.
    sequence = (Shot("path", scenes.SEQUENCE), Shot("corner", 4))
    cases: list[SceneCase] = [
        SceneCase("room", scenes.room(), radiosity, sequence, golden_frames=(1, 16, 64)),
        replace(_settled("outdoor", scenes.outdoor(), gather), stages=OUTDOOR_STAGES),
        replace(_settled("sharpened", scenes.outdoor(), None), size=(96, 72), stages=("taa", "sharpen")),
        replace(_settled("upscaled", scenes.outdoor(), None), size=(97, 71), stages=("upscale_guide", "upscale"),
                outputs=("final",), render_scale=0.5),
        replace(_settled("upscaled_still", scenes.materials(), None), size=(64, 48),
                stages=("upscale_guide", "upscale"), outputs=("final",), render_scale=0.7),
        _single("hard", scenes.hard(), PROBE),
        replace(_settled("area_lights", scenes.area_lights(), None), seed=5, size=(160, 120),
                stages=AREA_LIGHTS_STAGES),
        replace(_settled("screen", scenes.screen(), None), size=(64, 48), stages=("shadow_rays", "direct")),
        _single("spotlights", scenes.spotlights(), None),
        _single("terrace", scenes.terrace(), PROBE),
        _single("emissive", scenes.emissive(), radiosity),
        replace(_settled("waving", scenes.waving(), ember), stages=WAVING_STAGES),
        SceneCase("dusk", scenes.dusk(), PROBE, (Shot("path", 5),), (2, 5), stages=SKY_STAGES),
        replace(_under_sky("noon", PROBE_ENVIRONMENT), stages=NOON_STAGES),
        replace(_settled("sky", scenes.noon(), None), size=(128, 96), stages=SKY_LIGHT_STAGES),
        replace(_single("materials", scenes.materials(), SSGI), size=(160, 120), stages=MATERIALS_STAGES),
        replace(_settled("glass", scenes.glass(), SSGI), size=(160, 120), stages=GLASS_STAGES),
        replace(_settled("shaded_glass", scenes.glass(), UNSHADOWED), size=(64, 48), stages=("peel0_direct",)),
        replace(_settled("parallel", scenes.parallel(scenes.dusk(), 2.6), PROBE), size=(96, 72),
                stages=PARALLEL_STAGES),
        replace(_settled("parallel_glass", scenes.parallel(scenes.glass(), 2.6), SSGI), size=(80, 60),
                stages=PARALLEL_GLASS_STAGES),
        replace(_settled("labels", scenes.glass(), None), size=(96, 72), stages=("labels",), outputs=LABELS),
        *(replace(_single(name.replace("-", "_"), scenes.area_lights(), None), size=(96, 72), stages=("tonemap",),
                  tonemap=name) for name in TONE_MAPS[1:]),
        replace(_settled("auto_exposure", scenes.area_lights(), None), size=(96, 72),
                stages=("auto_exposure", "tonemap"), auto_exposure=True),
        replace(_single("auto_exposure_of_one_frame", scenes.area_lights(), None), size=(96, 72),
                stages=("auto_exposure",), auto_exposure=True, taa=False),
        replace(_settled("mirrors", scenes.mirrors(), SSGI), size=(64, 48), outputs=WITH_REFLECTION,
                stages=REFLECTION_STAGES, reflections=True),
        replace(_single("glossy", scenes.materials(), SSGI), size=(64, 48), reflections=True,
                outputs=WITH_REFLECTION, stages=("direct", "reflection_history", "reflection", "composite")),
        replace(_settled("reflected_still", scenes.materials(), SSGI), size=(320, 240), reflections=True,
                outputs=WITH_REFLECTION, stages=("reflection_detail", "reflection")),
        # Larger than the grid of reflections.
        replace(_settled("mirrors_in_motion", scenes.mirrors(), SSGI), size=(320, 240), reflections=True,
                outputs=WITH_REFLECTION, stages=("reflection_detail",)),
        replace(_settled("glass_reflected", scenes.glass(), SSGI), size=(64, 48), reflections=True,
                stages=("reflection_march", "outer_surface", "outer_reflection", "peel0_blend")),
        replace(_settled("coats_reflected", scenes.materials(), SSGI), size=(40, 30), reflections=True,
                stages=("outer_surface", "outer_reflection", "composite")),
        replace(_settled("parallel_mirrors", scenes.parallel(scenes.mirrors(), 1.6), SSGI), size=(64, 48),
                outputs=WITH_REFLECTION, stages=REFLECTION_STAGES[-2:], reflections=True),
        replace(_settled("ssgi", scenes.room(), SSGI), stages=SSGI_STAGES),
        replace(_settled("ember", scenes.room(), ember), stages=("surfel_light", "pack_surfels", "missed_pixels")),
        replace(_settled("gathered", scenes.room(), find_model("final-gather")), size=(96, 72),
                stages=("gather_history",)),
    ]
    # Tensors as they are shared with onnxruntime on a GPU; their network has a case of its own already.
    mapped = replace(_single("mapped", scenes.room(), radiosity), size=(96, 72), stages=("network",),
                     open_exchange=MappedExchange)
    # Light on bumps, and rays that shaders trace; the networks are those of cases above.
    bumps = replace(_settled("bumps", scenes.materials(), find_model("final-gather")), size=(64, 48),
                    stages=BUMPS_STAGES)
    lit_glass = replace(_settled("lit_glass", scenes.glass(), ember), size=(40, 30),
                        stages=("layer_light", "peel0_blend"))
    on_gpu = [
        replace(bumps, name="bumps_on_gpu", rays="gpu", stages=("gather_rays",)),
        replace(_settled("gathered_on_gpu", scenes.room(), find_model("final-gather")), size=(64, 48), rays="gpu",
                stages=("shadow_rays", "gather_rays", "missed_light")),
        replace(_settled("reflected_on_gpu", scenes.materials(), SSGI), size=(64, 48), reflections=True, rays="gpu",
                stages=("shadow_rays", "reflection_rays")),
        replace(_settled("mirrors_on_gpu", scenes.mirrors(), SSGI), size=(64, 48), reflections=True, rays="gpu",
                stages=("reflection_rays",)),
    ]
    used = {case.model for case in cases}
    others = [NetworkCase(_alone(name, file), file) for name, file in bundled_models().items() if file not in used]
    every = (*with_networks(cases), mapped, bumps, lit_glass, *on_gpu, *others, CopyCase())
    by_name = {case.name: case for case in every}
    assert len(by_name) == len(every), "two cases have the same name"
    return by_name


def with_networks(cases: Iterable[SceneCase]) -> list[Case]:
    """Each case, followed by the case of its network alone if it has one."""
    every: list[Case] = []
    for case in cases:
        every.append(case)
        if isinstance(case.model, Path):
            every.append(NetworkCase(case, case.model))
    return every


def _settled(name: str, scene: Scene, model: Model | None) -> SceneCase:
    """A case of the last of a few frames, with temporal anti-aliasing."""
    return SceneCase(name, scene, model, (Shot(scene.default_camera, SETTLING_FRAMES),), (SETTLING_FRAMES,))


def _alone(name: str, file: Path) -> SceneCase:
    """The scene case whose tensors a network of no other case runs on."""
    if read_contract(file).shades_environment:
        return _under_sky(name, file)
    return _single(name, scenes.room(), file)


def _under_sky(name: str, model: Path) -> SceneCase:
    """A case of one small frame lit by an environment."""
    return replace(_single(name, scenes.noon(), model), size=(128, 96))


def _single(name: str, scene: Scene, model: Model | None) -> SceneCase:
    """A case of one frame without temporal anti-aliasing."""
    return SceneCase(name, scene, model, (Shot(scene.default_camera, 1),), (1,), taa=False)
