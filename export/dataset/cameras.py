"""Random cameras, and the choice of those that show something."""

import math
from collections.abc import Iterable

import numpy as np

from app.arrays import F64
from app.math3d import LUMINANCE, View
from app.scene import Camera
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.reference.path_tracer import PathTracer, Samples

PROBE_SIZE = (32, 24)     # texels of the path-traced image that a camera is chosen by
PROBE_SPP = 4
BRIGHTNESS_PROBES = 8     # cameras whose mean luminance is the scene's brightness
# Lengths are relative to the scene's longest edge.
MIN_SURFACE_SHARE = 0.4   # of the probe's rays that hit a surface
MIN_DEPTH = 0.01
MAX_NEAR_SHARE = 0.1      # of the surfaces closer than MIN_DEPTH
MIN_MEAN_DEPTH = 0.04
MIN_DEPTH_SPREAD = 0.15   # standard deviation of the depth, relative to its mean; excludes bare walls
MIN_NORMAL_SPREAD = 0.1   # 1 − |mean normal|; excludes flat walls at an angle
MAX_TURN_DEG = 3.0        # between two frames
MAX_STEP = 0.06           # metres between two frames


def random_camera(generated: GeneratedScene, rng: Rng) -> Camera:
    """A camera in free space with any heading, most often pitched slightly down."""
    eye = generated.random_eye(rng)
    yaw, pitch = rng.uniform(0, 2 * math.pi), math.radians(rng.normal(-7.0, 12.0))
    forward = np.array([math.sin(yaw) * math.cos(pitch), math.sin(pitch), -math.cos(yaw) * math.cos(pitch)])
    return _camera(eye, forward, float(rng.uniform(40, 75)))


def random_previous_camera(camera: Camera, rng: Rng) -> Camera:
    """The camera a frame earlier: a small step and turn away."""
    forward = np.subtract(camera.target, camera.eye)
    yaw, pitch = np.radians(rng.uniform(-MAX_TURN_DEG, MAX_TURN_DEG, 2) * (1.0, 0.4))
    c, s = math.cos(yaw), math.sin(yaw)
    rotated = np.array([c * forward[0] + s * forward[2], forward[1] + pitch, c * forward[2] - s * forward[0]])
    return _camera(np.asarray(camera.eye) + rng.uniform(-MAX_STEP, MAX_STEP, 3) * (1, 0.3, 1), rotated,
                   camera.fov_y_deg)


def choose_cameras(tracer: PathTracer, longest_edge: float, candidates: Iterable[Camera], count: int,
                   min_lit_share: float, min_mean_luminance_share: float) -> list[int]:
    """Indices of the first ``count`` candidates, or fewer, whose image is not empty, blocked, bare or dark.

    See ``export.dataset.config.Config`` for the last two parameters.
    """
    probes: list[Samples] = []
    chosen: list[int] = []
    for camera in candidates:
        probes.append(trace_probe(tracer, camera, longest_edge))
        if len(probes) < BRIGHTNESS_PROBES:
            continue
        brightness = float(np.mean([mean_luminance(p) for p in probes[:BRIGHTNESS_PROBES]]))
        chosen = [k for k, p in enumerate(probes)
                  if is_suitable(p, longest_edge, min_lit_share, min_mean_luminance_share * brightness)]
        if len(chosen) >= count:
            break
    return chosen[:count]


def is_suitable(probe: Samples, longest_edge: float, min_lit_share: float, min_mean_luminance: float) -> bool:
    """Whether a probe's depth and light are those of an image worth learning from; see the constants above.

    Parameters
    ----------
    min_lit_share : float
        Of the surfaces that a path connects to a light.
    min_mean_luminance : float
        In W/(sr m²).
    """
    hit = probe.depth > 0
    if hit.mean() < MIN_SURFACE_SHARE:
        return False
    depth = probe.depth[hit] / longest_edge
    if (depth < MIN_DEPTH).mean() > MAX_NEAR_SHARE or depth.mean() < MIN_MEAN_DEPTH:
        return False
    if depth.std() < MIN_DEPTH_SPREAD * depth.mean() or normal_spread(probe) < MIN_NORMAL_SPREAD:
        return False
    light = (probe.direct + probe.multi).reshape(PROBE_SPP, -1, 3).sum(axis=(0, 2))
    lit_share = (light[hit.reshape(PROBE_SPP, -1)[0]] > 0).mean()
    return bool(lit_share >= min_lit_share) and mean_luminance(probe) >= min_mean_luminance


def normal_spread(probe: Samples) -> float:
    """1 − |mean normal| of the surfaces: 0 for a flat wall, 1 for evenly distributed normals."""
    return 1 - float(np.linalg.norm(probe.normal[probe.depth > 0].mean(axis=0)))


def mean_luminance(probe: Samples) -> float:
    """Mean luminance of the surfaces in W/(sr m²); 0 without any."""
    hit = probe.depth > 0
    radiance = probe.albedo * (probe.direct + probe.multi)
    return float((radiance[hit] @ LUMINANCE).mean()) if hit.any() else 0.0


def trace_probe(tracer: PathTracer, camera: Camera, longest_edge: float) -> Samples:
    """A few paths through each texel of a small image, always with the same seed."""
    w, h = PROBE_SIZE
    y, x = np.divmod(np.arange(w * h), w)
    pixels = np.tile(np.stack([(x + 0.5) / w, (y + 0.5) / h], axis=1), (PROBE_SPP, 1))
    return tracer.trace(View.of(camera, PROBE_SIZE, 1e-4 * longest_edge), pixels, seed=0)


def _camera(eye: F64, forward: F64, fov_y_deg: float) -> Camera:
    (x, y, z), (a, b, c) = eye.tolist(), (eye + forward).tolist()
    return Camera((x, y, z), (a, b, c), fov_y_deg=fov_y_deg)
