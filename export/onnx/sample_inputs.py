"""Inputs for checks of networks: rendered from scenes, synthetic, random and broken."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from app.arrays import F32, F64
from app.golden.scenes import dusk, outdoor, room
from app.load import embedded_scene
from app.network.channels import CHANNELS, PANORAMA, SCREEN, SEEN, UNSHADOWED_CHANNELS
from app.network.contract import ModelContract, TensorSpec
from app.scene import Scene
from export.dataset.network_inputs import InputRenderer
from export.models.panorama import merge_cube
from export.reference.still import Still

Arrays = dict[str, F32]  # by tensor, with a batch of one
Channels = dict[str, F64]

RADIUS = 20.0  # of the synthetic room, a sphere
ODD_SIZE = (5, 7)
SIZES = ((1, 1), ODD_SIZE, (48, 64))
BROKEN_VALUES = (0.0, np.nan, np.inf, -np.inf, -100.0, 1e6)
RENDERED_SIZE = (256, 192)


def default_scenes() -> dict[str, Scene]:
    """The Cornell box and two generated scenes of the golden images, by name."""
    return {"cornell-box": embedded_scene(), "room": room(), "outdoor": outdoor()}


def rendered_inputs(contract: ModelContract, scenes: Mapping[str, Scene] | None = None,
                    size: tuple[int, int] = RENDERED_SIZE) -> Iterator[tuple[str, Arrays]]:
    """Labelled inputs from the renderer; an environment is added if the network shades one and the scene has none."""
    sky = dusk().environment if contract.shades_environment else None
    with InputRenderer(replace(contract, dtype="float32")) as renderer:
        for name, scene in (scenes or default_scenes()).items():
            lit = replace(scene, environment=scene.environment or sky)
            still = Still(lit, scene.cameras[scene.default_camera].at(0.0), size)
            yield name, {t: x[None] for t, x in renderer.render_frame(still).tensors.items()}


def sample_inputs(contract: ModelContract) -> Iterator[tuple[str, Arrays]]:
    """Labelled inputs of several sizes: a synthetic room, random values, and partly or entirely broken values."""
    rng = np.random.default_rng(1)
    for size in SIZES:
        yield "room", _make_tensors(contract, size, rng, _sphere_channels)
        yield "random", _random_inputs(contract, size, rng)
    for value in BROKEN_VALUES:
        random = _random_inputs(contract, ODD_SIZE, rng)
        yield f"{value}", {t: np.full_like(x, value) for t, x in random.items()}
        yield f"some {value}", {t: np.where(rng.random(x.shape) < 0.1, np.float32(value), x)
                                for t, x in random.items()}


def example_inputs(contract: ModelContract) -> Arrays:
    """Random inputs of the largest size, for tracing."""
    return _random_inputs(contract, SIZES[-1], np.random.default_rng(0))


def change_light(contract: ModelContract, inputs: Arrays, change: Callable[[F32], F32]) -> Arrays:
    """A copy of ``inputs`` with ``change`` applied to all radiance."""
    changed = {t: x.copy() for t, x in inputs.items()}
    for t, spec in contract.inputs.items():
        for name, rows in spec.rows():
            if CHANNELS[name].radiance:
                changed[t][:, rows] = change(changed[t][:, rows])
    return changed


def _random_inputs(contract: ModelContract, size: tuple[int, int], rng: np.random.Generator) -> Arrays:
    return _make_tensors(contract, size, rng, lambda spec, grid, rng: {})


def _make_tensors(contract: ModelContract, size: tuple[int, int], rng: np.random.Generator,
                  known: Callable[[TensorSpec, tuple[int, ...], np.random.Generator], Channels]) -> Arrays:
    """All inputs; channels that ``known`` does not return are uniform noise within their range."""
    tensors = {}
    rows, columns = (-(-n // contract.multiple_of) * contract.multiple_of for n in size)
    for tensor, spec in contract.inputs.items():
        grid = spec.extent((rows, columns))
        channels = known(spec, grid, rng)
        tensors[tensor] = np.concatenate([channels.get(name, _noise(name, grid, rng)) for name in spec.channels])
    return {tensor: x[None].astype(np.float32) for tensor, x in tensors.items()}


def _sphere_channels(spec: TensorSpec, grid: tuple[int, ...], rng: np.random.Generator) -> Channels:
    """The inside of a sphere, seen from 3 units off its centre: plausible input without a renderer."""
    if spec.grid not in SEEN:
        return _sphere_surfels(spec.size or 0, spec.rays or 0, rng)
    view = (spec.face, spec.face) if spec.face else (grid[-1], grid[-2])
    x, y = np.meshgrid(*((2 * np.arange(n) + 1) / n - 1 for n in view))
    front = np.stack([x, -y, -np.ones_like(x)])
    faces = [front[[0, 1, 2]], front * [[[-1]], [[1]], [[-1]]], front[[2, 1, 0]], front[[2, 1, 0]] * -1,
             front[[0, 2, 1]] * -1, front[[0, 2, 1]]]
    rays = front if spec.grid == SCREEN else np.stack(faces, axis=1)
    if spec.grid == PANORAMA:
        rays = merge_cube(rays)
    length = np.linalg.norm(rays, axis=0)
    rays = rays / length
    center = np.array([1.0, 2.0, 2.0]).reshape(3, *[1] * (rays.ndim - 1))
    along = (rays * center).sum(axis=0)
    points = rays * (along + np.sqrt(along ** 2 + RADIUS ** 2 - 9.0))
    normals = (center - points) / RADIUS
    depth = -points[2:] if spec.grid == SCREEN else np.linalg.norm(points, axis=0, keepdims=True)
    return {"position.view.xyz": points, "normal.view.xyz": normals, "normal.world.xyz": normals,
            "depth": depth, "solid_angle": (4 / (grid[-1] * grid[-2]) / length ** 3)[None],
            **dict.fromkeys(("radiance.rgb", "surface_and_sky_radiance.rgb", "direct.rgb", *UNSHADOWED_CHANNELS),
                            1 + normals)}


def _sphere_surfels(count: int, rays: int, rng: np.random.Generator) -> Channels:
    """Surfels all over the same sphere; a ray may hit any of them, as inside a sphere."""
    normals = rng.normal(size=(3, count))
    normals /= np.linalg.norm(normals, axis=0)
    return {"position.view.xyz": np.array([[1.0], [2.0], [2.0]]) - RADIUS * normals, "normal.view.xyz": normals,
            "irradiance.rgb": 1 + normals, "surfel.radius": np.full((1, count), 8 * RADIUS / max(count, 1) ** 0.5),
            "ray.surfel": rng.integers(-1, max(count, 1), (1, count, rays)).astype(float)}


def _noise(name: str, grid: tuple[int, ...], rng: np.random.Generator) -> F64:
    channel = CHANNELS[name]
    low, high = max(channel.range[0], -20.0), min(channel.range[1], 20.0)
    if name == "solid_angle":
        high = 4 * np.pi / float(np.prod(grid))
    noise = rng.uniform(low, high, (channel.components, *grid))
    return noise / np.linalg.norm(noise, axis=0) if name.startswith("normal") else noise
