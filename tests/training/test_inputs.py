from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from app.environment import harmonics  # noqa: E402
from app.load import embedded_scene  # noqa: E402
from app.network.channels import GLOBALS, PANORAMA, RAYS, SURFELS  # noqa: E402
from app.network.contract import ModelContract, TensorSpec  # noqa: E402
from app.network.session import Network  # noqa: E402
from app.radiance_scale import radiance_scale  # noqa: E402
from app.renderer import Renderer  # noqa: E402
from app.scene import Camera, Environment, Instance, PointLight, Scene  # noqa: E402
from app.settings import Settings  # noqa: E402
from export.dataset.network_inputs import (  # noqa: E402
    DEPTH_TOLERANCE,
    InputRenderer,
    PairInputs,
    black_network,
    was_visible,
)
from export.dataset.target import nearest_texels  # noqa: E402
from export.reference.still import Still  # noqa: E402
from export.training.augment import mirror, permute_colors  # noqa: E402
from export.training.losses.loss_inputs import warp  # noqa: E402
from tests.training.pairs import Pair  # noqa: E402

pytestmark = pytest.mark.gl

SIZE = (64, 48)
CHANNELS = ("direct.rgb", "normal.view.xyz", "position.view.xyz", "depth")


def contract(scale: float = 0.5) -> ModelContract:
    return ModelContract(name="test", inputs={"x": TensorSpec(CHANNELS)}, scale=scale, exposure="mean-radiance",
                         outputs={"y": TensorSpec(("indirect.rgb",))}, bounces="multi", scene_extent=40.0)


def pair_of(scene: Scene, step: float = 0.0) -> Pair:
    camera = scene.cameras[scene.default_camera].at(0.0)
    eye = np.asarray(camera.eye) - [step * scene.longest_edge, 0.0, 0.0]
    target = np.asarray(camera.target) - [step * scene.longest_edge, 0.0, 0.0]
    before = replace(camera, eye=tuple(eye), target=tuple(target))
    return Pair(Still(scene, before, SIZE), Still(scene, camera, SIZE))


def render_inputs(pair: Pair, contract: ModelContract) -> PairInputs:
    with InputRenderer(contract) as renderer:
        return renderer.render(pair)


