"""Ember as a network alone: linear in light, colour by colour; bounded in energy; finite whatever it is fed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import onnxruntime as ort
import pytest

from app.network.channels import ALL_BOUNCES, RAYS, SURFELS
from app.network.contract import find_model, read_contract

torch = pytest.importorskip("torch", reason="networks are made with torch")
from export.models.ember import BOUNCES, Ember, bounce, carry, neumann_series  # noqa: E402

F32 = np.float32
Arrays = dict[str, np.ndarray]
Run = Callable[[Arrays], np.ndarray]
IRRADIANCE, GLOW, RADIUS, WEIGHT = slice(6, 9), slice(9, 12), 12, 13  # rows of the tensor ``surfels``
LIGHT = slice(6, 12)
SCREEN = (6, 9)
ALL = torch.tensor(ALL_BOUNCES)


@pytest.fixture(scope="module", params=["torch", "onnx"])
def network(request: pytest.FixtureRequest) -> tuple[Run, int, int]:
    """What runs raw tensors, without the renderer's exposure; its surfels and rays."""
    if request.param == "torch":
        module = Ember(surfels=256, rays=36).eval()

        def by_torch(inputs: Arrays) -> np.ndarray:
            with torch.no_grad():
                found: np.ndarray = module(**{n: torch.from_numpy(a) for n, a in inputs.items()}).numpy()
            return found

        return by_torch, 256, 36
    contract = read_contract(find_model("ember"))
    session = ort.InferenceSession(str(find_model("ember")), providers=["CPUExecutionProvider"])
    sizes = {spec.grid: spec for spec in contract.inputs.values()}

    def by_onnx(inputs: Arrays) -> np.ndarray:
        found: np.ndarray = session.run(None, inputs)[0]
        return found

    return by_onnx, sizes[SURFELS].size or 0, sizes[RAYS].rays or 0


def sphere_of_surfels(count: int, rays: int, albedo: float | None = 0.7) -> Arrays:
    """Surfels on a sphere of radius 10 seen from its middle, each ray to any other; random light without."""
    rng = np.random.default_rng(0)

    def directions(n: int) -> np.ndarray:
        v = rng.normal(size=(n, 3))
        return (v / np.linalg.norm(v, axis=1, keepdims=True)).T

    surfels = np.zeros((14, count))
    surfels[:3] = 10 * directions(count)
    surfels[3:6] = -surfels[:3] / 10
    surfels[IRRADIANCE], surfels[GLOW] = rng.random((2, 3, count)) ** 4
    surfels[RADIUS], surfels[WEIGHT] = 20 * np.sqrt(8 / count), 1
    table = np.empty((4, count, rays))
    table[0] = rng.integers(0, count, (count, rays))
    table[1:] = rng.random((3, count, rays)) if albedo is None else albedo
    seen = directions(SCREEN[0] * SCREEN[1])
    screen = np.concatenate([10 * seen, -seen]).reshape(6, *SCREEN)
    return {n: a[None].astype(F32) for n, a in (
        ("screen", screen), ("surfels", surfels), ("rays", table), ("bounces", np.array([ALL_BOUNCES])))}


def with_light(inputs: Arrays, light: Any) -> Arrays:
    surfels = inputs["surfels"].copy()
    surfels[0, LIGHT] = light
    return inputs | {"surfels": surfels}


def relative(found: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(found - reference).max() / np.abs(reference).max())


def test_light_adds_up(network: tuple[Run, int, int]) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size, albedo=None)
    first, second = np.random.default_rng(1).random((2, 6, size[0])).astype(F32) ** 8
    both = run(with_light(inputs, first + second))
    error = relative(run(with_light(inputs, first)) + run(with_light(inputs, second)), both)
    print(f"ADDITIVITY {error:.1e}")
    assert both.min() > 0
    assert error < 1e-5


