"""Rays that shaders trace, against those that Embree traces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import SettingsError
from app.gl.context import Device
from app.gl.pool import Pool
from app.gl.shader import Program, resolve
from app.graph import BoundPass
from app.network.selection import find_model
from app.raycast.caster import Caster
from app.raycast.gpu_rays import GpuRays, can_trace, choose_rays, pack_scene
from app.renderer import Renderer
from app.scene import Camera, DirectionalLight, Environment, Material, Motion, RectLight, Scene, Texture
from app.settings import Settings
from tests.deforming import deforming_scene
from tests.gl.scenes import F32, GREY, Images, box, cellar, make_scene, moved, quad, slide, sphere
from tests.gl.test_final_gather import CAMERA, table_in_a_room

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SHADER = Path(__file__).with_name("traced_rays.comp")
RAYS = 4000
SIZE = (128, 96)
SHINY = Material(albedo=(0.2, 0.4, 0.8), specular=(0.04,) * 3, roughness=0.3, metallic=0.4)
LAMP_ABOVE = RectLight((-0.5, 2.9, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (8.0,) * 3)
LAMP = replace(GREY, emission=(3.0, 2.0, 1.0))


@pytest.fixture(scope="module")
def device(egl: None) -> Device:
    return Device()


def texture(seed: int, **options: object) -> Texture:
    pixels = np.random.default_rng(seed).random((5, 7, 4)).astype(np.float32)
    return Texture(pixels, **options)  # type: ignore[arg-type]


def gallery() -> Scene:
    """What surfaces can be: textured, shiny, glowing, one-sided, mirrored, in motion, and meshes of lights."""
    tiles = replace(GREY, albedo_map=texture(0, repeat=(True, False), transform=((3.0, 0.5, 0.2), (-0.4, 2.0, -0.3))))
    worn = replace(SHINY, metallic_roughness_map=texture(1), specular_map=texture(2))
    screen = replace(LAMP, emission_map=texture(3), double_sided=False)
    turned = Motion(np.array([0.0, 1.0]), np.stack([np.eye(4), np.diag([-1.0, 0.5, 2.0, 1.0])]))
    parts = [box((-2, 0, -2), (4, 3, 4), tiles), sphere((0.6, 0.7, 0.3), 0.5, 12, worn),
             quad((-1.5, 0.5, -1.5), (1, 0, 0), (0, 1, 0), screen),
             quad((0.5, 0.5, -1.4), (1, 0, 0), (0, 1, 0), replace(GREY, albedo=(0.01,) * 3, is_back_culled=True)),
             replace(quad((0.4, 1.6, -1.3), (1, 0, 0), (0, 1, 0), replace(GREY, is_back_culled=True)),
                     place=np.diag([-1.0, 1.0, 1.0, 1.0])),
             quad((-0.5, 2.8, -0.5), (1, 0, 0), (0, 0, 1), replace(LAMP, is_light_proxy=True)),
             replace(box((-1, 0, 0.5), (0.4, 0.8, 0.4), SHINY), place=np.diag([1.5, 1.0, -0.7, 1.0])),
             box((0, 0.2, 0), (0.3, 0.3, 0.3), GREY, slide([0, 1], [(0, 0, 0), (-1, 1, 0.5)])),
             box((0.2, 0.1, -0.6), (0.3, 0.3, 0.3), LAMP, turned)]
    scene = make_scene(parts)
    first = scene.meshes[0]
    colors = np.random.default_rng(4).random((len(first.positions), 4)).astype(np.float32)
    return replace(scene, meshes=(replace(first, colors=colors), *scene.meshes[1:]))


def traced_by_shaders(device: Device, caster: Caster, origins: F32, directions: F32) -> F32:
    """Shape (N, 5, 4), as traced_rays.comp gives them."""
    with device.ctx:
        raw = device.ctx.compute_shader(resolve(SHADER, {}, []))
        program = Program(raw, SHADER.name, frozenset({"body_count", "count"}))
        rays = np.zeros((len(origins), 5, 4), np.float32)
        rays[:, 0, :3], rays[:, 1, :3] = origins, directions
        buffer = device.ctx.buffer(rays.tobytes())
        GpuRays(device, caster, pack_scene(caster)).bind(program)
        program.set(count=len(origins))
        buffer.bind_to_storage_buffer(0)
        raw.run(-(-len(origins) // 64))
        device.ctx.memory_barrier()
        found = np.frombuffer(buffer.read(), np.float32)
    return found.reshape(rays.shape)


@pytest.mark.parametrize("scale", [1.0, 1e-4, 1e4])
@pytest.mark.parametrize("time", [0.0, 0.7])
def test_they_meet_what_embree_meets(device: Device, scale: float, time: float) -> None:
    caster = Caster(moved(gallery(), scale=scale))
    caster.move_to(time)
    rng = np.random.default_rng(0)
    starts, ends = (caster.random_points(RAYS, rng) for _ in range(2))
    ends = ends + 0.1 * caster.extent * rng.normal(size=ends.shape)  # not along a wall
    directions = np.asarray((ends - starts) * rng.uniform(0.2, 2.0, (RAYS, 1)), np.float32)
    starts = np.asarray(starts + 1e-3 * directions, np.float32)
    expected, found = caster.cast(starts, directions), traced_by_shaders(device, caster, starts, directions)
    met = expected.body >= 0
    assert ((found[:, 0, 0] >= 0) == met).mean() > 0.999  # but at edges
    same = met & (np.abs(found[:, 0, 0] - expected.distance) < 1e-4)
    assert same.sum() > 0.999 * met.sum()
    np.testing.assert_allclose(found[same, 1, :3], expected.position[same], atol=1e-4 * caster.extent)
    for row, values in ((2, expected.normal), (3, expected.albedo), (4, expected.traced_emission)):
        off = np.abs(found[same, row, :3] - values[same]).max(axis=1)
        assert (off > 1e-4).mean() < 0.004, row  # but where a texel ends
    for row, proxies_block in ((2, True), (3, False)):
        blocked = caster.is_occluded(starts, directions, proxies_block)
        assert ((found[:, 0, row] > 0) == blocked).mean() > 0.999
        assert 0.2 < blocked.mean() < 0.95


def test_a_body_that_is_scaled_to_nothing_is_not_there(device: Device) -> None:
    shrinks = Motion(np.array([0.0, 1.0]), np.stack([np.eye(4), np.diag([0.0, 0.0, 0.0, 1.0])]))
    caster = Caster(make_scene([quad((-1, -1, -2), (2, 0, 0), (0, 2, 0)),
                                quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), GREY, shrinks)]))
    origin = np.array([[0.1, 0.2, 3]] - caster.origin, np.float32)
    distances = []
    for time in (0.0, 1.0):
        caster.move_to(time)
        distances.append(traced_by_shaders(device, caster, origin, np.float32([[0, 0, -1]]))[0, 0, 0])
    np.testing.assert_allclose(distances, [3, 5], rtol=1e-5)


def test_shapes_that_change_and_surfaces_with_holes_are_left_to_the_cpu() -> None:
    masked = replace(GREY, alpha_cutoff=0.5)
    blended = replace(GREY, is_blended=True, alpha=0.5)
    assert can_trace(Caster(gallery()))
    assert not any(can_trace(Caster(make_scene([box((0, 0, 0), (1, 1, 1), m)]))) for m in (masked, blended))
    assert not can_trace(Caster(deforming_scene("skin", []).scene))
    scene = make_scene([box((-2, 0, -2), (4, 3, 4)), quad((0, 1, 0), (1, 0, 0), (0, 1, 0), masked)], [], CAMERA)
    with Renderer(scene, Settings(SIZE, ("indirect",), rays="gpu"), find_model("final-gather")) as renderer:
        assert "gather_surfaces" in {p.name for p in renderer.plan.passes}


def settled(scene: Scene, camera: Camera, rays: str, output: str, frames: int, model: str | None) -> Images:
    """The picture after so many frames in which nothing has moved; direct light too."""
    settings = Settings(SIZE, tuple({output, "direct"}), provider="cpu", rays=rays)
    with Renderer(scene, settings, model and find_model(model)) as renderer:
        for _ in range(frames):
            renderer.advance(camera)
        return renderer.render(camera)


def difference(a: Images, b: Images, name: str) -> tuple[float, float]:
    """Of the means, and mean of the absolute ones; relative."""
    mean = float(b[name].mean())
    return float(a[name].mean()) / mean - 1, float(np.abs(a[name] - b[name]).mean()) / mean


def test_gathered_light_is_that_of_the_cpu() -> None:
    on_cpu, on_gpu = (settled(table_in_a_room(), CAMERA, rays, "indirect", 16, "final-gather")
                      for rays in ("cpu", "gpu"))
    bias, error = difference(on_gpu, on_cpu, "indirect")
    print(f"GATHERED off by {bias:.4f} on the mean, {error:.4f} on the mean of absolutes")
    assert abs(bias) < 0.005
    assert error < 0.03
    np.testing.assert_allclose(on_gpu["direct"], on_cpu["direct"], atol=1e-3)


def test_light_of_a_window_is_that_of_the_cpu() -> None:
    """Guided rays: what they have found is brought to the CPU, and learned from, a frame later."""
    camera = Camera((2.0, 3.9, 2.65), (2.0, 0.0, 2.649), fov_y_deg=27.0)
    on_cpu, on_gpu = (settled(cellar(1.0), camera, rays, "direct", 12, None) for rays in ("cpu", "gpu"))
    bias, error = difference(on_gpu, on_cpu, "direct")
    print(f"WINDOW off by {bias:.4f} on the mean, {error:.4f} on the mean of absolutes")
    assert abs(bias) < 0.005
    assert error < 0.03


@pytest.mark.parametrize("environment", [None, Environment(np.linspace([0.3, 0.5, 1.0], [1.2, 0.8, 0.5], 64,
                                                                       dtype=np.float32)[:, None])])
def test_reflections_are_those_of_the_cpu(environment: Environment | None) -> None:
    """Of what is behind the camera, on a polished floor, in a room with a hole; a box there mirrors the room itself."""
    polished = Material(albedo=(0.3,) * 3, specular=(0.5,) * 3, roughness=0.15)
    red = Material(albedo=(0.9, 0.2, 0.1), metallic=1.0, roughness=0.1)
    scene = make_scene([quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), polished), quad((-2, 0, -2), (4, 0, 0), (0, 3, 0)),
                        box((-0.2, 0.3, 1.0), (0.6, 0.8, 0.2), red)], [LAMP_ABOVE], CAMERA)
    scene = replace(scene, environment=environment)
    on_cpu, on_gpu = (settled(scene, CAMERA, rays, "reflection", 24, "ember") for rays in ("cpu", "gpu"))
    bias, error = difference(on_gpu, on_cpu, "reflection")
    print(f"REFLECTED off by {bias:.4f} on the mean, {error:.4f} on the mean of absolutes")
    assert on_cpu["direct"].mean() > 0.01
    assert on_cpu["reflection"].mean() > 0.002
    assert abs(bias) < 0.01
    assert error < 0.03


def test_a_scene_that_is_too_large_for_a_buffer_is_left_to_the_cpu(device: Device,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    caster = Caster(gallery())
    with device.ctx:
        assert choose_rays(device, caster, "gpu") is not None
        assert choose_rays(device, caster, "auto") is None or not device.software
        monkeypatch.setattr(device, "max_storage_bytes", 2**10)
        assert choose_rays(device, caster, "gpu") is None


def test_the_device_says_what_traces_rays() -> None:
    scene = table_in_a_room()
    for rays, expected in (("cpu", "cpu"), ("gpu", "gpu")):
        with Renderer(scene, Settings(SIZE, ("indirect",), provider="cpu", rays=rays), find_model("ember")) as renderer:
            assert renderer.device["rays"] == expected
    with pytest.raises(SettingsError, match="expected one of auto, cpu, gpu"):
        Settings(rays="fast")


def test_surfels_whose_light_is_no_number_leave_the_others_alone() -> None:
    """All surfels count everywhere, and nothing times a number that is none would be none."""
    def spoil(bound: BoundPass, pool: Pool) -> None:
        if bound.name == "surfel_indirect":
            light = pool.array("surfel_indirect").copy()
            light[:, 5] = np.nan
            pool.write_array("surfel_indirect", light)

    with Renderer(table_in_a_room(), Settings(SIZE, ("indirect",), rays="gpu"), find_model("final-gather")) as renderer:
        right = renderer.render(CAMERA)["indirect"]
        renderer.cut()
        renderer.after_pass.append(spoil)
        renderer.place_surfels([CAMERA])
        spoiled = renderer.render(CAMERA)["indirect"]
    assert abs(spoiled.mean() / right.mean() - 1) < 0.05


def test_a_light_that_gets_an_area_later_has_its_rays() -> None:
    """The caster is made then, outside of a frame."""
    sun = DirectionalLight((0.0, -1.0, 0.1), (1.0, 1.0, 1.0))
    scene = make_scene([box((-2, 0, -2), (4, 3, 4))], [sun], CAMERA)
    with Renderer(scene, Settings(SIZE, ("direct",), rays="gpu"), None) as renderer:
        renderer.advance(CAMERA)
        assert not renderer.relight((LAMP_ABOVE,))


@pytest.mark.parametrize("orthographic", [False, True])
def test_without_history_light_is_that_of_the_cpu(orthographic: bool) -> None:
    camera = replace(CAMERA, orthographic_height=2.5) if orthographic else CAMERA
    images = []
    for rays in ("cpu", "gpu"):
        settings = Settings(SIZE, ("indirect",), taa=False, provider="cpu", rays=rays)
        with Renderer(table_in_a_room(), settings, find_model("final-gather")) as renderer:
            images.append(renderer.render(camera))
    bias, error = difference(images[1], images[0], "indirect")
    print(f"ALONE off by {bias:.4f} on the mean, {error:.4f} on the mean of absolutes")
    assert abs(bias) < 0.02
    assert error < 0.1
