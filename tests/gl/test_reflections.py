"""Indirect light on glossy surfaces: what mirrors show, where, and what reflections cost where there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from app.frame import FrameInputs
from app.math3d import translation
from app.network.selection import SSGI, Model, find_model
from app.passes import reflection, reflection_rays
from app.renderer import Renderer
from app.scene import Camera, Environment, Material, Motion, PointLight, Scene, Texture, Transmission
from app.settings import Settings
from tests.gl.scenes import Part, box, make_scene, quad, sphere

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

Image = NDArray[np.float32]
SIZE = (96, 72)
MIRROR = Material("mirror", albedo=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.0)
ROUGH_METAL = Material("rough metal", albedo=(0.9, 0.9, 0.9), metallic=1.0, roughness=0.5)
WHITE, RED, BLUE = (Material(name, albedo=albedo) for name, albedo in (
    ("white", (0.7, 0.7, 0.7)), ("red", (0.7, 0.02, 0.02)), ("blue", (0.02, 0.02, 0.7))))
DARK = Material("dark", albedo=(0.02, 0.02, 0.02))
LAMP = PointLight((0.0, 1.6, 0.0), (3.0, 3.0, 3.0), radius=0.05)
CAMERA = Camera((0.0, 1.0, 0.5), (0.0, 1.0, -1.0), fov_y_deg=50.0)


def room(front: Material = MIRROR, *furniture: Part) -> Scene:
    """A cube of edge 2; behind the camera its wall is red on the left as the camera looks, blue on the right."""
    walls = [quad((-1, 0, -1), (2, 0, 0), (0, 2, 0), front),
             quad((0, 0, 1), (-1, 0, 0), (0, 2, 0), RED), quad((1, 0, 1), (-1, 0, 0), (0, 2, 0), BLUE),
             quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), WHITE), quad((-1, 2, -1), (2, 0, 0), (0, 0, 2), WHITE),
             quad((-1, 0, 1), (0, 0, -2), (0, 2, 0), WHITE), quad((1, 0, -1), (0, 0, 2), (0, 2, 0), WHITE)]
    return make_scene([*walls, *furniture], [LAMP], CAMERA)


def draw(scene: Scene, model: Model, cameras: Sequence[Camera] = (CAMERA,), size: tuple[int, int] = SIZE,
         reflections: bool = True) -> list[dict[str, Image]]:
    """All images of consecutive frames."""
    settings = Settings(size=size, outputs=("final", "reflection", "specular"), reflections=reflections, provider="cpu")
    with Renderer(scene, settings, model) as renderer:
        return [renderer.render(camera) for camera in cameras]


def passes(scene: Scene, model: Model | None, reflections: bool = True) -> tuple[set[str], dict[str, str]]:
    """Names of the passes that run, and why others don't."""
    with Renderer(scene, Settings(size=(32, 24), reflections=reflections, provider="cpu"), model or ()) as renderer:
        return {p.name for p in renderer.plan.passes}, dict(renderer.plan.culled)


def test_a_mirror_shows_the_walls_behind_the_camera_where_they_are(small_ember: Path) -> None:
    """The mirror is at distance 1.5, the wall at 1.5 + 2 from the eye: the wall's middle is the picture's."""
    image = draw(room(), small_ember)[-1]["reflection"]
    row = image[30:42].mean(axis=0)
    # The wall's half width 1 is seen at a distance of 3.5; half the picture's is tan 25° · 4 / 3 at a distance of 1.
    half_wall = 1 / 3.5 / (np.tan(np.radians(25)) * 4 / 3) * SIZE[0] / 2
    left, right = row[int(48 - half_wall) + 4:45], row[51:int(48 + half_wall) - 4]
    assert (left[:, 0] > 5 * left[:, 2]).all()
    assert (right[:, 2] > 5 * right[:, 0]).all()
    outside = row[:int(48 - half_wall) - 4]
    assert (outside[:, 2] > 0.3 * outside[:, 0]).all()  # the white side wall


def test_a_mirror_shows_as_much_light_as_the_wall_sends(small_ember: Path) -> None:
    """Compared with a view of the wall itself, from the eye's mirror image."""
    from_behind = Camera((0.0, 1.0, -2.5), (0.0, 1.0, 1.0), fov_y_deg=50.0)  # the mirror has no back
    scene = room(replace(MIRROR, is_back_culled=True))
    seen = draw(scene, small_ember, (CAMERA,) * 4)[-1]["reflection"]
    there = draw(scene, small_ember, (from_behind,) * 4)[-1]["final"][:, ::-1]
    part = slice(24, 48), slice(36, 60)
    np.testing.assert_allclose(seen[part].mean(axis=(0, 1)), there[part].mean(axis=(0, 1)), rtol=0.2)


def test_a_mirror_shows_what_a_mirror_beside_it_shows(small_ember: Path) -> None:
    """The same as the mirror beside it shows to the eye's mirror image."""
    beside = quad((-0.98, 0, 1), (0, 0, -2), (0, 2, 0), MIRROR)
    from_behind = Camera((0.0, 1.0, -2.5), (0.0, 1.0, 1.0), fov_y_deg=50.0)  # the mirror has no back
    scene = room(replace(MIRROR, is_back_culled=True), beside)
    seen = draw(scene, small_ember, (CAMERA,) * 8)[-1]["reflection"]
    there = draw(scene, small_ember, (from_behind,) * 8)[-1]["reflection"][:, ::-1]
    part = slice(24, 48), slice(6, 20)
    assert there[part].min() > 0
    np.testing.assert_allclose(seen[part].mean(axis=(0, 1)), there[part].mean(axis=(0, 1)), rtol=0.1)
    np.testing.assert_allclose(seen[part].mean(axis=(0, 2)), there[part].mean(axis=(0, 2)), rtol=0.2)


