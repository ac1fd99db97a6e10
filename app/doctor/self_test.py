"""A self test of a few seconds: what is drawn, traced and inferred, against closed forms and a path-traced mean."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app.load import embedded_scene
from app.network.selection import DEFAULT_MODEL, find_model
from app.raycast.caster import Caster
from app.renderer import Renderer
from app.scene import Camera, CameraPath, Instance, Material, PointLight, Scene, bounds_of
from app.settings import Settings
from app.simple_meshes import quads

SIZE = 128, 96
ALBEDO, INTENSITY, HEIGHT = 0.5, 10.0, 2.0  # of the floor; of the lamp, W/sr; of the lamp above the floor
MAX_LIGHT_ERROR = 0.005                     # relative; targets are half floats
MAX_DISTANCE_ERROR = 1e-5                   # relative
# Mean of all pixels and colours of the embedded box's indirect light / albedo at ``SIZE``, path traced (512 paths per
# pixel, whose noise is 0.1 % of the mean). The network is 1 % below it.
REFERENCE_INDIRECT, MAX_INDIRECT_ERROR = 0.0592, 0.05


@dataclass(frozen=True)
class Check:
    """The result of one check: what was compared, whether it passed, and the figures."""

    name: str
    passed: bool
    text: str


def run_self_test(provider: str) -> list[Check]:
    """All checks; networks run on ``provider``.

    Raises
    ------
    AfterglowError
        When something that is needed for drawing is missing.
    """
    return [check(provider) for check in CHECKS]


def _light(_: str) -> Check:
    """Direct light on a floor under a lamp: albedo / π · I cos θ / d²."""
    with Renderer(_floor(), Settings(SIZE, ("direct", "position"), taa=False)) as renderer:
        images = renderer.render(_floor().cameras["above"].at(0.0))
    seen = images["position"][..., :2].any(axis=-1)
    square = np.sum((images["position"] - (0.0, HEIGHT, 0.0)) ** 2, axis=-1)
    expected = ALBEDO / np.pi * INTENSITY * HEIGHT / square**1.5
    error = np.abs(images["direct"][..., 0] / expected - 1)[seen].max()
    return Check("light under a lamp", bool(error < MAX_LIGHT_ERROR), f"within {error:.1e} of its closed form")


def _rays(_: str) -> Check:
    """Distances to a floor along slanted rays."""
    caster = Caster(_floor())
    slopes = np.linspace(-0.4, 0.4, 64, dtype=np.float32)
    directions = np.stack([slopes, np.full_like(slopes, -1), slopes[::-1]], axis=1)
    origins = np.tile(np.array([0, HEIGHT, 0] - caster.origin, np.float32), (len(slopes), 1))
    error = np.abs(caster.cast(origins, directions).distance / HEIGHT - 1).max()
    return Check("traced rays", bool(error < MAX_DISTANCE_ERROR), f"distances within {error:.1e}")


def _network(provider: str) -> Check:
    """Indirect light of the embedded box, twice: its mean, and whether both frames are the same."""
    scene = embedded_scene()
    camera = scene.cameras[scene.default_camera].at(0.0)
    settings = Settings(SIZE, ("indirect",), taa=False, provider=provider)
    with Renderer(scene, settings, find_model(DEFAULT_MODEL)) as renderer:
        first = renderer.render(camera)["indirect"]
        renderer.cut()
        same = np.array_equal(first, renderer.render(camera)["indirect"])
    ratio = float(first.mean(dtype=np.float64)) / REFERENCE_INDIRECT
    return Check("indirect light", abs(ratio - 1) < MAX_INDIRECT_ERROR and same,
                 f"{ratio:.3f} of the path-traced mean, two frames {'are the same' if same else 'differ'}")


CHECKS: tuple[Callable[[str], Check], ...] = (_light, _rays, _network)


def _floor() -> Scene:
    """A floor of 4×4 around the origin, a lamp above it."""
    meshes = (quads("floor", 0, ((-2, 0, 2), (4, 0, 0), (0, 0, -4))),)
    instances = (Instance("floor", 0, np.eye(4)),)
    camera = CameraPath.still(Camera((0.0, 3.0, 0.01), (0.0, 0.0, 0.0), fov_y_deg=40.0))
    return Scene("floor", meshes, instances, (Material("floor", albedo=(ALBEDO,) * 3),),
                 (PointLight((0.0, HEIGHT, 0.0), (INTENSITY,) * 3),), {"above": camera}, "above",
                 bounds_of(meshes, instances))
