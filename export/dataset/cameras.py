"""Random cameras, and which of them show something."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from app.evaluation.metrics import LUMINANCE
from app.math3d import View
from app.scene import Camera
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.reference.path_tracer import PathTracer, Samples

F64 = NDArray[np.float64]

PROBE = (32, 24)        # rays that judge a camera
PROBE_PATHS = 4         # through each
MIN_SEEN = 0.4        # share of the rays that meet a surface
NEAREST = 0.01          # depths, of the scene's longest edge ...
MAX_NEAR = 0.1         # ... that at most this share of the rays may be below
MEAN_DEPTH = 0.04       # least, of the scene's longest edge
DEPTH_SPREAD = 0.15     # least standard deviation of the depth, of its mean: no bare wall
FIRST = 8               # cameras of a scene that tell how bright it is
NORMAL_SPREAD = 0.1     # least 1 − |mean normal|: no flat wall seen askew either
TURN, STEP = 3.0, 0.06  # degrees and metres at most between two frames


def random_camera(place: GeneratedScene, rng: Rng) -> Camera:
    """An eye in free space that looks about level, mostly a little down, any way round."""
    eye = place.eye(rng)
    yaw, pitch = rng.uniform(0, 2 * math.pi), math.radians(rng.normal(-7.0, 12.0))
    forward = np.array([math.sin(yaw) * math.cos(pitch), math.sin(pitch), -math.cos(yaw) * math.cos(pitch)])
    return _camera(eye, forward, float(rng.uniform(40, 75)))


def a_frame_before(camera: Camera, rng: Rng) -> Camera:
    """The camera after a small step and turn back in time."""
    forward = np.subtract(camera.target, camera.eye)
    yaw, pitch = np.radians(rng.uniform(-TURN, TURN, 2) * (1.0, 0.4))
    c, s = math.cos(yaw), math.sin(yaw)
    turned = np.array([c * forward[0] + s * forward[2], forward[1] + pitch, c * forward[2] - s * forward[0]])
    return _camera(np.asarray(camera.eye) + rng.uniform(-STEP, STEP, 3) * (1, 0.3, 1), turned, camera.fov_y_deg)


def choose(tracer: PathTracer, longest_edge: float, candidates: Iterable[Camera], wanted: int,
           least_lit: float, darkest: float) -> list[int]:
    """Numbers of the first ``wanted`` cameras, or fewer, whose picture is neither empty, blocked, bare, nor dark.

    See ``export.dataset.config.Config`` for the last two.
    """
    probes: list[Samples] = []
    chosen: list[int] = []
    for camera in candidates:
        probes.append(probe(tracer, camera, longest_edge))
        if len(probes) < FIRST:
            continue
        brightness = float(np.mean([mean_luminance(p) for p in probes[:FIRST]]))
        chosen = [k for k, p in enumerate(probes) if shows_something(p, longest_edge, least_lit, darkest * brightness)]
        if len(chosen) >= wanted:
            break
    return chosen[:wanted]


def shows_something(samples: Samples, longest_edge: float, least_lit: float, least_luminance: float) -> bool:
    """Whether a probe's depth and light are those of a picture worth learning from; see the constants above.

    Parameters
    ----------
    least_lit : float
        Share of the surfaces that some path from the light has to reach.
    least_luminance : float
        Of the whole picture on average, in W/(sr m²).
    """
    seen = samples.depth > 0
    if seen.mean() < MIN_SEEN:
        return False
    depth = samples.depth[seen] / longest_edge
    if (depth < NEAREST).mean() > MAX_NEAR or depth.mean() < MEAN_DEPTH or depth.std() < DEPTH_SPREAD * depth.mean():
        return False
    if normal_spread(samples) < NORMAL_SPREAD:
        return False
    light = (samples.direct + samples.multi).reshape(PROBE_PATHS, -1, 3).sum(axis=(0, 2))
    lit = (light[seen.reshape(PROBE_PATHS, -1)[0]] > 0).mean()
    return bool(lit >= least_lit) and mean_luminance(samples) >= least_luminance


def normal_spread(samples: Samples) -> float:
    """1 − |mean normal| of the surfaces: 0 for a flat wall, 1 where all directions are seen alike."""
    return 1 - float(np.linalg.norm(samples.normal[samples.depth > 0].mean(axis=0)))


def mean_luminance(samples: Samples) -> float:
    """Of the final picture where it shows a surface, in W/(sr m²); 0 for none."""
    seen = samples.depth > 0
    radiance = samples.albedo * (samples.direct + samples.multi)
    return float((radiance[seen] @ LUMINANCE).mean()) if seen.any() else 0.0


def probe(tracer: PathTracer, camera: Camera, longest_edge: float) -> Samples:
    """A few paths through a coarse grid; always the same."""
    w, h = PROBE
    y, x = np.divmod(np.arange(w * h), w)
    pixels = np.tile(np.stack([(x + 0.5) / w, (y + 0.5) / h], axis=1), (PROBE_PATHS, 1))
    return tracer.trace(View.of(camera, PROBE, 1e-4 * longest_edge), pixels, seed=0)


def _camera(eye: F64, forward: F64, fov_y_deg: float) -> Camera:
    (x, y, z), (a, b, c) = eye.tolist(), (eye + forward).tolist()
    return Camera((x, y, z), (a, b, c), fov_y_deg=fov_y_deg)