@pytest.mark.parametrize("rays", ["cpu", "gpu"])
def test_a_mirror_shows_highlights_on_metal(rays: str, small_ember: Path) -> None:
    """As the eye's mirror image sees them: metal that reflects a lamp diffusely would be evenly lit.

    The lamp is behind the mirror's plane, so that it lights the metal alone.
    """
    ball = sphere((0.0, 1.0, 0.6), 0.3, material=replace(ROUGH_METAL, roughness=0.35))
    from_behind = Camera((0.0, 1.0, -2.5), (0.0, 1.0, 1.0), fov_y_deg=50.0)  # the mirror has no back
    mirror = quad((-1, 0, -1), (2, 0, 0), (0, 2, 0), replace(MIRROR, is_back_culled=True))
    scene = make_scene([mirror, ball], [PointLight((0.6, 2.6, -1.2), (9.0, 9.0, 9.0))], CAMERA)
    settings = Settings(size=SIZE, outputs=("final", "reflection"), rays=rays, provider="cpu")
    with Renderer(scene, settings, small_ember) as renderer:
        seen = [renderer.render(replace(CAMERA, eye=(0.0, 1.0, 0.2))) for _ in range(24)][-1]["reflection"]
        there = [renderer.render(replace(from_behind, eye=(0.0, 1.0, -2.2))) for _ in range(24)][-1]["final"][:, ::-1]
    on_ball = slice(28, 44), slice(40, 56)
    mirrored, direct = seen[on_ball].mean(axis=-1), there[on_ball].mean(axis=-1)
    print(f"HIGHLIGHT {np.corrcoef(mirrored.ravel(), direct.ravel())[0, 1]:.3f}, "
          f"{mirrored.mean() / direct.mean():.3f} of the light, brightest {mirrored.max() / direct.max():.3f}")
    assert np.corrcoef(mirrored.ravel(), direct.ravel())[0, 1] > 0.98
    assert mirrored.mean() == pytest.approx(direct.mean(), rel=0.05)
    assert mirrored.max() == pytest.approx(direct.max(), rel=0.1)


