"""The networks gather and radiosity against closed forms, on ray-cast views of a few rectangles."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from app.network.selection import find_model
from app.network.session import Network
from tests.rooms import Lamp, Quad, View, box, screen_points, solid_angles, tensors

SIDE = 20.0
INSIDE = [((20.0, 15.0, 35.0), (20.0, 15.0, 0.0)), ((5.0, 15.0, 35.0), (40.0, 5.0, 0.0)),
          ((20.0, 15.0, 20.0), (0.0, 9.0, 3.0))]


@functools.cache
def open_network(name: str, size: tuple[int, int]) -> Network:
    return Network(find_model(name), size, provider="cpu")


def indirect(name: str, quads: list[Quad], view: View, lamp: Lamp | None = None) -> np.ndarray:
    network = open_network(name, view.size)
    return network.run(tensors(network.contract, quads, view, lamp))["indirect.rgb"][0]


def corner_form_factor(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Form factor from a surface element to the parallel rectangle (0, 0)-(x, y) at distance 1 (Howell's catalogue)."""
    a, b = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
    return (x / a * np.arctan(y / a) + y / b * np.arctan(x / b)) / (2 * np.pi)


def square_form_factor(points: np.ndarray, corner: tuple[float, float], height: float,
                       side: float = SIDE) -> np.ndarray:
    x, y = ((corner[i] - points[..., i]) / height for i in (0, 1))
    s = side / height
    return (corner_form_factor(x + s, y + s) - corner_form_factor(x, y + s) - corner_form_factor(x + s, y)
            + corner_form_factor(x, y))


def squares(corner: tuple[float, float] = (0.0, 0.0)) -> list[Quad]:
    """A black square at z = 0 and an emissive one at z = SIDE."""
    u, v = (SIDE, 0, 0), (0, SIDE, 0)
    return [Quad((0, 0, 0), u, v, 0.0), Quad((*corner, SIDE), u, v, 1.0)]


@pytest.mark.parametrize(("eye", "target", "fov", "corner"), [
    pytest.param((10, 10, 10), (10, 10, 0), 90, (0, 0), id="facing"),
    pytest.param((10, 10, 15), (10, 10, 0), 90, (0, 0), id="close to the sender"),
    pytest.param((5, 7, 10), (10, 10, 0), 90, (0, 0), id="off centre"),
    pytest.param((0, 0, 10), (10, 10, 0), 60, (0, 0), id="across a cube corner"),
    pytest.param((0, 0, 10), (10, 10, 0), 60, (-10, -10), id="around a cube corner"),
    pytest.param((-8, -8, 10), (10, 10, 2), 60, (0, 0), id="from outside"),
])
def test_gather_agrees_with_parallel_squares(eye: tuple[float, float, float], target: tuple[float, float, float],
                                             fov: float, corner: tuple[float, float]) -> None:
    view = View(eye, target, fov_y_deg=fov)
    quads = squares(corner)
    light = indirect("gather", quads, view)
    points, _, number = screen_points(quads, view)
    on = number == 0
    reference = square_form_factor(points, corner, SIDE)[on]
    assert light[on].mean() == pytest.approx(reference.mean(), rel=0.05)
    assert np.percentile(np.abs(light[on] / reference - 1), 90) < 0.05


def test_the_closed_form_agrees_with_the_literature() -> None:
    at = (np.arange(40) + 0.5) / 40
    points = np.stack(np.meshgrid(at, at), -1)
    assert square_form_factor(points, (0, 0), 1.0, 1.0).mean() == pytest.approx(0.1998, abs=2e-4)


@pytest.mark.parametrize(("eye", "target"), INSIDE)
def test_an_emissive_closed_box_is_uniform(eye: tuple[float, float, float], target: tuple[float, float, float]) -> None:
    """Every surface emits 1 and reflects ρ, so the radiance is 1 / (1 − ρ) everywhere."""
    view = View(eye, target)
    for rho in (0.2, 0.5, 0.8):
        quads = box((40, 30, 40), radiance=1.0, albedo=rho)
        for name, exact in (("gather", 1.0), ("radiosity", 1 / (1 - rho))):
            light = indirect(name, quads, view)
            assert light.max() <= exact * (1 + 1e-5)
            assert light.mean() == pytest.approx(exact, rel=0.10)
            assert np.median(light) == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize("rho", [0.3, 0.5, 0.8])
@pytest.mark.parametrize(("lamp", "eye"), [((20, 20, 20), (20, 20, 20)), ((20, 30, 20), (12, 14, 28))])
def test_a_lamp_in_a_closed_box_keeps_its_energy(rho: float, lamp: tuple[float, float, float],
                                                 eye: tuple[float, float, float]) -> None:
    """All flux Φ reaches the walls, so the mean indirect irradiance is Φ / A times ρ, or ρ / (1 − ρ)."""
    quads = box((40, 40, 40), albedo=rho)
    light = Lamp(lamp, 100.0)
    mean = 4 * np.pi * light.intensity / (6 * 40 ** 2) / np.pi
    for name, exact in (("gather", mean * rho), ("radiosity", mean * rho / (1 - rho))):
        total = area = 0.0
        for forward in np.concatenate([np.eye(3), -np.eye(3)]):
            view = View(eye, tuple(np.asarray(eye) + forward), (32, 32), 90.0)
            points, normals, _ = screen_points(quads, view)
            to = points - np.asarray(eye)
            r2 = (to * to).sum(-1)
            areas = r2 ** 1.5 * solid_angles(view) / -(to * normals).sum(-1)
            total += (indirect(name, quads, view, light) * areas).sum()
            area += areas.sum()
        assert total / area == pytest.approx(exact, rel=0.10)
        assert total / area <= exact * 1.01  # a margin for quadrature


