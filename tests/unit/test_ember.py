"""The network ember: linear in light, colour by colour; bounded in energy; finite for any input."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import onnxruntime as ort
import pytest

from app.network.channels import ALL_BOUNCES, RAYS, SURFELS
from app.network.contract_json import read_contract
from app.network.selection import find_model

torch = pytest.importorskip("torch", reason="networks are torch modules")
from export.models.ember import BOUNCES, Ember, bounce, interpolate, neumann_series  # noqa: E402

F32 = np.float32
Arrays = dict[str, np.ndarray]
Run = Callable[[Arrays], np.ndarray]
IRRADIANCE, EMISSIVE, RADIUS, WEIGHT = slice(6, 9), slice(9, 12), 12, 13  # rows of the tensor ``surfels``
LIGHT = slice(6, 12)
SCREEN = (6, 9)
ALL = torch.tensor(ALL_BOUNCES)


@pytest.fixture(scope="module", params=["torch", "onnx"])
def network(request: pytest.FixtureRequest) -> tuple[Run, int, int]:
    """Runs raw tensors without the renderer's exposure; its numbers of surfels and of rays."""
    if request.param == "torch":
        module = Ember(surfels=256, rays=36).eval()

        def run_torch(inputs: Arrays) -> np.ndarray:
            with torch.no_grad():
                output: np.ndarray = module(**{n: torch.from_numpy(a) for n, a in inputs.items()})[0].numpy()
            return output

        return run_torch, 256, 36
    contract = read_contract(find_model("ember"))
    session = ort.InferenceSession(str(find_model("ember")), providers=["CPUExecutionProvider"])
    sizes = {spec.grid: spec for spec in contract.inputs.values()}

    def run_onnx(inputs: Arrays) -> np.ndarray:
        output: np.ndarray = session.run(None, inputs)[0]
        return output

    return run_onnx, sizes[SURFELS].size or 0, sizes[RAYS].rays or 0


def sphere_of_surfels(count: int, rays: int, albedo: float | None = 0.7) -> Arrays:
    """Surfels on a sphere of radius 10 around the camera with rays to random others; random albedo for None."""
    rng = np.random.default_rng(0)

    def directions(n: int) -> np.ndarray:
        v = rng.normal(size=(n, 3))
        return (v / np.linalg.norm(v, axis=1, keepdims=True)).T

    surfels = np.zeros((18, count))
    surfels[:3] = 10 * directions(count)
    surfels[3:6] = -surfels[:3] / 10
    surfels[IRRADIANCE], surfels[EMISSIVE] = rng.random((2, 3, count)) ** 4
    surfels[RADIUS], surfels[WEIGHT] = 20 * np.sqrt(8 / count), 1
    table = np.empty((4, count, rays))
    table[0] = rng.integers(0, count, (count, rays))
    table[1:] = rng.random((3, count, rays)) if albedo is None else albedo
    pixels = directions(SCREEN[0] * SCREEN[1])
    screen = np.concatenate([10 * pixels, -pixels]).reshape(6, *SCREEN)
    return {n: a[None].astype(F32) for n, a in (
        ("screen", screen), ("surfels", surfels), ("rays", table), ("bounces", np.array([ALL_BOUNCES])))}


def with_light(inputs: Arrays, light: Any) -> Arrays:
    surfels = inputs["surfels"].copy()
    surfels[0, LIGHT] = light
    return inputs | {"surfels": surfels}


def relative_error(output: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(output - reference).max() / np.abs(reference).max())


def test_light_is_additive(network: tuple[Run, int, int]) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size, albedo=None)
    first, second = np.random.default_rng(1).random((2, 6, size[0])).astype(F32) ** 8
    both = run(with_light(inputs, first + second))
    error = relative_error(run(with_light(inputs, first)) + run(with_light(inputs, second)), both)
    print(f"ADDITIVITY {error:.1e}")
    assert both.min() > 0
    assert error < 1e-5