def test_a_coarse_grid_is_interpolated(small_ember: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in large pictures: about the same light, and no blocks of pixels that share a texel."""
    fine = draw(room(), small_ember, (CAMERA,) * 4)[-1]["reflection"]
    monkeypatch.setattr(reflection, "MAX_TEXELS", SIZE[0] * SIZE[1] // 9)
    coarse = draw(room(), small_ember, (CAMERA,) * 4)[-1]["reflection"]
    assert np.abs(coarse - fine).mean() < 0.1 * fine.mean()
    inside = coarse[24:48, 24:72, 0]
    assert (inside[:, 1:] != inside[:, :-1]).mean() > 0.9


def coarsen(monkeypatch: pytest.MonkeyPatch, size: tuple[int, int] = SIZE) -> None:
    """A grid that is to the picture as that of large pictures."""
    for name in ("MIN_TEXELS", "MAX_TEXELS"):
        monkeypatch.setattr(reflection, name, size[0] * size[1] // 16)


def mixed_share(reflection: Image) -> float:
    """Share of pixels around the border between the red and the blue wall that show both."""
    red, blue = reflection[30:42, 44:52, 0], reflection[30:42, 44:52, 2]
    return float((np.minimum(red, blue) > 0.25 * np.maximum(red, blue)).mean())


def test_a_mirror_at_rest_becomes_as_sharp_as_the_picture(small_ember: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    coarsen(monkeypatch)
    beside = replace(CAMERA, eye=(0.01, *CAMERA.eye[1:]))
    path = beside, *(CAMERA,) * 20
    images = [image["reflection"] for image in draw(room(), small_ember, path)]
    with monkeypatch.context() as without_detail:
        without_detail.setattr(reflection, "has_detail", lambda *_: False)
        assert mixed_share(draw(room(), small_ember, path)[1]["reflection"]) > 0.2
    assert mixed_share(images[-1]) <= 1 / 8  # at most one pixel of each row


def test_frames_with_more_reflections_count_more_in_a_still(small_ember: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the first frames at rest, few pixels of a mirror have light of their own."""
    coarsen(monkeypatch)

    def seen(frames: int) -> Image:
        return draw(room(), small_ember, (CAMERA,) * frames)[-1]["final"][24:48, 24:72]

    settled, still = seen(128), seen(17)
    monkeypatch.setattr(FrameInputs, "gathers_reflections", False)
    weighted, equal = (float(np.abs(image - settled).mean()) for image in (still, seen(17)))
    print(f"STILL {weighted:.4f} from a settled one, {equal:.4f} where all frames count alike")
    assert weighted < 0.9 * equal


@pytest.mark.parametrize("roughness", [0.0, 0.03])
def test_edges_in_a_mirror_are_straight_once_each_pixel_has_a_ray(roughness: float, small_ember: Path,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    """The upright border between a red and a blue wall is in each row at the same place, in pixels."""
    size = (192, 144)
    coarsen(monkeypatch, size)
    beside = replace(CAMERA, eye=(0.013, 1.0, 0.5), target=(0.013, 1.0, -1.0))
    seen = draw(room(replace(MIRROR, roughness=roughness)), small_ember, (beside,) * 17, size)[-1]["reflection"]
    red, blue = seen[60:84, 80:112, 0], seen[60:84, 80:112, 2]
    border = (red / (red + blue)).sum(axis=1)
    print(f"BORDER off by {border.std():.3f} pixels")
    assert border.std() < 0.12


def test_bumps_in_a_mirror_are_averaged(small_ember: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each pixel shows one of many; those beside it show others."""
    coarsen(monkeypatch)
    slopes = np.random.default_rng(1).normal(0.0, 0.04, (256, 256, 2))
    normals = np.concatenate([slopes, np.ones((256, 256, 1))], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    texture = Texture(np.concatenate([normals / 2 + 0.5, np.ones((256, 256, 1))], axis=2).astype(np.float32))
    scene = room(replace(MIRROR, normal_map=texture))
    front = replace(scene.meshes[0], normals=np.tile(np.float32((0, 0, 1)), (6, 1)),
                    tangents=np.tile(np.float32((1, 0, 0, 1)), (6, 1)))
    image = draw(replace(scene, meshes=(front, *scene.meshes[1:])), small_ember, (CAMERA,) * 17)[-1]["reflection"]
    mixed = image[30:42, 40:56, 0] / image[30:42, 40:56].sum(axis=-1)
    print(f"BUMPS {np.abs(np.diff(mixed, axis=0)).mean():.4f}")
    assert 0.001 < np.abs(np.diff(mixed, axis=0)).mean() < 0.06


def test_a_mirror_at_rest_has_few_speckles(small_ember: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where most light of the lamps is hidden, few shadow rays find the rest; it stays as bright as it was."""
    size = (192, 144)
    coarsen(monkeypatch, size)
    chest = box((0.3, 0.02, 0.2), (0.9, 0.5, 0.8), WHITE)
    hidden = [PointLight((x, 0.3, z), (9.0, 9.0, 9.0), radius=0.02) for x in (0.4, 0.6, 0.8) for z in (0.3, 0.7)]
    scene = replace(room(MIRROR, chest), lights=(LAMP, *hidden))

    def seen() -> Image:
        image = draw(scene, small_ember, (CAMERA,) * 17, size)[-1]["reflection"][60:84, 60:132]
        return np.asarray(image.mean(axis=-1))

    light = seen()
    monkeypatch.setattr(reflection_rays, "SAME_NORMAL", 2.0)
    noisy = seen()
    speckles, without = (float((a > 1.2 * around(a).max(axis=0))[1:-1, 1:-1].mean()) for a in (light, noisy))
    print(f"SPECKLES {speckles:.4f}, {without:.4f} without the mean; light {light.mean() / noisy.mean():.3f}")
    assert without > 0.03
    assert speckles < without / 3
    assert light.mean() == pytest.approx(noisy.mean(), rel=0.03)


def around(image: Image) -> Image:
    """The eight pixels around each, shape (8, h, w)."""
    return np.stack([np.roll(image, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)])


def test_rare_light_at_the_end_of_a_ray_is_held_to_that_of_others() -> None:
    """On a floor that 5 × 5 rays meet, one of them with much. What is no number spoils those beside it alone."""
    y, x = np.mgrid[:5, :5]
    position = np.stack([x.ravel(), np.zeros(25), y.ravel()], axis=1).astype(np.float32)
    ends = SimpleNamespace(position=position, normal=np.tile(np.float32((0, 1, 0)), (25, 1)),
                           distance=np.full(25, 50.0, np.float32))

    def found(middle: float) -> Image:
        light = np.ones((25, 3), np.float32)
        light[12] = middle
        return reflection_rays._averaged(light, np.arange(25), (5, 5), ends,  # type: ignore[arg-type]
                                         np.zeros((25, 2), np.float32))

    limit = 4 * (1 + (24 + 100) / 25)
    np.testing.assert_allclose(found(100.0)[12], (8 + limit) / 9, rtol=1e-5)
    np.testing.assert_allclose(found(2.0)[12], 10 / 9, rtol=1e-5)
    assert np.isfinite(found(np.nan)[[0, 4, 20, 24]]).all()


def test_only_ends_of_rays_on_one_flat_surface_share_their_light() -> None:
    """Rays from a row of texels, of which one has no ray: two end on a floor, two on a wall, two far apart."""
    rows = np.array([0, 1, 2, 3, 5, 6])
    position = np.float32([[0, 0, 0], [1, 0, 0], [2, 1, 0], [2, 2, 0], [3, 0, 0], [9, 0, 0]])
    normal = np.float32([[0, 1, 0], [0, 1, 0], [-1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 1, 0]])
    light = np.float32([[1, 1, 1], [3, 3, 3], [10, 0, 0], [20, 0, 0], [7, 7, 7], [8, 8, 8]])
    ends = SimpleNamespace(position=position, normal=normal, distance=np.full(6, 20, np.float32))
    for growth, last in ((0.0, (7, 8)), (0.14, (7, 8)), (0.16, (7.5, 7.5))):  # of a texel's rays, at a length of 20
        beams = np.tile(np.float32((0, growth)), (6, 1))
        found = reflection_rays._averaged(light, rows, (7, 1), ends, beams)  # type: ignore[arg-type]
        np.testing.assert_allclose(found[:4], [[2, 2, 2], [2, 2, 2], [15, 0, 0], [15, 0, 0]])
        np.testing.assert_allclose(found[4:, 0], last)


def rod(center: tuple[float, float, float], radius: float, height: float, material: Material) -> Part:
    """An upright one, without ends."""
    angle = np.linspace(0, 2 * np.pi, 65)
    low = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1) * radius + center
    high = low + np.array((0.0, height, 0.0))
    return Part(np.concatenate([np.stack([low[:-1], low[1:], high[1:]], 1),
                                np.stack([low[:-1], high[1:], high[:-1]], 1)]), material)


def test_a_metal_rod_at_rest_is_not_mottled(small_ember: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Along it light changes smoothly, also where a still has hardly more than one ray of each pixel."""
    size = (192, 144)
    coarsen(monkeypatch, size)
    brushed = replace(ROUGH_METAL, roughness=0.3)
    scene = room(WHITE, rod((0.0, 0.0, -0.6), 0.04, 2.0, brushed))
    seen = draw(scene, small_ember, (CAMERA,) * 17, size)[-1]
    columns = np.flatnonzero(seen["reflection"][72].max(axis=-1))[2:-2]
    light = seen["final"][40:104, columns].astype(np.float64).mean(axis=-1)
    row = np.arange(len(light))
    smooth = np.polynomial.polynomial.polyval(row, np.polynomial.polynomial.polyfit(row, light, 3)).T
    noise = float((light - smooth).std() / light.mean())
    print(f"NOISE {noise:.3f}")
    assert noise < 0.06


@pytest.mark.parametrize("rays", ["cpu", pytest.param("gpu", marks=pytest.mark.xfail(
    reason="shaders trace rays through one blurred copy of each texture, however wide they are", strict=True))])
def test_a_polished_ball_shows_the_mean_of_a_fine_pattern(rays: str, small_ember: Path,
                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    """A pixel of it shows several squares of the walls, behind the camera and in the picture."""
    size, center = (192, 144), np.array((0.0, 1.0, -0.3))
    coarsen(monkeypatch, size)
    squares = np.where(np.add.outer(np.arange(64), np.arange(64))[..., None] % 2, 1.0, 0.1) * np.ones(4)
    noise = []
    for texture in (Texture(squares.astype(np.float32)), None):
        wall = replace(WHITE, albedo_map=texture)
        scene = room(wall, sphere(tuple(center), 0.12, 64, MIRROR))
        scene = replace(scene, materials=tuple(MIRROR if m is MIRROR else wall for m in scene.materials))
        ball = scene.meshes[-1]
        smooth = replace(ball, normals=((ball.positions - center) / 0.12).astype(np.float32))
        settings = Settings(size=size, outputs=("reflection",), rays=rays, provider="cpu")
        with Renderer(replace(scene, meshes=(*scene.meshes[:-1], smooth)), settings, small_ember) as renderer:
            seen = [renderer.render(CAMERA)["reflection"] for _ in range(17)][-1][58:87, 82:111].mean(axis=-1)
        noise.append(float(np.median(np.abs(np.diff(seen, axis=0))) / seen.mean()))
    print(f"FROST {noise[0]:.4f}, {noise[1]:.4f} without the pattern")
    assert noise[0] < noise[1] + 0.02


@pytest.mark.parametrize("pixels", [20, 1])
def test_a_flat_mirror_of_any_width_shows_stripes(pixels: float, small_ember: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    """A thin one too, whose pixels have others of it above and below alone."""
    size = (192, 144)
    coarsen(monkeypatch, size)
    stripes = np.where(np.arange(64)[:, None, None] // 4 % 2, 1.0, 0.05) * np.ones((64, 4, 4))
    half = 0.9 * np.tan(np.radians(25)) * 4 / 3 * pixels / size[0]
    striped = replace(WHITE, albedo_map=Texture(stripes.astype(np.float32)))
    scene = room(DARK, quad((-half, 0.5, -0.4), (2 * half, 0, 0), (0, 1, 0), MIRROR),
                 quad((1, 0, 0.99), (-2, 0, 0), (0, 2, 0), striped))
    seen = draw(scene, small_ember, (CAMERA,) * 33, size)[-1]["reflection"][50:94, 94:98].max(axis=(1, 2))
    print(f"STRIPES {pixels} {seen.std() / seen.mean():.3f}")
    assert seen.std() > 0.45 * seen.mean()


def test_satin_metal_shows_what_is_far_away_with_little_grain_in_a_short_still(small_ember: Path,
                                                                               monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen from so near that single rays of its lobe are several pixels apart."""
    size = (192, 144)
    coarsen(monkeypatch, size)
    strips = [quad((0.95 - 0.1 * i, 0.0, 0.9), (-0.05, 0, 0), (0, 2, 0), BLACK) for i in range(19)]
    scene, camera = room(replace(MIRROR, roughness=0.06), *strips), replace(CAMERA, fov_y_deg=7.0)
    images = [image["reflection"].mean(axis=-1) for image in draw(scene, small_ember, (camera,) * 160, size)]
    still, settled = images[15], images[159]
    grain = float(np.sqrt(((still - settled)**2).mean()) / settled.mean())
    print(f"SATIN grain {grain:.3f}, contrast {still.std() / settled.std():.3f}")
    assert grain < 0.13
    assert still.std() == pytest.approx(settled.std(), rel=0.1)


def test_a_metal_rod_shows_a_small_bright_spot_from_the_first_frames_on(small_ember: Path,
                                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    """Which few rays meet: those that do not must not count more than those that do."""
    size = (192, 144)
    coarsen(monkeypatch, size)
    dark, brushed = Material("dark", albedo=(0.05,) * 3), replace(ROUGH_METAL, roughness=0.2)
    walls = [quad((-1, 0, -1), (2, 0, 0), (0, 2, 0), dark), quad((1, 0, 1), (-2, 0, 0), (0, 2, 0), dark),
             quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), dark), quad((-1, 2, -1), (2, 0, 0), (0, 0, 2), dark),
             quad((-1, 0, 1), (0, 0, -2), (0, 2, 0), dark), quad((1, 0, -1), (0, 0, 2), (0, 2, 0), dark)]
    lamp = PointLight((0.6, 1.0, 0.85), (3.0, 3.0, 3.0), radius=0.01)  # which lights one of the walls
    scene = make_scene([*walls, rod((0.0, 0.0, -0.6), 0.04, 2.0, brushed)], [lamp], CAMERA)
    light = [image["reflection"][40:104].mean(dtype=np.float64)
             for image in draw(scene, small_ember, (CAMERA,) * 60, size)]
    print(f"LIGHT {np.mean(light[8:17]) / np.mean(light[30:]):.3f}")
    assert np.mean(light[8:17]) == pytest.approx(np.mean(light[30:]), rel=0.1)


def test_a_metal_ball_is_not_blurred_more_than_its_lobe(small_ember: Path) -> None:
    """Bands of a sky are wider than the lobe, but in the ball nearer together than it would spread on a floor."""
    bands = np.where(np.arange(64)[:, None, None] // 4 % 2, 2.0, 0.2) * np.ones((64, 4, 3))
    gold = Material("gold", albedo=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.2)
    scene = replace(make_scene([sphere((0.0, 1.0, -1.0), 0.6, 48, gold)], [], CAMERA),
                    environment=Environment(bands.astype(np.float32)))
    image = draw(scene, small_ember, (CAMERA,) * 6)[-1]["reflection"][..., 0]
    column = image[:, 44:52].mean(axis=1)[28:44]  # around the middle of the ball
    print(f"BANDS between {column.min():.2f} and {column.max():.2f}")
    assert column.max() > 1.8 * column.min()


def test_what_a_mirror_showed_at_rest_is_gone_when_the_camera_moves(small_ember: Path,
                                                                    monkeypatch: pytest.MonkeyPatch) -> None:
    coarsen(monkeypatch)
    moved = replace(CAMERA, eye=(0.25, 1.0, 0.5), target=(0.25, 1.0, -1.0))
    after = draw(room(), small_ember, (*(CAMERA,) * 20, moved))[-1]["reflection"]
    settled = draw(room(), small_ember, (moved,) * 20)[-1]["reflection"]
    before = draw(room(), small_ember, (CAMERA,) * 20)[-1]["reflection"]
    print("MOVED", *(np.abs(image - settled).mean() / settled.mean() for image in (after, before)))
    assert np.abs(after - settled).mean() < 0.1 * settled.mean()


def test_light_of_few_traced_rays_is_that_of_all(small_ember: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A rough floor reflects a dark wall in view and a bright sky out of view, while a box moves."""
    rough = Material(albedo=(0.05,) * 3, specular=(0.5,) * 3, roughness=0.4)
    here, there = np.eye(4), np.eye(4)
    there[0, 3] = 0.5
    parts = [quad((-2, 0, 1), (4, 0, 0), (0, 0, -3), rough), quad((-2, 0, -2), (4, 0, 0), (0, 0.8, 0), DARK),
             box((1.5, 0.0, -1.5), (0.1, 0.1, 0.1), DARK, Motion(np.array([0.0, 1.0]), np.stack([here, there])))]
    scene = replace(make_scene(parts, [LAMP], CAMERA), environment=Environment(np.ones((2, 4, 3), np.float32)))
    camera = Camera((0.0, 0.7, 1.0), (0.0, 0.2, -1.5), fov_y_deg=50.0)
    light = []
    for budget in (2**17, 512):
        monkeypatch.setattr(reflection_rays, "FRAME_RAYS", dict.fromkeys(reflection_rays.FRAME_RAYS, budget))
        with Renderer(scene, Settings(size=SIZE, outputs=("reflection",), provider="cpu"), small_ember) as renderer:
            frames = [renderer.render(camera, 0.02 * k)["reflection"][36:].mean() for k in range(24)]
        light.append(np.mean(frames[12:]))
    assert light[1] == pytest.approx(light[0], rel=0.1)


def test_reflections_can_be_switched_off(small_ember: Path) -> None:
    names, culled = passes(room(), small_ember, reflections=False)
    assert not any(name.startswith("reflection") for name in names)
    assert culled["reflection"] == "switched off by --no-reflections"
    image = draw(room(), small_ember, reflections=False)[-1]
    assert not image["reflection"].any()
    assert image["final"][36:42, 40:56].max() < 1e-3  # the mirror shows the lamp's highlight alone


def test_the_picture_has_reflections_without_an_image_of_them(small_ember: Path) -> None:
    names, culled = passes(room(), small_ember)
    assert "reflection_filter_near" in names
    assert culled["reflection"] == "not asked for by --aov; composite adds reflections itself"


def test_a_scene_without_shiny_surfaces_has_no_reflections(small_ember: Path) -> None:
    names, culled = passes(room(WHITE), small_ember)
    assert not any(name.startswith("reflection") for name in names)
    assert culled["reflection"] == "no material has a specular lobe"


def test_rough_surfaces_trace_no_rays(small_ember: Path) -> None:
    names, culled = passes(room(replace(ROUGH_METAL, roughness=0.7)), small_ember)
    assert not any(name.startswith("reflection") for name in names)
    assert culled["reflection_rays"] == "all opaque surfaces are too rough for rays"


@pytest.mark.parametrize("roughness", [0.7, 0.2])
def test_depth_is_read_for_reflections_only_where_rays_are_traced(small_ember: Path, roughness: float) -> None:
    scene = room(replace(ROUGH_METAL, roughness=roughness))
    with Renderer(scene, Settings(size=(32, 24), provider="cpu"), small_ember) as renderer:
        reads = next(p.reads for p in renderer.plan.passes if p.name == "composite")
    assert "specular_roughness" in reads and ("depth" in reads) == (roughness < 0.6)


def test_without_a_model_there_are_none() -> None:
    names, culled = passes(room(), None)
    assert not any(name.startswith("reflection") for name in names)
    assert culled["reflection"] == "no model was chosen"


def test_a_model_without_surfels_gets_some() -> None:
    """Rays' ends send direct light then."""
    image = draw(room(), SSGI)[-1]["reflection"]
    assert image[30:42, 40:45, 0].min() > 0.02


def test_the_inside_of_a_metal_box_is_lit(small_ember: Path) -> None:
    scene = make_scene([box((-1, 0, -1), (2, 2, 2), ROUGH_METAL)], [LAMP], CAMERA)
    image = draw(scene, small_ember, (CAMERA,) * 3)[-1]["final"]
    assert np.isfinite(image).all()
    assert (image.max(axis=2) > 0).mean() > 0.9


def test_a_mirror_that_faces_a_mirror_stays_bounded(small_ember: Path) -> None:
    parts: list[Part] = [quad((-1, 0, -1), (2, 0, 0), (0, 2, 0), MIRROR),
                         quad((1, 0, 1), (-2, 0, 0), (0, 2, 0), MIRROR),
                         quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), WHITE)]
    frames = draw(make_scene(parts, [LAMP], CAMERA), small_ember, (CAMERA,) * 8)
    brightest = [frame["reflection"].max() for frame in frames]
    assert all(np.isfinite(frame["final"]).all() for frame in frames)
    assert brightest[-1] <= 2 * brightest[0]


def test_the_picture_holds_the_reflection_that_its_output_shows(small_ember: Path) -> None:
    outputs = ("lit", "reflection", "direct", "specular", "indirect", "albedo")
    settings = Settings(size=SIZE, outputs=outputs, provider="cpu")
    scene = room(replace(ROUGH_METAL, roughness=0.2))
    with Renderer(scene, settings, small_ember) as renderer:
        image = renderer.render(CAMERA)
    parts = sum(image[name] for name in ("direct", "specular", "reflection")) + image["albedo"] * image["indirect"]
    np.testing.assert_allclose(image["lit"], parts, rtol=5e-3, atol=1e-3)
    assert image["reflection"].max() > 0.01


def test_rays_that_meet_nothing_show_the_environment(small_ember: Path) -> None:
    """A mirror under a constant sky reflects exactly its radiance, which is not counted as direct light too."""
    sky = Environment(np.full((2, 4, 3), 0.5, np.float32))
    scene = replace(make_scene([quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), MIRROR)], [], CAMERA), environment=sky)
    down = Camera((0.0, 1.0, 0.0), (0.0, 0.0, -0.2), fov_y_deg=30.0)
    image = draw(scene, small_ember, (down,) * 2)[-1]
    np.testing.assert_allclose(image["reflection"], 0.5, rtol=0.02)
    assert not image["specular"].any()


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (2, 3)])
def test_pictures_of_any_size(size: tuple[int, int], small_ember: Path) -> None:
    image = draw(room(), small_ember, (CAMERA,) * 2, size)[-1]["final"]
    assert np.isfinite(image).all()
    assert image.max() > 0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -100.0])