@pytest.mark.parametrize("factor", [0.1, 0.3, 3.0, 10.0])
def test_light_scales(network: tuple[Run, int, int], factor: float) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size, albedo=None)
    light = inputs["surfels"][0, LIGHT]
    error = relative(run(with_light(inputs, light * F32(factor))), run(inputs) * factor)
    assert error < 1e-5


def test_colours_do_not_mix(network: tuple[Run, int, int]) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size)
    light = inputs["surfels"][0, LIGHT].copy()
    light[[1, 2, 4, 5]] = 0
    found = run(with_light(inputs, light))[0]
    assert found[0].min() > 0
    assert not found[1:].any()


def test_every_colour_is_treated_alike(network: tuple[Run, int, int]) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size, albedo=None)
    turned = {n: a.copy() for n, a in inputs.items()}
    for rows in (slice(6, 9), slice(9, 12)):
        turned["surfels"][0, rows] = np.roll(inputs["surfels"][0, rows], 1, axis=0)
    turned["rays"][0, 1:] = np.roll(inputs["rays"][0, 1:], 1, axis=0)
    np.testing.assert_allclose(run(turned)[0], np.roll(run(inputs)[0], 1, axis=0), rtol=1e-5)


def test_no_light_gives_exactly_none(network: tuple[Run, int, int]) -> None:
    run, *size = network
    assert not run(with_light(sphere_of_surfels(*size), 0.0)).any()


def test_no_surfels_give_no_light(network: tuple[Run, int, int]) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size)
    none = {"surfels": np.zeros_like(inputs["surfels"]), "rays": np.zeros_like(inputs["rays"])}
    none["surfels"][0, RADIUS], none["rays"][0, 0] = 0.3, -1
    assert not run(inputs | none).any()


def test_unused_surfels_change_nothing(network: tuple[Run, int, int]) -> None:
    """The same light and radius everywhere, so that half of the surfels say what all of them do."""
    run, *size = network
    inputs = with_light(sphere_of_surfels(*size), 1.0)
    whole = run(inputs)
    half = {n: a.copy() for n, a in inputs.items()}
    rows = slice(size[0] // 2, None)
    half["surfels"][0, :12, rows], half["surfels"][0, WEIGHT, rows] = 0, 0
    half["rays"][0, 0] %= size[0] // 2
    half["rays"][0, 1:, rows], half["rays"][0, 0, rows] = 0, -1
    np.testing.assert_allclose(run(half), whole, rtol=1e-4)


def test_the_sky_stays_black(network: tuple[Run, int, int]) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size)
    inputs["screen"][0, :, 2, 3] = 0
    found = run(inputs)[0]
    assert not found[:, 2, 3].any()
    assert np.count_nonzero(found[0]) == SCREEN[0] * SCREEN[1] - 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -3e38])
@pytest.mark.parametrize("tensor", ["screen", "surfels", "rays"])
def test_what_is_no_number_leaves_numbers(network: tuple[Run, int, int], tensor: str, bad: float) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size)
    inputs[tensor][np.random.default_rng(2).random(inputs[tensor].shape) < 0.05] = bad
    found = run(inputs)
    assert np.isfinite(found).all()
    assert (found >= 0).all()


def test_nothing_but_broken_values_leaves_numbers(network: tuple[Run, int, int]) -> None:
    run, *size = network
    for bad in (np.nan, np.inf):
        assert np.isfinite(run({n: np.full_like(a, bad) for n, a in sphere_of_surfels(*size).items()})).all()


def test_one_broken_albedo_stays_local(network: tuple[Run, int, int]) -> None:
    """Its surfel loses what its rays bring, of which all others see one part in their number."""
    run, *size = network
    inputs = with_light(sphere_of_surfels(*size), 1.0)
    whole = run(inputs)
    for plane in range(4):
        poisoned = {n: a.copy() for n, a in inputs.items()}
        poisoned["rays"][0, plane, 7, 0] = np.nan
        changed = np.abs(run(poisoned) / whole - 1)
        assert np.median(changed) < 0.02
        assert (changed > 0.05).mean() < 0.15