def test_an_open_box_seen_from_outside_is_lit_through_the_screen() -> None:
    """Almost no ray of the cube meets a distant box, so its light must come from the screen."""
    quads = [q for q in box((40, 40, 40), radiance=1.0) if not (q.corner[2] == 40 and q.u[2] == q.v[2] == 0)]
    view = View((20, 20, 110), (20, 20, 0), fov_y_deg=32)
    light = indirect("gather", quads, view)
    points, _, number = screen_points(quads, view)
    back = (number >= 0) & (points[..., 2] < 1e-6)
    # The back wall sees everything except the opening, a parallel square.
    reference = 1 - square_form_factor(points, (0, 0), 40.0, 40.0)[back]
    assert light[back].mean() == pytest.approx(reference.mean(), rel=0.15)


def test_the_sky_stays_black() -> None:
    view = View((10, 10, 60), (10, 10, 0))
    quads = squares()
    _, _, number = screen_points(quads, view)
    assert (number < 0).any()
    assert not indirect("radiosity", quads, view)[number < 0].any()
    empty = [Quad((0, 0, 500), (1, 0, 0), (0, 1, 0), 1.0)]
    assert not indirect("radiosity", empty, View((0, 0, 0), (0, 0, -1))).any()


def test_light_falls_off_with_distance_from_the_emissive_wall() -> None:
    room = box((40, 30, 40), albedo=0.5)
    emissive = [Quad(q.corner, q.u, q.v, 1.0 if i == 0 else 0.0, q.albedo) for i, q in enumerate(room)]
    view = View((20, 15, 38), (20, 10, 0))
    light = indirect("gather", emissive, view)
    points, normals, _ = screen_points(emissive, view)
    floor = (normals[..., 1] > 0.9)
    near, far = floor & (points[..., 0] < 10), floor & (points[..., 0] > 30)
    assert light[near].mean() > 3 * light[far].mean() > 0


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (5, 3), (16, 12), (120, 68)])
def test_every_size_gives_the_same_light(size: tuple[int, int]) -> None:
    quads = box((40, 30, 40), radiance=1.0, albedo=0.5)
    light = indirect("radiosity", quads, View((20, 15, 30), (20, 15, 0), size))
    assert light.shape == size[::-1]
    assert np.isfinite(light).all() and light.max() <= 2 * (1 + 1e-5)
    assert np.median(light) == pytest.approx(2.0, rel=0.12)


def test_the_disk_kernel_is_exact_above_the_horizon() -> None:
    torch = pytest.importorskip("torch", reason="networks are torch modules")
    from export.models.disks import Disks, form_factors

    rng = np.random.default_rng(0)
    ring, turn = np.meshgrid(np.sqrt((np.arange(400) + 0.5) / 400), 2 * np.pi * (np.arange(400) + 0.5) / 400)
    checked = 0
    for _ in range(200):
        radius, middle, m, n = rng.uniform(0.3, 3), rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
        m, n = m / np.linalg.norm(m), n / np.linalg.norm(n)
        point = middle + 4 * rng.normal(size=3)
        lean = radius * np.sqrt(1 - (m @ n) ** 2)  # extent of the disk along the point's normal
        if (middle - point) @ n < lean or (point - middle) @ m < 0:
            continue
        t = np.cross(m, (1, 0, 0)) / np.linalg.norm(np.cross(m, (1, 0, 0)))
        disk = radius * (np.multiply.outer(ring * np.cos(turn), t)
                         + np.multiply.outer(ring * np.sin(turn), np.cross(m, t)))
        to = middle + disk - point
        here, there = to @ n, -(to @ m)
        exact = (here * there / (to * to).sum(-1) ** 2).mean() * radius ** 2
        q, axis, p, normal = (torch.tensor(v[None]) for v in (middle, m, point, n))
        one = torch.ones((1, 1), dtype=torch.float64)
        approximation = form_factors(p, normal, Disks(q, axis, q, q, one * np.pi * radius ** 2, one)).item()
        assert approximation == pytest.approx(exact, rel=1e-4)
        checked += 1
    assert checked > 10


def test_exporting_again_gives_the_same_bytes(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="export needs torch")
    from export.models import UNTRAINED
    from export.onnx.export import export_network, write_network

    for name in ("gather", "radiosity"):
        first = export_network(name, tmp_path / "a")
        second, _ = write_network(UNTRAINED[name]().eval(), tmp_path / "b", [], {})  # the comparison above is enough
        assert first.read_bytes() == second.read_bytes()


def test_stamping_puts_a_contract_into_a_bare_network(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="export needs torch")
    from export.onnx.export import stamp
    from tests.tiny_network import TINY, write_tiny_network

    path = write_tiny_network(tmp_path / "bare.onnx", contract=None)
    stamp(path, TINY)
    assert Network(path, (4, 4)).contract == TINY