def test_broken_roughness_stays_alone(value: float, small_ember: Path) -> None:
    pixels = np.ones((8, 8, 4), np.float32)
    pixels[..., 1] = 0.1
    pixels[3, 3, 1] = value
    broken = replace(MIRROR, roughness=1.0, metallic_roughness_map=Texture(pixels))
    image, whole = (draw(room(material), small_ember, (CAMERA,) * 3)[-1] for material in (
        broken, replace(broken, metallic_roughness_map=None, roughness=0.1)))
    assert np.isfinite(image["final"]).all()
    assert image["reflection"].max() < 1.1 * whole["reflection"].max()


def test_reflections_follow_a_moving_camera(small_ember: Path) -> None:
    """Frames of a moving camera differ little from frames without history, and no more than these from each other."""
    cameras = [replace(CAMERA, eye=(0.02 * k, 1.0, 0.5)) for k in range(8)]
    moved = draw(room(), small_ember, cameras)
    first = [draw(room(), small_ember, (camera,) * 2)[-1] for camera in cameras[-2:]]
    error = np.abs(moved[-1]["reflection"] - first[-1]["reflection"])
    assert error.mean() < 0.08 * first[-1]["reflection"].mean()
    change, expected = (np.abs(b["reflection"] - a["reflection"]).mean() for a, b in ((moved[-2], moved[-1]), first))
    assert change <= 1.3 * expected


