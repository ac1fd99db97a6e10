"""The network that cleans gathered light: energy, exposure, what it keeps apart, and its training."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="export needs torch")

import torch
from onnxruntime import InferenceSession
from torch import Tensor

from app.errors import ModelError, SettingsError
from app.network.selection import find_model
from app.network.session import Network
from app.surfels.final_gather import sequence
from export.dataset.gathered_frames import GatheredFrame, make_frames, read_frames
from export.models.final_gather import FinalGather
from export.models.gather_cleaners import CLEANERS
from export.models.local_mean import MAX_NOISE, keep_local_mean
from export.onnx.export import export_cleaner
from export.onnx.gather_cli import train as train_command
from export.training.final_gather import CROP, make_example, relative_error, train

SIZE = (48, 32)


def wall(light: np.ndarray, count: float = 8.0) -> np.ndarray:
    """The network's input of a wall that faces the camera, 10 units away, for gathered and interpolated light."""
    height, width = light.shape[1:]
    screen = np.zeros((14, height, width), np.float32)
    screen[:3] = screen[5:8] = light
    screen[3], screen[4], screen[10], screen[13] = count, 1.0, 1.0, -10.0
    screen[11], screen[12] = np.meshgrid(np.linspace(-5, 5, width), np.linspace(4, -4, height))
    return screen


@pytest.fixture(scope="module")
def network() -> Network:
    return Network(find_model("final-gather"), SIZE, "cpu")


def clean(network: Network, screen: np.ndarray) -> np.ndarray:
    return network.run({"screen": screen})["indirect.rgb"]


def test_uniform_light_stays_and_none_is_beyond_that_of_the_rays(network: Network) -> None:
    uniform = np.full((3, *SIZE[::-1]), 0.7, np.float32)
    np.testing.assert_allclose(clean(network, wall(uniform)), 0.7, rtol=1e-4)
    noisy = np.random.default_rng(0).exponential(1.0, uniform.shape).astype(np.float32)
    assert clean(network, wall(noisy)).max() <= noisy.max()
    assert clean(network, wall(noisy)).min() >= noisy.min()


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_light_times_a_factor_gives_the_result_times_the_factor(network: Network, factor: float) -> None:
    noisy = np.random.default_rng(1).exponential(1.0, (3, *SIZE[::-1])).astype(np.float32)
    once, scaled = clean(network, wall(noisy)), clean(network, wall(noisy * np.float32(factor)))
    np.testing.assert_allclose(scaled, once * factor, rtol=1e-3)


def test_few_rays_lose_most_of_their_noise(network: Network) -> None:
    noise = np.random.default_rng(2).exponential(1.0, (3, *SIZE[::-1])).astype(np.float32)
    screen = wall(noise, 1.0)
    screen[5:8] = 1.0
    assert clean(network, screen).std() < 0.15 * noise.std()


