"""Scenes of a few rectangles, ray-cast in numpy into the channels that a network reads. No GL, no torch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.network.channels import ALL_BOUNCES, GLOBALS, SCREEN
from app.network.contract import ModelContract

F64 = NDArray[np.float64]
Arrays = dict[str, NDArray[np.float32]]

# forward and image-up of the faces front, back, left, right, up, down
FACES = (((0, 0, -1), (0, 1, 0)), ((0, 0, 1), (0, 1, 0)), ((-1, 0, 0), (0, 1, 0)),
         ((1, 0, 0), (0, 1, 0)), ((0, 1, 0), (0, 0, 1)), ((0, -1, 0), (0, 0, -1)))


@dataclass(frozen=True)
class Quad:
    """The rectangle ``corner`` + s ``u`` + t ``v``, s and t in [0, 1], of one grey on both sides."""

    corner: tuple[float, float, float]
    u: tuple[float, float, float]
    v: tuple[float, float, float]
    radiance: float = 0.0
    albedo: float = 0.5


@dataclass(frozen=True)
class View:
    """A camera; ``size`` is the network's screen grid, width and height."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    size: tuple[int, int] = (64, 48)
    fov_y_deg: float = 60.0

    def axes(self) -> F64:
        """Rows: right, up, back in world space."""
        forward = _unit(np.subtract(self.target, self.eye))
        right = _unit(np.cross(forward, (0, 1, 0) if abs(forward[1]) < 0.99 else (0, 0, 1)))
        return np.stack([right, np.cross(right, forward), -forward])


@dataclass(frozen=True)
class Lamp:
    """A point light, W/sr; it casts no shadows."""

    position: tuple[float, float, float]
    intensity: float


def box(size: tuple[float, float, float], radiance: float = 0.0, albedo: float = 0.5,
        low: tuple[float, float, float] = (0, 0, 0)) -> list[Quad]:
    """Six rectangles; a room from the inside, a block from the outside."""
    edges = np.diag(size)
    quads = []
    for axis in range(3):
        u, v = edges[(axis + 1) % 3], edges[(axis + 2) % 3]
        quads += [Quad(tuple(corner), tuple(u), tuple(v), radiance, albedo)
                  for corner in (np.asarray(low), np.asarray(low) + edges[axis])]
    return quads


def tensors(contract: ModelContract, quads: list[Quad], view: View, lamp: Lamp | None = None) -> Arrays:
    """The network's inputs, [C, h, w], [C, 6, n, n] and [C]."""
    grids = {}
    for name, spec in contract.inputs.items():
        if spec.grid == SCREEN:
            channels = _shade(quads, view, *_screen_rays(view), lamp)
        elif spec.grid == GLOBALS:
            channels = {"bounces": np.array([ALL_BOUNCES])}
        else:
            assert contract.cube_axes == "world" and spec.size
            channels = _cube(quads, view, spec.size, lamp)
        grids[name] = np.concatenate([channels[c] for c in spec.channels]).astype(np.float32)
    return grids


def screen_points(quads: list[Quad], view: View) -> tuple[F64, F64, NDArray[np.int64]]:
    """World-space points and normals [h, w, 3] and quad numbers [h, w] (-1: sky) that the screen shows."""
    rays = _screen_rays(view)[0]
    distance, number, normals = _cast(quads, view, rays)
    return np.asarray(view.eye) + distance[..., None] * rays, normals, number


def solid_angles(view: View) -> F64:
    """Of the screen's texels [h, w]."""
    return _screen_rays(view)[1]


def _cube(quads: list[Quad], view: View, n: int, lamp: Lamp | None) -> dict[str, F64]:
    at = (2 * (np.arange(n) + 0.5) / n) - 1
    rays = np.stack([np.asarray(f, float) + at[None, :, None] * np.cross(f, up) - at[:, None, None] * np.asarray(up)
                     for f, up in FACES])
    length = np.linalg.norm(rays, axis=-1)
    channels = _shade(quads, view, rays / length[..., None], (2 / n) ** 2 / length ** 3, lamp)
    x, y, z = np.moveaxis(rays @ view.axes().T, -1, 0)
    t = np.tan(np.radians(view.fov_y_deg) / 2)
    inside = (z < 0) & (np.abs(x) <= -z * t * view.size[0] / view.size[1]) & (np.abs(y) <= -z * t)
    return channels | {"on_screen": inside[None].astype(float)}


def _screen_rays(view: View) -> tuple[F64, F64]:
    w, h = view.size
    t = np.tan(np.radians(view.fov_y_deg) / 2)
    x = ((2 * (np.arange(w) + 0.5) / w) - 1) * t * w / h
    y = (1 - (2 * (np.arange(h) + 0.5) / h)) * t
    rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), -1)
    length = np.linalg.norm(rays, axis=-1)
    return (rays / length[..., None]) @ view.axes(), (2 * t / h) ** 2 / length ** 3


def _shade(quads: list[Quad], view: View, rays: F64, solid_angle: F64, lamp: Lamp | None) -> dict[str, F64]:
    distance, number, normals = _cast(quads, view, rays)
    hit = number >= 0

    def of_quad(key: str) -> F64:
        return np.repeat(np.where(hit, np.array([getattr(q, key) for q in quads])[number], 0.0)[None], 3, axis=0)

    positions = np.where(hit[..., None], distance[..., None] * rays, 0.0) @ view.axes().T
    albedo, radiance = of_quad("albedo"), of_quad("radiance")
    if lamp is not None:
        to = np.asarray(lamp.position) - np.asarray(view.eye) - distance[..., None] * rays
        d2 = np.maximum((to * to).sum(-1), 1e-12)
        radiance = radiance + albedo / np.pi * lamp.intensity * np.maximum((to * normals).sum(-1), 0) / d2 ** 1.5
    return {"position.view.xyz": np.moveaxis(positions, -1, 0),
            "normal.view.xyz": np.moveaxis(normals @ view.axes().T, -1, 0),
            "normal.world.xyz": np.moveaxis(normals, -1, 0),
            "albedo.rgb": albedo, "radiance.rgb": radiance, "direct.rgb": radiance,
            "solid_angle": np.where(hit, solid_angle, 0.0)[None]}


def _cast(quads: list[Quad], view: View, rays: F64) -> tuple[F64, NDArray[np.int64], F64]:
    """Distance, number and normal (towards the eye) of the nearest quad; 0, -1 and zero for the sky."""
    best = np.full(rays.shape[:-1], np.inf)
    number = np.full(best.shape, -1)
    normals = np.zeros(rays.shape)
    for i, quad in enumerate(quads):
        u, v = np.asarray(quad.u, float), np.asarray(quad.v, float)
        n = _unit(np.cross(u, v))
        to = np.asarray(quad.corner, float) - np.asarray(view.eye)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (to @ n) / (rays @ n)
            point = distance[..., None] * rays - to
            s, t = point @ u / (u @ u), point @ v / (v @ v)
            hit = (distance > 1e-9) & (distance < best) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
        best, number = np.where(hit, distance, best), np.where(hit, i, number)
        normals = np.where(hit[..., None], -n * np.sign(rays @ n)[..., None], normals)
    return np.where(number >= 0, best, 0.0), number, normals


def _unit(v: F64) -> F64:
    return v / np.linalg.norm(v)