def test_orthographic_views_have_reflections(small_ember: Path) -> None:
    """A mirror seen head-on shows the middle of the wall behind the eye over its whole height."""
    parallel = replace(CAMERA, orthographic_height=1.0)
    image = draw(room(), small_ember, (parallel,) * 2)[-1]["reflection"][24:48]
    assert (image[:, 4:44, 0] > 5 * image[:, 4:44, 2]).mean() > 0.95
    assert (image[:, 52:92, 2] > 5 * image[:, 52:92, 0]).mean() > 0.95


def test_a_floor_at_a_slant_is_not_blurred_sideways() -> None:
    """There a lobe is narrow: after a few frames, an edge that runs towards the eye is as wide as later."""
    polished, black = replace(ROUGH_METAL, roughness=0.3), Material("black", albedo=(0.0, 0.0, 0.0))
    camera = Camera((0.0, 0.7, 0.0), (0.0, 0.2, -4.0), fov_y_deg=50.0)
    parts = [quad((-4, 0, 0), (8, 0, 0), (0, 0, -8), polished), quad((-4, 0, -8), (4, 0, 0), (0, 4, 0), WHITE),
             quad((0, 0, -8), (4, 0, 0), (0, 4, 0), black)]
    scene = make_scene(parts, [PointLight((-2.0, 2.0, -6.0), (9.0, 9.0, 9.0), radius=0.05)], camera)
    settings = Settings(size=(384, 288), outputs=("reflection",), taa=True, provider="cpu")
    widths = []
    with Renderer(scene, settings, find_model("ember")) as renderer:
        for _ in range(64):
            row = renderer.render(camera)["reflection"][144:156, :, 0].mean(axis=0)
            lit = np.clip((row - row[-60:].mean()) / (row[60:120].mean() - row[-60:].mean()), 0, 1)
            widths.append(float(np.minimum(lit, 1 - lit)[120:300].sum()))
    print(f"EDGE {widths[7]:.2f}, {widths[15]:.2f} and {widths[-1]:.2f} pixels")
    assert abs(widths[15] / widths[-1] - 1) < 0.01