def test_training_inputs_are_the_inference_inputs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The tensors that onnxruntime gets in the renderer are those that ``InputRenderer`` returns."""
    fed: list[np.ndarray] = []
    path = tmp_path / "black.onnx"
    path.write_bytes(black_network(contract()))
    pair = pair_of(embedded_scene())
    run = Network.run

    def spy(self: Network, tensors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        outputs = run(self, tensors)
        fed.append(self._buffers["x"][0].copy())
        return outputs

    monkeypatch.setattr(Network, "run", spy)
    with Renderer(pair.current.scene, Settings(SIZE, ("indirect",), taa=False, provider="cpu"), path) as renderer:
        renderer.render(pair.current.camera)
    inputs = render_inputs(pair, contract())
    np.testing.assert_array_equal(inputs.current.tensors["x"], fed[1])  # the first one is the dry run
    assert inputs.current.tensors["x"][:3].mean() > 0.3


def test_exposure_is_in_the_scenes_own_units() -> None:
    scene = embedded_scene()
    bright = scene.with_lights(*(replace(light, **{key: tuple(1e6 * v for v in getattr(light, key))})
                                 for light in scene.lights
                                 for key in ("radiance", "intensity", "irradiance") if hasattr(light, key)))
    assert radiance_scale(bright) != radiance_scale(scene)
    one, million = (render_inputs(pair_of(s), contract()).current for s in (scene, bright))
    assert million.exposure == pytest.approx(1e6 * one.exposure, rel=1e-2)
    np.testing.assert_allclose(million.tensors["x"][:3].mean(), one.tensors["x"][:3].mean(), rtol=1e-2)


def test_motion_brings_the_previous_frames_positions_here() -> None:
    """Warped by the motion, camera-space positions differ by the step of the camera."""
    step = 0.02
    inputs = render_inputs(pair_of(embedded_scene(), step), contract())
    now, before = (torch.from_numpy(f.tensors["x"][6:9])[None] for f in (inputs.current, inputs.previous))
    moved = warp(before, torch.from_numpy(inputs.motion)[None])[0].numpy()
    off = moved - now[0].numpy() - np.array([step * 40, 0, 0])[:, None, None]
    assert np.abs(inputs.motion[0]).max() > 0.3
    assert inputs.visible.mean() > 0.6
    depth = inputs.current.tensors["x"][9]
    relative = np.abs(off).max(axis=0)[inputs.visible] / depth[inputs.visible]
    assert np.median(relative) < 1e-3
    assert np.percentile(relative, 99) < DEPTH_TOLERANCE  # creases are not planar


def test_a_hidden_surface_was_not_visible() -> None:
    previous = np.full((4, 8), 5.0, np.float32)
    previous[:, 4:] = 0.0  # sky
    expected = np.full((4, 8), 5.0, np.float32)
    expected[2] = 9.0      # was behind the wall
    motion = np.zeros((2, 4, 8), np.float32)
    motion[0] = -1.0       # came from one texel further right
    visible = was_visible(previous, expected, motion)
    assert visible[[0, 1, 3], :3].all()
    assert not visible[2].any() and not visible[:, 3:].any()


def test_a_moved_light_gives_another_previous_frame_and_no_motion() -> None:
    scene = embedded_scene()
    light = PointLight(tuple(scene.bounds.mean(axis=0)), (1.0, 1.0, 1.0))
    camera = scene.cameras[scene.default_camera].at(0.0)
    x, y, z = light.position
    moved = scene.with_lights(replace(light, position=(x, 0.5 * (scene.bounds[0][1] + y), z)))
    pair = Pair(Still(moved, camera, SIZE), Still(scene.with_lights(light), camera, SIZE))
    with InputRenderer(contract()) as renderer:
        inputs, again = renderer.render(pair), renderer.render(pair)
    assert np.abs(inputs.motion).max() == 0.0
    assert not np.allclose(inputs.current.tensors["x"][:3], inputs.previous.tensors["x"][:3], atol=0.05)
    np.testing.assert_array_equal(inputs.previous.tensors["x"], again.previous.tensors["x"])


def test_inputs_of_a_network_with_a_static_input_are_the_same() -> None:
    pair = pair_of(embedded_scene(), 0.02)
    expected, inputs = (render_inputs(pair, c) for c in (contract(), replace(contract(), static_input="x")))
    np.testing.assert_array_equal(inputs.current.tensors["x"], expected.current.tensors["x"])
    np.testing.assert_array_equal(inputs.previous.tensors["x"], expected.previous.tensors["x"])


def test_nearest_texels_are_those_of_the_shader() -> None:
    rows, columns = nearest_texels((256, 192), (128, 96))
    assert rows.tolist() == list(range(0, 192, 2)) and columns.tolist() == list(range(1, 256, 2))


def test_mirroring_the_scene_mirrors_the_inputs() -> None:
    """At full resolution, where nearest texels are symmetric, and with hard shadows, which have no noise."""
    scene = embedded_scene()
    light = PointLight(tuple(scene.bounds.mean(axis=0) + np.array([0.1, 0.2, 0.3])), (1.0, 1.0, 1.0))
    pair = pair_of(scene.with_lights(light), 0.02)
    reflected_pair = Pair(reflected(pair.previous), reflected(pair.current))
    batches = [as_batch(render_inputs(p, contract(1.0))) for p in (pair, reflected_pair)]
    expected, batch = mirror(batches[0], contract(1.0)), batches[1]
    for name in ("current.x", "previous.x", "motion", "visible"):
        off = (expected[name] - batch[name]).abs()
        assert (off > 2e-2 * expected[name].abs().max()).float().mean() < 0.02, name  # edges fall on either side
    assert not torch.allclose(batches[0]["motion"], batch["motion"], atol=0.1)


def test_mirroring_the_scene_mirrors_the_panorama() -> None:
    scene = embedded_scene()
    light = PointLight(tuple(scene.bounds.mean(axis=0) + np.array([0.1, 0.2, 0.3])), (1.0, 1.0, 1.0))
    camera = replace(scene.cameras[scene.default_camera].at(0.0), eye=(0.3, 0.9, 0.2), target=(0.1, 1.0, -1.0))
    still = Still(scene.with_lights(light), camera, SIZE)
    spec = replace(contract(), cube_axes="camera", inputs={
        "x": TensorSpec(("direct.rgb", "normal.view.xyz", "position.view.xyz")),
        "p": TensorSpec(("direct.rgb", "normal.view.xyz", "position.view.xyz"), PANORAMA, 64)})
    with InputRenderer(spec) as renderer:
        here, there = (renderer.render_frame(s).tensors["p"] for s in (still, reflected(still)))
    zeros = {f"{frame}.{t}": torch.zeros(1, s.components, *s.extent((8, 6)))
             for frame in ("current", "previous") for t, s in spec.inputs.items()}
    batch = {**zeros, "current.p": torch.from_numpy(here.copy())[None], "motion": torch.zeros(1, 2, 8, 6)}
    expected = mirror(batch, spec)["current.p"][0]
    off = (expected - torch.from_numpy(there)).abs()
    assert (off > 2e-2 * expected.abs().max()).float().mean() < 0.02  # edges fall on either side
    assert (here != there).mean() > 0.3


def as_batch(inputs: PairInputs) -> dict[str, torch.Tensor]:
    arrays = {"current.x": inputs.current.tensors["x"], "previous.x": inputs.previous.tensors["x"],
              "motion": inputs.motion, "visible": inputs.visible[None].astype(np.float32)}
    batch = {name: torch.from_numpy(np.ascontiguousarray(x))[None] for name, x in arrays.items()}
    return {**batch, "target": torch.zeros(1, 3, SIZE[1], SIZE[0])}


def reflected(still: Still) -> Still:
    """The still mirrored at x = 0."""
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    scene = still.scene
    instances = tuple(Instance(i.name, i.mesh, flip @ i.transform, i.motion) for i in scene.instances)
    lights = tuple(replace(light, position=(-light.position[0], *light.position[1:])) for light in scene.lights)
    camera: Camera = still.camera
    camera = replace(camera, eye=(-camera.eye[0], *camera.eye[1:]), target=(-camera.target[0], *camera.target[1:]),
                     up=(-camera.up[0], *camera.up[1:]))
    bounds = np.array([[-scene.bounds[1][0], *scene.bounds[0][1:]], [-scene.bounds[0][0], *scene.bounds[1][1:]]])
    return Still(replace(scene, instances=instances, lights=lights, bounds=bounds), camera, still.size, still.time)



def test_harmonics_are_mirrored_and_their_colours_permuted() -> None:
    rng = np.random.default_rng(0)
    radiance = rng.random((8, 16, 3), np.float32)
    spec = replace(contract(), inputs={"x": TensorSpec(("normal.view.xyz",)),
                                       "v": TensorSpec(("environment.sh",), GLOBALS)})

    def batch(image: np.ndarray) -> dict[str, torch.Tensor]:
        vector = torch.from_numpy(harmonics(Environment(image), np.eye(3)))[None]
        zeros = torch.zeros(1, 3, 8, 6)
        return {"current.x": zeros, "previous.x": zeros, "current.v": vector, "previous.v": vector, "target": zeros,
                "motion": torch.zeros(1, 2, 8, 6)}

    here = batch(radiance)
    torch.testing.assert_close(mirror(here, spec)["current.v"], batch(radiance[:, ::-1])["current.v"])
    order = torch.tensor([[2, 0, 1]])
    expected = batch(radiance[..., [2, 0, 1]])["current.v"]
    torch.testing.assert_close(permute_colors(here, spec, order)["current.v"], expected)


def test_mirroring_keeps_the_order_of_surfels_and_rays() -> None:
    spec = replace(contract(), inputs={"x": TensorSpec(("normal.view.xyz",)),
                                       "s": TensorSpec(("position.view.xyz",), SURFELS, 4),
                                       "r": TensorSpec(("ray.surfel",), RAYS, 4, 9)})
    batch = {f"{frame}.{t}": torch.rand(1, *s.shape((8, 6))) for frame in ("current", "previous")
             for t, s in spec.inputs.items()}
    batch |= {"motion": torch.rand(1, 2, 6, 8), "visible": torch.ones(1, 1, 6, 8), "target": torch.rand(1, 3, 6, 8)}
    flipped = mirror(batch, spec)
    assert torch.equal(flipped["current.r"], batch["current.r"])
    assert torch.equal(flipped["current.s"][:, 1:], batch["current.s"][:, 1:])
    assert torch.equal(flipped["current.s"][:, 0], -batch["current.s"][:, 0])
    assert torch.equal(flipped["target"], batch["target"].flip(-1))