@pytest.mark.parametrize("factor", [0.1, 0.3, 3.0, 10.0])
def test_light_scales(network: tuple[Run, int, int], factor: float) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size, albedo=None)
    light = inputs["surfels"][0, LIGHT]
    error = relative_error(run(with_light(inputs, light * F32(factor))), run(inputs) * factor)
    assert error < 1e-5


def test_colours_do_not_mix(network: tuple[Run, int, int]) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size)
    light = inputs["surfels"][0, LIGHT].copy()
    light[[1, 2, 4, 5]] = 0
    output = run(with_light(inputs, light))[0]
    assert output[0].min() > 0
    assert not output[1:].any()


def test_all_colours_are_treated_alike(network: tuple[Run, int, int]) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size, albedo=None)
    permuted = {n: a.copy() for n, a in inputs.items()}
    for rows in (slice(6, 9), slice(9, 12)):
        permuted["surfels"][0, rows] = np.roll(inputs["surfels"][0, rows], 1, axis=0)
    permuted["rays"][0, 1:] = np.roll(inputs["rays"][0, 1:], 1, axis=0)
    np.testing.assert_allclose(run(permuted)[0], np.roll(run(inputs)[0], 1, axis=0), rtol=1e-5)


def test_no_light_gives_exactly_zero(network: tuple[Run, int, int]) -> None:
    run, *size = network
    assert not run(with_light(sphere_of_surfels(*size), 0.0)).any()


def test_no_surfels_give_no_light(network: tuple[Run, int, int]) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size)
    empty = {"surfels": np.zeros_like(inputs["surfels"]), "rays": np.zeros_like(inputs["rays"])}
    empty["surfels"][0, RADIUS], empty["rays"][0, 0] = 0.3, -1
    assert not run(inputs | empty).any()


def test_unused_surfels_change_nothing(network: tuple[Run, int, int]) -> None:
    """With equal light and radius everywhere, half of the surfels give the same result as all."""
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
    output = run(inputs)[0]
    assert not output[:, 2, 3].any()
    assert np.count_nonzero(output[0]) == SCREEN[0] * SCREEN[1] - 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -3e38])
@pytest.mark.parametrize("tensor", ["screen", "surfels", "rays"])
def test_invalid_values_give_finite_light(network: tuple[Run, int, int], tensor: str, bad: float) -> None:
    run, *size = network
    inputs = sphere_of_surfels(*size)
    inputs[tensor][np.random.default_rng(2).random(inputs[tensor].shape) < 0.05] = bad
    output = run(inputs)
    assert np.isfinite(output).all()
    assert (output >= 0).all()


def test_all_invalid_inputs_give_finite_light(network: tuple[Run, int, int]) -> None:
    run, *size = network
    for bad in (np.nan, np.inf):
        assert np.isfinite(run({n: np.full_like(a, bad) for n, a in sphere_of_surfels(*size).items()})).all()