BLACK = Material("black", albedo=(0.0, 0.0, 0.0))
VEIL = replace(BLACK, is_blended=True, alpha=0.5)
STAINED = replace(BLACK, albedo=(0.25, 0.5, 1.0), transmission=Transmission(1.0))


@pytest.mark.parametrize(("material", "passing"), [(VEIL, (0.5,) * 3), (STAINED, (0.25, 0.5, 1.0))],
                         ids=["veil", "stained glass"])
def test_mirrors_show_what_is_behind_glass_in_its_tint(material: Material, passing: tuple[float, float, float],
                                                       small_ember: Path) -> None:
    """Without noise: no ray is chosen to pass or not."""
    before_sky = quad((-4, -4, 1), (0, 9, 0), (9, 0, 0), material), quad((-1, 0, -1), (2, 0, 0), (0, 2, 0), MIRROR)
    scene = replace(make_scene(before_sky, camera=CAMERA), environment=Environment(np.ones((8, 16, 3), np.float32)))
    seen = draw(scene, small_ember)[-1]["reflection"][24:48, 36:60]
    np.testing.assert_allclose(seen, np.broadcast_to(passing, seen.shape), rtol=0.01)


def test_lamps_do_not_brighten_clear_glass_in_a_mirror(small_ember: Path) -> None:
    """Their highlights on it are small spots; as diffuse light they would hide a dark wall, in grains."""
    glass = replace(BLACK, roughness=0.0, specular=(0.04,) * 3, transmission=Transmission(1.0), albedo=(1.0,) * 3)
    before_wall = quad((-1, 0, -1), (2, 0, 0), (0, 2, 0), MIRROR), quad((1, 0, 1), (-2, 0, 0), (0, 2, 0), DARK)
    pane = quad((-1, 0, 0.7), (2, 0, 0), (0, 2, 0), glass)
    bare, behind = (draw(make_scene([*before_wall, *front], [LAMP], CAMERA), small_ember)[-1]["reflection"]
                    for front in ((), (pane,)))
    np.testing.assert_allclose(behind[12:40, 24:72], 0.96 * bare[12:40, 24:72], atol=0.01)  # diffuse light was 0.08