@pytest.mark.parametrize("rho", [0.2, 0.5, 0.8, 0.9])
@pytest.mark.parametrize("source", ["irradiance", "glow"])
def test_all_bounces_in_an_even_enclosure(rho: float, source: str) -> None:
    """The geometric series: ρ / (1 − ρ) of direct light, and with that of the glow itself 1 / (1 − ρ)."""
    rng = np.random.default_rng(0)
    index, albedo = torch.from_numpy(rng.integers(0, 256, (256, 36))), torch.full((256, 36, 3), rho)
    light = torch.tensor([3.0, 1.0, 0.01]).repeat(256, 1)
    dark = torch.zeros_like(light)
    irradiance, glow, reference = (light, dark, rho / (1 - rho)) if source == "irradiance" else (dark, light, 1 / (1 - rho))
    found = (neumann_series(irradiance, glow, index, albedo, ALL) / light).numpy()
    print(f"SERIES {source} {rho}: {found.min() / reference - 1:+.1e} to {found.max() / reference - 1:+.1e}")
    np.testing.assert_allclose(found, reference, rtol=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_energy_is_bounded_in_any_scene(seed: int) -> None:
    """No surfel gets more than ρ / (1 − ρ) times the brightest direct light, ρ the largest mean albedo of a surfel."""
    rng = np.random.default_rng(seed)
    index = torch.from_numpy(rng.integers(0, 200, (200, 36)))
    albedo = torch.from_numpy(rng.random((200, 36, 3)) ** rng.choice([0.3, 1, 3]) * (rng.random((200, 36, 1)) < 0.8))
    light = torch.from_numpy(rng.random((200, 3)) ** 20)
    rho = albedo.mean(dim=1).amax(dim=0)
    found = neumann_series(light, torch.zeros_like(light), index, albedo, ALL)
    assert (found <= rho / (1 - rho) * light.amax(dim=0) * (1 + 1e-5)).all()
    once = bounce(light, index, albedo)
    assert (once.amax(dim=0) <= rho * light.amax(dim=0)).all()
    assert (found >= once).all()


def test_white_walls_stay_finite() -> None:
    """A closed white room would keep light for ever; the series stops at a ratio that bounds it."""
    index = torch.from_numpy(np.random.default_rng(0).integers(0, 64, (64, 4)))
    light = torch.ones(64, 3)
    found = neumann_series(light, torch.zeros_like(light), index, torch.ones(64, 4, 3), ALL)
    assert (found <= 1 + BOUNCES + 20).all()


def lit_patch(rho: float) -> tuple[np.ndarray, np.ndarray, list[Any]]:
    """An uneven scene with one lit patch: its transport [S, S], its light [S, 1], and what the network is given."""
    rng = np.random.default_rng(0)
    count, rays = 200, 64
    near = (np.arange(count)[:, None] + np.rint(rng.normal(0, 25, (count, rays))).astype(int)) % count
    albedo = rho * (0.6 + 0.4 * rng.random((count, rays, 1)))
    transport = np.zeros((count, count))
    np.add.at(transport, (np.repeat(np.arange(count), rays), near.ravel()), albedo.ravel() / rays)
    light = np.zeros((count, 1))
    light[:20] = 1
    return transport, light, [torch.from_numpy(a) for a in (light, np.zeros_like(light), near, albedo)]


@pytest.mark.parametrize("rho", [0.2, 0.5, 0.8, 0.9])
def test_the_tail_is_close_to_the_whole_series(rho: float) -> None:
    """Against the linear system that radiosity solves (Goral et al. 1984)."""
    transport, light, tensors = lit_patch(rho)
    reference = np.linalg.solve(np.eye(len(light)) - transport, transport @ light)
    found = neumann_series(*tensors, ALL).numpy()
    print(f"TAIL {rho}: mean {found.mean() / reference.mean() - 1:+.2%}, "
          f"largest {np.abs(found - reference).max() / reference.max():.2%}")
    assert found.mean() == pytest.approx(reference.mean(), rel=0.005)


def test_so_many_bounces_are_so_many_powers_of_transport() -> None:
    """Exactly as far as bounces are followed one by one, then within what the tail is off; ever more light."""
    transport, light, tensors = lit_patch(0.9)
    reference, found = np.zeros_like(light), np.zeros_like(light)
    for count in range(12):
        before, found = found, neumann_series(*tensors, torch.tensor(float(count))).numpy()
        rtol = 1e-12 if count <= BOUNCES + 1 else 0.005
        assert found.mean() == pytest.approx(reference.mean(), rel=rtol)
        if count <= BOUNCES + 1:
            np.testing.assert_allclose(found, reference, rtol=1e-12)
        assert (found >= before).all()
        reference = transport @ (light + reference)


@pytest.mark.parametrize("source", ["irradiance", "glow"])
def test_the_network_counts_bounces(network: tuple[Run, int, int], source: str) -> None:
    """Even light in an even enclosure: ρ + … + ρᴺ of direct light, 1 + … + ρᴺ⁻¹ of what glows."""
    run, *size = network
    rho = 0.9
    inputs = sphere_of_surfels(*size, albedo=rho)
    light = np.zeros_like(inputs["surfels"][0, LIGHT])
    light[slice(0, 3) if source == "irradiance" else slice(3, 6)] = 1
    inputs = with_light(inputs, light)
    for count in range(1, 12):
        found = run(inputs | {"bounces": np.array([[count]], F32)})
        np.testing.assert_allclose(found, sum(rho ** (k + (source == "irradiance")) for k in range(count)), rtol=1e-4)


def test_carried_light_is_a_mean_of_the_surfels_around() -> None:
    """Weights as the kernel is documented, in float64 and without its rearrangement as a product."""
    rng = np.random.default_rng(0)
    position, normal = 4 * rng.random((300, 3)), rng.normal(size=(300, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    radius, weight, light = 0.5 + rng.random((300, 1)), rng.uniform(0.2, 1, (300, 1)), rng.random((300, 3))
    at, n = position[:40] + 0.1 * rng.normal(size=(40, 3)), normal[:40]
    to = (position - at[:, None]) / radius
    exponent = (-3 * (to**2).sum(-1) - 8 * (1 - n @ normal.T) - 24 * (to * n[:, None]).sum(-1) ** 2)
    kernel = np.exp(exponent) * weight[:, 0]
    reference = kernel @ light / kernel.sum(axis=1, keepdims=True)
    found = carry(*(torch.from_numpy(a.astype(F32)) for a in (light, at, n, position, normal, radius, weight)))
    np.testing.assert_allclose(found.numpy(), reference, rtol=0.01)


def test_an_unused_surfel_tells_nothing() -> None:
    """Not even where the only other one is six radii away."""
    position, normal = np.array([[0, 0, 0], [6.0, 0, 0]]), np.array([[0, 0, 1.0]] * 2)
    light, weight, radius = np.array([[0.0], [1.0]]), np.array([[0.0], [1.0]]), np.ones((2, 1))
    found = carry(*(torch.from_numpy(a.astype(F32)) for a in
                    (light, position[:1], normal[:1], position, normal, radius, weight)))
    assert found.item() == pytest.approx(1, rel=1e-3)


def test_a_wall_between_two_rooms_keeps_their_light_apart() -> None:
    """Surfels a fifth of their radius behind the point, facing the other way, are bright; those around it are dark."""
    grid = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), -1).reshape(-1, 2)
    near = np.concatenate([grid, np.zeros((81, 1))], 1)
    position, normal = np.concatenate([near, near - (0, 0, 0.2)]), np.repeat([[0, 0, 1.0], [0, 0, -1.0]], 81, axis=0)
    light = np.repeat([[0.0], [1.0]], 81, axis=0)
    at, n = np.array([[4.3, 4.6, 0.0]]), np.array([[0, 0, 1.0]])
    one = np.ones((162, 1))
    found = carry(*(torch.from_numpy(a.astype(F32)) for a in (light, at, n, position, normal, one, one)))
    assert found.item() < 1e-4