def test_one_invalid_albedo_stays_local(network: tuple[Run, int, int]) -> None:
    """Its surfel loses the light of its rays, which is a small part of what the others receive."""
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
@pytest.mark.parametrize("source", ["irradiance", "emissive"])
def test_all_bounces_in_a_uniform_enclosure(rho: float, source: str) -> None:
    """The geometric series: ρ / (1 − ρ) of direct light, and 1 / (1 − ρ) of light from emissive surfaces."""
    rng = np.random.default_rng(0)
    index, albedo = torch.from_numpy(rng.integers(0, 256, (256, 36))), torch.full((256, 36, 3), rho)
    light = torch.tensor([3.0, 1.0, 0.01]).repeat(256, 1)
    dark = torch.zeros_like(light)
    irradiance, emissive = (light, dark) if source == "irradiance" else (dark, light)
    reference = (rho if source == "irradiance" else 1) / (1 - rho)
    output = (neumann_series(irradiance, emissive, index, albedo, ALL) / light).numpy()
    print(f"SERIES {source} {rho}: {output.min() / reference - 1:+.1e} to {output.max() / reference - 1:+.1e}")
    np.testing.assert_allclose(output, reference, rtol=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_energy_is_bounded_in_any_scene(seed: int) -> None:
    """No surfel receives more than ρ / (1 − ρ) times the brightest direct light, ρ the largest mean albedo."""
    rng = np.random.default_rng(seed)
    index = torch.from_numpy(rng.integers(0, 200, (200, 36)))
    albedo = torch.from_numpy(rng.random((200, 36, 3)) ** rng.choice([0.3, 1, 3]) * (rng.random((200, 36, 1)) < 0.8))
    light = torch.from_numpy(rng.random((200, 3)) ** 20)
    rho = albedo.mean(dim=1).amax(dim=0)
    output = neumann_series(light, torch.zeros_like(light), index, albedo, ALL)
    assert (output <= rho / (1 - rho) * light.amax(dim=0) * (1 + 1e-5)).all()
    once = bounce(light, index, albedo)
    assert (once.amax(dim=0) <= rho * light.amax(dim=0)).all()
    assert (output >= once).all()


def test_white_walls_stay_finite() -> None:
    """The series would diverge in a closed white room; its ratio is limited."""
    index = torch.from_numpy(np.random.default_rng(0).integers(0, 64, (64, 4)))
    light = torch.ones(64, 3)
    output = neumann_series(light, torch.zeros_like(light), index, torch.ones(64, 4, 3), ALL)
    assert (output <= 1 + BOUNCES + 20).all()


def lit_patch(rho: float) -> tuple[np.ndarray, np.ndarray, list[Any]]:
    """An uneven scene with one lit patch: transport [S, S], light [S, 1] and the arguments of ``neumann_series``."""
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
def test_the_series_is_close_to_the_exact_solution(rho: float) -> None:
    """Against the linear system that radiosity solves (Goral et al. 1984)."""
    transport, light, tensors = lit_patch(rho)
    reference = np.linalg.solve(np.eye(len(light)) - transport, transport @ light)
    output = neumann_series(*tensors, ALL).numpy()
    print(f"TAIL {rho}: mean {output.mean() / reference.mean() - 1:+.2%}, "
          f"largest {np.abs(output - reference).max() / reference.max():.2%}")
    assert output.mean() == pytest.approx(reference.mean(), rel=0.005)


def test_n_bounces_are_n_powers_of_transport() -> None:
    """Exact for the bounces that are computed, then within the error of the tail; and monotonic."""
    transport, light, tensors = lit_patch(0.9)
    reference, output = np.zeros_like(light), np.zeros_like(light)
    for count in range(12):
        before, output = output, neumann_series(*tensors, torch.tensor(float(count))).numpy()
        rtol = 1e-12 if count <= BOUNCES + 1 else 0.005
        assert output.mean() == pytest.approx(reference.mean(), rel=rtol)
        if count <= BOUNCES + 1:
            np.testing.assert_allclose(output, reference, rtol=1e-12)
        assert (output >= before).all()
        reference = transport @ (light + reference)


@pytest.mark.parametrize("source", ["irradiance", "emissive"])
def test_the_network_counts_bounces(network: tuple[Run, int, int], source: str) -> None:
    """Uniform light in a uniform enclosure: ρ + … + ρᴺ of direct light, 1 + … + ρᴺ⁻¹ of emissive light."""
    run, *size = network
    rho = 0.9
    inputs = sphere_of_surfels(*size, albedo=rho)
    light = np.zeros_like(inputs["surfels"][0, LIGHT])
    light[slice(0, 3) if source == "irradiance" else slice(3, 6)] = 1
    inputs = with_light(inputs, light)
    for count in range(1, 12):
        output = run(inputs | {"bounces": np.array([[count]], F32)})
        np.testing.assert_allclose(output, sum(rho ** (k + (source == "irradiance")) for k in range(count)), rtol=1e-4)


def test_interpolated_light_is_a_weighted_mean_of_surfels() -> None:
    """The documented kernel, in float64 and without its rearrangement as a product."""
    rng = np.random.default_rng(0)
    position, normal = 4 * rng.random((300, 3)), rng.normal(size=(300, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    radius, weight, light = 0.5 + rng.random((300, 1)), rng.uniform(0.2, 1, (300, 1)), rng.random((300, 3))
    at, n = position[:40] + 0.1 * rng.normal(size=(40, 3)), normal[:40]
    to = (position - at[:, None]) / radius
    exponent = (-3 * (to**2).sum(-1) - 8 * (1 - n @ normal.T) - 24 * (to * n[:, None]).sum(-1) ** 2)
    kernel = np.exp(exponent) * weight[:, 0]
    reference = kernel @ light / kernel.sum(axis=1, keepdims=True)
    arrays = (light, at, n, position, normal, radius, weight, np.zeros((300, 4)))
    output = interpolate(*(torch.from_numpy(a.astype(F32)) for a in arrays))
    np.testing.assert_allclose(output.numpy(), reference, rtol=0.01)


def test_an_unused_surfel_has_no_weight() -> None:
    """Not even if the only other one is six radii away."""
    position, normal = np.array([[0, 0, 0], [6.0, 0, 0]]), np.array([[0, 0, 1.0]] * 2)
    light, weight, radius = np.array([[0.0], [1.0]]), np.array([[0.0], [1.0]]), np.ones((2, 1))
    output = interpolate(*(torch.from_numpy(a.astype(F32)) for a in
                    (light, position[:1], normal[:1], position, normal, radius, weight, np.zeros((2, 4)))))
    assert output.item() == pytest.approx(1, rel=1e-3)


def test_light_does_not_leak_through_a_wall() -> None:
    """Bright surfels a fifth of their radius behind the point, facing the other way, and black ones around it."""
    grid = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), -1).reshape(-1, 2)
    near = np.concatenate([grid, np.zeros((81, 1))], 1)
    position, normal = np.concatenate([near, near - (0, 0, 0.2)]), np.repeat([[0, 0, 1.0], [0, 0, -1.0]], 81, axis=0)
    light = np.repeat([[0.0], [1.0]], 81, axis=0)
    at, n = np.array([[4.3, 4.6, 0.0]]), np.array([[0, 0, 1.0]])
    one = np.ones((162, 1))
    output = interpolate(*(torch.from_numpy(a.astype(F32)) for a in (light, at, n, position, normal, one, one,
                                                             np.zeros((162, 4)))))
    assert output.item() < 1e-4


def test_a_surfel_lights_nothing_beyond_its_clip_plane() -> None:
    """Floor on both sides of the plane x = 0, behind which the other half is ten thousand times as bright."""
    x, z = np.meshgrid(np.arange(-4, 5) + 0.5, np.arange(9.0))
    position = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    bright = position[:, 0] > 0
    light, one = np.where(bright, 1e4, 1.0)[:, None], np.ones((x.size, 1))
    normal = np.tile([0.0, 1.0, 0.0], (x.size, 1))
    plane = np.where(bright[:, None], [-1.0, 0, 0, 0], [1.0, 0, 0, 0])
    at = np.array([[-3.0, 0, 4], [-0.2, 0, 4], [0.2, 0, 4], [3.0, 0, 4]])

    def interpolated(plane: np.ndarray) -> np.ndarray:
        arrays = (light, at, normal[:4], position, normal, 1.5 * one, one, plane)
        return interpolate(*(torch.from_numpy(a.astype(F32)) for a in arrays)).numpy()[:, 0]

    np.testing.assert_allclose(interpolated(plane), [1, 1, 1e4, 1e4], rtol=1e-3)
    assert interpolated(np.zeros_like(plane))[1] > 100  # it would leak otherwise