@pytest.mark.parametrize("name", ["final-gather", "bcnn-gather", "gfa-gather"])
def test_rare_bright_rays_keep_their_light(name: str) -> None:
    """As of the housing of a tube: one texel of 50 has met it, which is half of all light."""
    network = Network(find_model(name), SIZE, "cpu")
    rng = np.random.default_rng(8)
    met = rng.random(SIZE[::-1]) < 0.02
    light = np.where(met, 25.0, 0.5) * np.ones((3, 1, 1))
    screen = wall(light.astype(np.float32), 16.0)
    screen[5:8] = 0.6
    assert clean(network, screen).mean() > 0.8 * light.mean()  # by its kernels alone 0.58
    mirrored = light.copy()
    mirrored[:, :, SIZE[0] // 2:] = 0.5  # where no ray has met it, no light is added
    cleaned = clean(network, wall(mirrored.astype(np.float32), 16.0))
    assert cleaned[:, :, 3 * SIZE[0] // 4:].mean() < 0.7


def test_a_single_bright_ray_is_taken_for_noise(network: Network) -> None:
    screen = wall(np.full((3, *SIZE[::-1]), 0.5, np.float32), 1.0)
    screen[:3, 16, 24] = 200.0
    assert clean(network, screen)[:, 8:24, 16:32].mean() < 0.65  # with all of its light it would be 1.3


def kept(cleaned: Tensor, gathered: Tensor, count: Tensor | None = None, depth: Tensor | None = None) -> Tensor:
    """``keep_local_mean`` on walls that face the camera, for light of shape (h, w)."""
    shape = 1, 3, *gathered.shape
    normal = torch.tensor([0.0, 0.0, 1.0]).reshape(1, 3, 1, 1).expand(shape).clone()
    position = torch.zeros(shape)
    position[:, 2] = -5.0 if depth is None else -depth
    count = torch.ones(gathered.shape) if count is None else count
    return keep_local_mean(cleaned.expand(shape), gathered.expand(shape), count.expand(1, 1, -1, -1), normal,
                           position)[0, 0]


def test_the_local_mean_is_that_of_one_surface() -> None:
    """Cleaned light of two walls, one behind the other, is too dark on one of them alone."""
    gathered, left = torch.ones(64, 64), torch.arange(64) < 32
    light = kept(torch.where(left, 0.7, 1.0).expand(64, 64), gathered, depth=torch.where(left, 5.0, 8.0).expand(64, 64))
    torch.testing.assert_close(light[:, :28], gathered[:, :28], rtol=0.05, atol=0)
    torch.testing.assert_close(light[:, 36:], gathered[:, 36:], rtol=1e-3, atol=0)


def test_the_local_mean_reaches_as_far_as_its_two_kernels() -> None:
    """Four cells to all sides of a cell, and as far as a cell further by interpolation."""
    gathered = torch.ones(96, 96)
    gathered[48:52, 48:52] = 3.0
    changed = (kept(torch.ones(96, 96), gathered) - 1).abs() > 1e-5
    rows = torch.nonzero(changed.any(1)).flatten()
    assert 48 - 16 - 4 <= int(rows.min()) <= 48 - 16 and 52 + 16 - 1 <= int(rows.max()) < 52 + 16 + 4


@pytest.mark.parametrize("bright", [1, 16, 64])
def test_the_local_mean_is_known_by_how_many_texels_say_it(bright: int) -> None:
    """The relative variance of the mean of N texels, of which k have all the light, is 1 / k; 0.2² counts by half."""
    gathered = torch.zeros(36, 36)
    gathered.flatten()[torch.randperm(36 * 36, generator=torch.Generator().manual_seed(0))[:bright]] = 1.0
    cleaned = torch.full((36, 36), float(gathered.mean()) / 2)
    ratio = kept(cleaned, gathered)[18, 18] / cleaned[18, 18]
    assert float(ratio) == pytest.approx(1 + 1 / (1 + 1 / bright / MAX_NOISE**2), rel=0.04)


def test_texels_count_by_their_rays_in_the_local_mean() -> None:
    gathered, count = torch.ones(36, 36), torch.ones(36, 36)
    gathered[:, 1::2], count[:, 1::2] = 3.0, 3.0
    assert float(kept(torch.ones(36, 36), gathered, count)[18, 18]) == pytest.approx(2.5, rel=0.03)
    no_rays = kept(torch.ones(8, 8), torch.zeros(8, 8), torch.zeros(8, 8))
    torch.testing.assert_close(no_rays, torch.ones(8, 8))


def test_the_local_mean_is_changed_by_a_factor_of_four_at_most() -> None:
    for factor, expected in ((100.0, 4.0), (0.01, 0.25)):
        light = kept(torch.ones(64, 64), torch.full((64, 64), factor))[32, 32]
        assert float(light) == pytest.approx(expected, rel=0.07)


def test_light_does_not_creep_around_a_corner(network: Network) -> None:
    """The left half faces right and is lit by a strip; the right half faces the camera, and is dark up to the edge."""
    screen = wall(np.zeros((3, *SIZE[::-1]), np.float32), 16.0)
    left = np.s_[:, : SIZE[0] // 2]
    rng = np.random.default_rng(3)
    lit = np.where(np.arange(SIZE[0]) < SIZE[0] // 2, 10.0, 0.1).astype(np.float32)
    screen[:3] = lit * rng.uniform(0.5, 1.5, (3, *SIZE[::-1]))
    screen[5:8] = lit
    screen[8][left], screen[10][left] = 1.0, 0.0
    screen[13][left] += np.linspace(5, 0, SIZE[0] // 2, dtype=np.float32)
    screen[11][left] = 0.0
    dark = clean(network, screen)[:, :, SIZE[0] // 2:]
    assert dark.max() < 0.2


def test_a_contact_shadow_that_many_rays_agree_on_stays_dark(network: Network) -> None:
    """Three texels wide, on a plane, where nothing but the light and the distance of the rays' ends shows an edge."""
    light = np.ones((3, *SIZE[::-1]), np.float32)
    light[:, 14:17] = 0.2
    screen = wall(light, 2000.0)
    screen[4, 14:17] = 0.2
    screen[5:8] = 0.9
    shadow = clean(network, screen)[:, 15]
    assert shadow.mean() < 0.5


def test_texels_of_the_sky_and_poison_leave_finite_light(network: Network) -> None:
    screen = wall(np.ones((3, *SIZE[::-1]), np.float32))
    screen[:, :10] = 0.0
    cleaned = clean(network, screen)
    np.testing.assert_array_equal(cleaned[:, :10], 0)
    np.testing.assert_allclose(cleaned[:, 10:], 1, rtol=1e-3)
    garbage = np.random.default_rng(9).normal(size=screen.shape).astype(np.float32)
    for value in (np.nan, np.inf, -np.inf, -100.0, 1e30):
        assert np.isfinite(clean(network, np.full_like(screen, value))).all()
        assert np.isfinite(clean(network, garbage * np.float32(value))).all()


def frame(rays: int = 24) -> GatheredFrame:
    """A wall with a bright and a dark half."""
    size = 72, 96
    rng = np.random.default_rng(4)
    screen = wall(np.where(np.arange(size[1]) < 48, 2.0, 0.5) * np.ones((3, *size)))
    light = screen[:3].transpose(1, 2, 0)[:, :, None] * rng.exponential(1.0, (2, *size, rays, 1))
    return GatheredFrame(*light.astype(np.float16), np.ones((*size, rays), np.float16), screen[5:8], screen[8:11],
                         screen[11:])


def test_examples_have_inputs_and_targets_of_the_same_light() -> None:
    rng = np.random.default_rng(5)
    for _ in range(8):
        screen, target = make_example(frame(), rng)
        assert screen.shape == (14, CROP, CROP) and target.shape == (3, CROP, CROP)
        known = screen[3] > 0
        assert known.sum() > 0 and screen[3].max() <= 24
        assert not screen[:8, ~known].any()
        before, after, expected = (x[:, known] for x in (screen[:3], target, screen[5:8]))
        assert abs(float(after.mean() / expected.mean()) - 1) < 0.1
        assert np.corrcoef((before / expected).flatten(), (after / expected).flatten())[0, 1] < 0.1


def test_some_examples_have_texels_whose_turn_has_not_come_yet() -> None:
    rng = np.random.default_rng(6)
    screens = [make_example(frame(), rng)[0] for _ in range(40)]
    assert any(bool((screen[3] == 0).any()) for screen in screens)
    assert any(bool((screen[3] > 0).all()) for screen in screens)


def test_the_loss_has_its_minimum_at_the_mean_of_noisy_targets() -> None:
    targets = torch.tensor([0.5, 1.5]).repeat(500).reshape(1, 1, 1, -1).expand(1, 3, 1, -1)
    normal = torch.ones_like(targets)

    def loss(value: float) -> Tensor:
        return relative_error(torch.full_like(targets, value), targets, normal, torch.ones(1)) * (value + 0.1) ** 2

    assert loss(1.0) < loss(0.95) and loss(1.0) < loss(1.05)


def test_training_lowers_the_loss_and_counts_its_steps() -> None:
    reports: list[tuple[int, float]] = []
    network = train([frame()], 6.0, 0, lambda step, seconds, loss: reports.append((step, loss)), report_steps=2)
    assert isinstance(network, FinalGather)
    assert [step for step, _ in reports] == list(range(2, 2 * len(reports) + 1, 2))
    assert all(np.isfinite(loss) for _, loss in reports)


@pytest.mark.gl
@pytest.mark.usefixtures("egl")
def test_frames_have_rays_whose_mean_is_near_the_interpolated_light(tmp_path: Path,
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("export.dataset.gathered_frames.RAYS", 4)
    phases: list[float] = []
    monkeypatch.setattr("app.passes.final_gather.sequence",
                        lambda *arguments: phases.append(arguments[-1]) or sequence(*arguments))
    done: list[int] = []
    make_frames(tmp_path, 1, 0, done.append)
    frames = read_frames(tmp_path)
    assert done == [1] and len(frames) == 2
    for made in frames:
        assert (made.distance >= 0).all() and (made.distance <= 1).all() and np.isfinite(made.light).all()
        shown = np.abs(made.normal).sum(axis=0) > 0
        mean = made.light[shown].astype(np.float64).mean()
        assert mean == pytest.approx(made.interpolated[:, shown].mean(), rel=0.25)
        assert not made.light[~shown].any()
        assert made.target[shown].astype(np.float64).mean() == pytest.approx(mean, rel=0.1)
    assert len({*phases[-4:]}) == len({*phases[-8:-4]}) == 1 and phases[-4] != phases[-8]  # two sequences


def test_a_folder_without_frames_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="no frames"):
        read_frames(tmp_path)
    file = tmp_path / "0000-0.npz"
    parts = vars(frame())
    np.savez(file, **{name: values for name, values in parts.items() if name != "target"})  # as before 0.1.0
    for content in (file.read_bytes(), b"", b"text", file.read_bytes()[:1000]):
        file.write_bytes(content)
        with pytest.raises(SettingsError, match="not a frame"):
            read_frames(tmp_path)
    np.savez(file, **parts)
    assert len(read_frames(tmp_path)) == 1


@pytest.mark.parametrize("name", CLEANERS)
def test_every_cleaner_is_written_with_the_weights_of_its_training(name: str, tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = CLEANERS[name]().eval()
    torch.nn.init.normal_(network.last.weight, std=0.1)
    torch.save({"name": name, "weights": network.state_dict()}, tmp_path / "weights.pt")
    file = export_cleaner(tmp_path / "weights.pt", "nothing", tmp_path)
    assert file.name == f"{name}.onnx"
    screen = wall(np.random.default_rng(7).exponential(1.0, (3, *SIZE[::-1])).astype(np.float32))
    with torch.no_grad():
        expected = network(torch.from_numpy(screen)[None])[0].numpy()
    session = InferenceSession(file, providers=["CPUExecutionProvider"])
    np.testing.assert_allclose(session.run(None, {"screen": screen[None]})[0][0], expected, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("saved", [torch.ones(3), {"name": "other", "weights": {}}, {"weights": {}}, 5])
def test_weights_of_something_else_are_refused(saved: object, tmp_path: Path) -> None:
    torch.save(saved, tmp_path / "weights.pt")
    with pytest.raises(ModelError, match="can't read the weights"):
        export_cleaner(tmp_path / "weights.pt", "nothing", tmp_path)
    (tmp_path / "weights.pt").write_bytes(b".")
    with pytest.raises(ModelError, match="can't read the weights"):
        export_cleaner(tmp_path / "weights.pt", "nothing", tmp_path)
    assert not list(tmp_path.glob("*.onnx"))


def test_an_unknown_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="no network 'other'"):
        train_command(tmp_path, tmp_path / "weights.pt", network="other")