def test_a_floor_shows_what_is_behind_a_veil_in_its_tint(small_ember: Path) -> None:
    """Also where the picture shows the end of the ray."""
    glossy, bright = replace(BLACK, roughness=0.0, specular=(0.04,) * 3), replace(BLACK, emission=(1.0, 1.0, 1.0))
    parts = quad((-4, 0, 1), (9, 0, 0), (0, 0, -2), glossy), quad((-4, 0, -1), (9, 0, 0), (0, 4, 0), bright)
    veil = quad((-4, 0.15, -0.95), (9, 0, 0), (0, 4, 0), VEIL)
    camera = Camera((0.0, 0.6, 1.0), (0.0, 0.2, -1.0), fov_y_deg=50.0)
    bare, veiled = (draw(make_scene([*parts, *front], camera=camera), small_ember, (camera,))[-1]["reflection"]
                    for front in ((), (veil,)))
    reflecting = slice(52, 68), slice(8, 88)
    assert bare[reflecting].min() > 0.03
    np.testing.assert_allclose(veiled[reflecting], 0.5 * bare[reflecting], rtol=0.02)


def test_gaps_between_metal_boxes_are_not_as_wide_as_texels(small_ember: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In motion too, light of the grid is interpolated between texels of one surface only."""
    size = (192, 144)
    steel = replace(ROUGH_METAL, roughness=0.3)
    stack = [box((-0.6, 0.4 + 0.2 * i, -0.9), (1.2, 0.17, 0.5), steel) for i in range(5)]
    cameras = [replace(CAMERA, eye=(0.5 + 0.002 * i, 1.1, 0.7)) for i in range(8)]

    def seen() -> Image:
        image = draw(room(WHITE, *stack), small_ember, cameras, size)[-1]["reflection"]
        return np.maximum(image[50:100, 30:100].mean(axis=-1), 1e-4)

    fine = seen()
    coarsen(monkeypatch, size)
    wrong = float((np.abs(np.log(seen() / fine)) > 0.3).mean())
    print(f"GAPS {wrong:.3f}")
    assert wrong < 0.015


@pytest.mark.parametrize(("rays", "board", "left"), [
    ("cpu", BLUE, 0.0), ("gpu", BLUE, 0.0), ("cpu", replace(BLUE, is_blended=True, alpha=0.5), 0.5),
    ("cpu", Material("black", albedo=(0.0, 0.0, 0.0), is_back_culled=True), 0.0)])
def test_a_mirror_shows_a_board_that_the_eye_sees_edge_on(rays: str, board: Material, left: float, small_ember: Path,
                                                          monkeypatch: pytest.MonkeyPatch) -> None:
    """Not the wall behind it, which the picture shows where the marched ray ends after a step over the board."""
    size = (192, 144)
    coarsen(monkeypatch, size)
    camera = Camera((-0.8, 1.0, 0.9), (0.6, 1.0, -1.0), fov_y_deg=50.0)
    angle, middle = np.radians(36), np.array([0.65, 0.0, -0.75])
    along, normal = np.array([[np.sin(angle), 0, -np.cos(angle)], [np.cos(angle), 0, np.sin(angle)]])
    mirror = quad((0.97, 0, 1), (0, 0, -2), (0, 2, 0), MIRROR)
    settings = Settings(size=size, outputs=("reflection", "position"), rays=rays, provider="cpu")
    seen = []
    for boards in ([], [quad(middle - 0.15 * along, 0.3 * along, (0, 2, 0), board)]):
        with Renderer(room(WHITE, mirror, *boards), settings, small_ember) as renderer:
            images = [renderer.render(camera) for _ in range(24)][-1]
        seen.append(images["reflection"][..., 0])
    position = images["position"][..., :3]
    mirrored = (position - camera.eye) * (-1, 1, 1)
    distance = (middle - position) @ normal / (mirrored @ normal)
    end = position + distance[..., None] * mirrored
    on_board = ((np.abs(position[..., 0] - 0.97) < 1e-3) & (distance > 0) & (np.abs((end - middle) @ along) < 0.13)
                & (end[..., 1] > 0.1) & (end[..., 1] < 1.9))
    share = float(seen[1][on_board].mean() / seen[0][on_board].mean())
    print(f"BOARD {on_board.sum()} pixels show {share:.3f} of the wall")
    assert on_board.sum() > 1000
    assert share == pytest.approx(left, abs=0.08)


def test_a_polished_shelf_has_no_bright_dashes_along_its_underside(small_ember: Path,
                                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    """Its front shows a bright wall; the underside, less than a pixel of it, a dark one at a grazing angle."""
    size = (192, 144)
    coarsen(monkeypatch, size)
    polished = Material("polished", albedo=(0.02,) * 3, specular=(0.04,) * 3, roughness=0.08)
    shelf = box((-0.8, 1.1, -0.7), (1.6, 0.08, 0.3), polished)
    camera = Camera((0.0, 1.08, 0.5), (0.0, 1.08, -1.0), fov_y_deg=40.0)
    image = draw(room(DARK, shelf), small_ember, (camera,) * 17, size)[-1]["final"].mean(axis=-1)
    front, underside = image[60:66, 30:-30], image[66:78, 30:-30]
    brightest = float(underside.max() / np.median(front[:3]))
    print(f"SHELF {brightest:.2f} of its front")
    assert brightest < 1.5


def test_facets_of_smooth_shaded_metal_hide_nothing(small_ember: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rays from a low-poly bowl that its next facet blocks at once would be dark dots."""
    size = (192, 144)
    coarsen(monkeypatch, size)
    ball = sphere((0.0, 1.0, -0.6), 0.8, 10, replace(MIRROR, roughness=0.05))
    half = ball.triangles[ball.triangles.mean(axis=1)[:, 2] < -0.7][:, ::-1]
    scene = room(WHITE, replace(ball, triangles=half))
    bowl = scene.meshes[-1]
    inwards = np.array([0.0, 1.0, -0.6]) - bowl.positions
    smooth = replace(bowl, normals=(inwards / np.linalg.norm(inwards, axis=1, keepdims=True)).astype(np.float32))
    scene = replace(scene, meshes=(*scene.meshes[:-1], smooth))
    camera = Camera((0.2, 1.2, 0.95), (0.0, 1.0, -1.0), fov_y_deg=60.0)

    def seen() -> Image:
        return draw(scene, small_ember, (camera,) * 24, size)[-1]["reflection"].mean(axis=-1)

    shown = seen()
    monkeypatch.setattr(reflection_rays, "_hidden", lambda *_: np.zeros(0, np.int64))
    darker = int((shown < 0.95 * seen()).sum())
    print(f"BOWL {darker} pixels are darker")
    assert darker < 30


@pytest.mark.parametrize("is_turned", [False, True])
@pytest.mark.parametrize("moves", ["the camera", "an object"])
def test_a_mirror_stays_sharp_in_motion(moves: str, is_turned: bool, small_ember: Path,
                                        monkeypatch: pytest.MonkeyPatch) -> None:
    """It shows strips of 5 pixels before a wall behind the camera; the grid, of texels of 4, would show one grey.

    What it has shown in motion is gone soon after.
    """
    size = (256, 192)
    coarsen(monkeypatch, size)
    turn = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]]) if is_turned else np.eye(4)
    strips = [quad((0.96 - 0.16 * i, 0.0, 0.9), (-0.08, 0, 0), (0, 2, 0), BLACK) for i in range(12)]
    path_of_box = np.stack([np.eye(4), translation(turn[:3, :3] @ (0.2, 0.0, 0.0))])
    mover = box((-0.9, 0.0, -0.9), (0.1, 0.1, 0.1), DARK, Motion(np.array([0.0, 1.0]), path_of_box))
    scene = room(MIRROR, *strips, *([mover] if moves == "an object" else []))
    scene = replace(scene, instances=tuple(replace(i, transform=turn) for i in scene.instances),
                    lights=(replace(LAMP, position=tuple((turn[:3, :3] @ LAMP.position).tolist())),))

    def turned(eye_x: float) -> Camera:
        eye, target = (tuple((turn[:3, :3] @ at).tolist()) for at in ((eye_x, *CAMERA.eye[1:]), CAMERA.target))
        return replace(CAMERA, eye=eye, target=target)

    path = [turned(0.01 * i * (moves == "the camera")) for i in range(20)]
    settings = Settings(size=size, outputs=("reflection",), provider="cpu")

    def frame(renderer: Renderer, camera: Camera, time: float) -> Image:
        return renderer.render(camera, time)["reflection"][70:120, 96:160].mean(axis=-1)

    with Renderer(scene, settings, small_ember) as renderer:
        moving = [frame(renderer, camera, 0.04 * i) for i, camera in enumerate(path)][-1]
        stopped = [frame(renderer, path[-1], 0.04 * 19) for _ in range(48)][-1]
    with Renderer(scene, settings, small_ember) as renderer:
        still = [frame(renderer, path[-1], 0.04 * 19) for _ in range(96)][-1]
    contrast = np.abs(np.diff(moving)).mean() / np.abs(np.diff(still)).mean()
    error, left = (np.sqrt(((image - still) ** 2).mean()) / still.std() for image in (moving, stopped))
    print(f"MOVING contrast {contrast:.3f}, error {error:.3f}, {left:.3f} after 48 frames at rest")
    assert contrast > 0.7
    assert error < 0.6
    assert left < 0.2


def test_what_is_thinner_than_a_texel_has_a_ray_in_each_frame_at_rest(small_ember: Path,
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    """Not only in those in which the ray of its texel happens to start there."""
    coarsen(monkeypatch)
    bars = [rod((0.1 * i - 0.4, 0.0, -0.6), 0.01, 2.0, ROUGH_METAL) for i in range(9)]
    settings = Settings(size=SIZE, outputs=("reflection",), provider="cpu")
    with Renderer(room(WHITE, *bars), settings, small_ember) as renderer:
        images = [renderer.render(CAMERA)["reflection"][..., 0] > 0 for _ in range(33)]
        samples = renderer.resource("reflection_detail")[..., 3]
    rays = samples.sum() / np.sum(images)  # 1/16 if each pixel had its turn
    print(f"RAYS {rays:.3f} of a bar's pixel in a frame")
    assert rays > 0.12
