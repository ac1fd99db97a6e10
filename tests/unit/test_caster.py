"""Rays through scenes of a few triangles, against the expected hit points and surface properties."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from app.raycast.caster import AttachedPoints, Caster, Hits
from app.scene import Material, Mesh, Motion, Scene, Texture, Transmission
from tests.deforming import SHAPES, deforming_scene, material_points
from tests.gl.closed_forms import ggx_albedo, ggx_compensation
from tests.gl.scenes import F32, GREY, Part, Point, box, make_scene, moved, quad, slide

WALL = ((-1, -1, 0), (2, 0, 0), (0, 2, 0))  # 2 × 2 around the origin; its front faces +z
FRONT, BACK = (0, 0, 3), (0, 0, -3)


def cast(scene: Scene, origins: Iterable[Point], targets: Iterable[Point], time: float = 0.0) -> Hits:
    """Rays from world-space points to others, with their distance as unit of length; hit positions in world space."""
    caster = Caster(scene)
    caster.move_to(time)
    start, end = (np.array(list(p), np.float64) - caster.origin for p in (origins, targets))
    hits = caster.cast(start.astype(np.float32), (end - start).astype(np.float32))
    return replace(hits, position=hits.position + caster.origin)


def wall(material: Material = GREY, corner: Point = WALL[0], motion: Motion | None = None) -> Part:
    return quad(corner, *WALL[1:], material, motion)


def with_mesh(scene: Scene, index: int = 0, **changes: object) -> Scene:
    meshes = list(scene.meshes)
    meshes[index] = replace(meshes[index], **changes)
    return replace(scene, meshes=tuple(meshes))


def texture(texels: list[list[Point]], **options: object) -> Texture:
    pixels = np.ones((len(texels), len(texels[0]), 4), np.float32)
    pixels[..., :3] = texels
    return Texture(pixels, **options)  # type: ignore[arg-type]


def test_the_nearer_of_two_walls_is_hit_and_misses_are_sky() -> None:
    scene = make_scene([wall(), wall(corner=(-1, -1, -2))])
    hits = cast(scene, [FRONT, BACK, FRONT, FRONT], [(0.5, 0.25, 0), (0, 0, 0), (5, 0, 0), (0, 0, 9)])
    np.testing.assert_allclose(hits.distance, [1, 1 / 3, np.inf, np.inf], rtol=1e-6)
    np.testing.assert_allclose(hits.position[:2], [(0.5, 0.25, 0), (0, 0, -2)], atol=1e-6)
    assert hits.body.tolist() == [0, 0, -1, -1]
    assert not hits.albedo[2:].any() and not hits.normal[2:].any()


def test_normals_face_the_origin_of_the_ray() -> None:
    flat = make_scene([wall()])
    slanted = np.full((6, 3), (0.6, 0, 0.8), np.float32)
    for scene, front in ((flat, (0, 0, 1)), (with_mesh(flat, normals=slanted), (0.6, 0, 0.8))):
        hits = cast(scene, [FRONT, BACK], [(0.1, 0, 0)] * 2)
        np.testing.assert_allclose(hits.normal, [front, np.negative(front)], atol=1e-6)


def test_normals_of_a_stretched_instance_are_perpendicular_to_it() -> None:
    roof = quad((0, 0, 0), (1, 1, 0), (0, 0, -1))
    stretched = replace(roof, place=np.diag([3.0, 1, 1, 1]))
    normals = np.full((6, 3), (-(0.5**0.5), 0.5**0.5, 0), np.float32)
    hits = cast(with_mesh(make_scene([stretched]), normals=normals), [(1.5, 4, -0.5)], [(1.5, 0.5, -0.5)])
    np.testing.assert_allclose(hits.normal[0], np.array([-1, 3, 0]) / 10**0.5, atol=1e-6)


def test_albedo_is_material_times_texture_times_vertex_colour() -> None:
    stripes = texture([[(1, 0.5, 0), (0, 0.5, 1)]])
    scene = make_scene([wall(replace(GREY, albedo_map=stripes))])
    colors = np.full((6, 4), (0.5, 1, 1, 1), np.float32)
    hits = cast(with_mesh(scene, colors=colors), [FRONT] * 2, [(-0.5, 0, 0), (0.5, 0, 0)])
    np.testing.assert_allclose(hits.albedo, [(0.25, 0.25, 0), (0, 0.25, 0.5)], atol=1e-6)


def ggx_reflectance(f0: float, roughness: float, n_v: float) -> float:
    """Share of light from everywhere that GGX with Schlick's law reflects, once or more often."""
    once, grazing = (ggx_albedo(roughness**2, n_v, schlick) for schlick in (False, True))
    return float((f0 * once + (1 - f0) * grazing) * ggx_compensation(f0, roughness**2, n_v))


def test_metals_reflect_their_specular_albedo() -> None:
    """The metallic factor is multiplied by the blue channel of its map, whose bytes are linear."""
    blue = np.zeros((1, 2, 4), np.uint8)
    blue[0, :, 1:3] = (128, 51), (128, 204)
    metal = replace(GREY, metallic=0.5, roughness=0.5)
    mapped = replace(metal, metallic=1.0, roughness=1.0, metallic_roughness_map=Texture(blue, is_color=False))
    for material, albedo in ((metal, (0.25, 0.25)), (mapped, (0.4, 0.1))):
        hits = cast(make_scene([wall(material)]), [FRONT] * 2, [(-0.5, 0, 0), (0.5, 0, 0)])
        expected = [diffuse + ggx_reflectance(0.5 - diffuse, 0.5, 2 / 3) for diffuse in albedo]
        np.testing.assert_allclose(hits.albedo[:, 0], expected, rtol=0.01)


def test_grazing_rays_do_not_brighten_a_floor() -> None:
    """What arrives from above does not leave along the floor, as it would by the specular albedo of a grazing ray."""
    floor = Material(albedo=(0.2,) * 3, specular=(0.04,) * 3, roughness=0.1)
    origins = [FRONT, tuple(np.add(FRONT, (60.0, 0.0, 0.0)))]
    above, grazing = cast(make_scene([wall(floor)]), origins, [(0.0, 0.0, 0.0)] * 2).albedo
    np.testing.assert_allclose(grazing, above)
    np.testing.assert_allclose(above, 0.2 + ggx_reflectance(0.04, 0.1, 2 / 3), rtol=0.01)


@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_no_surface_reflects_more_than_arrives(roughness: float) -> None:
    """White, diffuse and specular, and a white metal, which reflects all, from the normal to a grazing angle."""
    origins = [(2 * np.tan(np.radians(degrees)), 0.0, 0.0) for degrees in (0, 30, 60, 80, 89)]
    for material in (Material(albedo=(1.0,) * 3, specular=(0.04,) * 3, roughness=roughness),
                     Material(albedo=(1.0,) * 3, specular=(0.5,) * 3, roughness=roughness),
                     Material(albedo=(1.0,) * 3, metallic=1.0, roughness=roughness)):
        hits = cast(make_scene([wall(material)]), [np.add(FRONT, at) for at in origins], [(0.0, 0.0, 0.0)] * 5)
        assert (hits.body >= 0).all()
        np.testing.assert_allclose(hits.albedo, 1.0, atol=1e-4)


def test_a_specular_map_colours_what_rays_see() -> None:
    polished = Material(albedo=(0.0,) * 3, specular=(0.5,) * 3, specular_map=texture([[(1, 0.5, 0), (0, 0.5, 1)]]))
    hits = cast(make_scene([wall(polished)]), [FRONT] * 2, [(-0.5, 0, 0), (0.5, 0, 0)])
    assert hits.albedo[0, 0] > hits.albedo[0, 1] > hits.albedo[0, 2] >= 0
    np.testing.assert_allclose(hits.albedo[0], hits.albedo[1, ::-1], rtol=1e-5)


def test_maps_of_the_second_uv_set() -> None:
    stripes = texture([[(1, 0.5, 0), (0, 0.5, 1)]], uv_set=1)
    glow = replace(GREY, emission=(1.0,) * 3, emission_map=stripes)
    scene = make_scene([wall(glow), wall(corner=(-1, -1, -2))])
    assert scene.meshes[0].uvs is not None
    turned = with_mesh(scene, second_uvs=scene.meshes[0].uvs[:, ::-1])
    hits = cast(turned, [FRONT] * 2, [(0, -0.5, 0), (0, 0.5, 0)])
    np.testing.assert_allclose(hits.emission, [(1, 0.5, 0), (0, 0.5, 1)], atol=1e-6)
    without = cast(scene, [FRONT], [(0, -0.5, 0)])
    np.testing.assert_allclose(without.emission, [(1, 1, 1)])


def test_unlit_surfaces_neither_reflect_nor_emit() -> None:
    hits = cast(make_scene([wall(replace(GREY, is_unlit=True))]), [FRONT], [(0.1, 0, 0)])
    assert hits.body[0] == 0 and not hits.albedo.any() and not hits.emission.any()


def test_vertex_colours_are_interpolated() -> None:
    scene = make_scene([wall()])
    across = (scene.meshes[0].positions[:, :1] + 1) / 2
    colors = np.concatenate([np.repeat(across, 3, 1), np.ones((6, 1))], 1).astype(np.float32)
    hits = cast(with_mesh(scene, colors=colors), [FRONT] * 3, [(-0.5, 0, 0), (0, 0.5, 0), (0.8, 0.1, 0)])
    np.testing.assert_allclose(hits.albedo[:, 0], 0.5 * np.array([0.25, 0.5, 0.9]), atol=1e-6)


def test_rays_pass_through_cut_out_texels() -> None:
    half = texture([[(1, 1, 1), (1, 1, 1)]])
    half.pixels[:, 0, 3] = 0.25
    masked = replace(GREY, albedo=(0.9,) * 3, alpha_cutoff=0.5, albedo_map=half)
    fences = [wall(masked, (-1, -1, z)) for z in (0.5, 1.0, 1.5)]
    hits = cast(make_scene([wall(), *fences]), [FRONT, FRONT], [(-0.3, 0, 0), (0.3, 0, 0)])
    np.testing.assert_allclose(hits.distance, [1, 0.5], rtol=1e-5)
    np.testing.assert_allclose(hits.albedo[:, 0], [0.5, 0.9], rtol=1e-6)
    assert cast(make_scene([wall(replace(masked, alpha=0.4))]), [FRONT], [(0.3, 0, 0)]).body[0] == -1
    assert cast(make_scene([wall(replace(masked, alpha_cutoff=None))]), [FRONT], [(-0.3, 0, 0)]).body[0] == 0


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("moves", [False, True])
def test_a_single_sided_emitter_emits_to_its_front_only(mirror: bool, moves: bool) -> None:
    place = np.diag([-1.0 if mirror else 1.0, 1, 1, 1])
    motion = slide((0.0, 1.0), [(0, 0, 0), (0, 0, 1e-9)]) if moves else None
    for both in (False, True):
        lamp = Material(emission=(2.0, 1.0, 0.5), double_sided=both)
        scene = make_scene([replace(wall(lamp, motion=motion), place=place)])
        hits = cast(scene, [FRONT, BACK], [(0.1, 0, 0)] * 2)
        np.testing.assert_allclose(hits.emission, [(2, 1, 0.5), (2, 1, 0.5) if both else (0, 0, 0)])
        np.testing.assert_allclose(hits.normal, [(0, 0, 1), (0, 0, -1)], atol=1e-6)


def test_emission_is_multiplied_by_its_texture() -> None:
    lamp = Material(emission=(4.0,) * 3, emission_map=texture([[(1, 0, 0)], [(0, 0.5, 0)]]))
    hits = cast(make_scene([wall(lamp)]), [FRONT] * 2, [(0, 0.5, 0), (0, -0.5, 0)])
    np.testing.assert_allclose(hits.emission, [(4, 0, 0), (0, 2, 0)])


def test_rays_need_not_find_the_emission_of_light_proxies() -> None:
    lamp = Material(albedo=(0.5,) * 3, emission=(9.0,) * 3, is_light_proxy=True)
    scene = make_scene([wall(), wall(lamp, (-1, -1, 1))])
    hits = cast(scene, [FRONT, BACK], [(0, 0, 0)] * 2)
    assert hits.is_light_proxy.tolist() == [True, False]
    np.testing.assert_array_equal(hits.albedo[0], 0.5)
    np.testing.assert_array_equal(hits.emission, [(9, 9, 9), (0, 0, 0)])
    assert not hits.traced_emission.any()


def test_a_moving_body_is_hit_where_it_is() -> None:
    slab = box((-0.5, -0.5, -0.1), (1, 1, 0.2), replace(GREY, albedo=(0.1, 0.2, 0.3)),
               slide((0.0, 1.0), [(-4, 0, 1), (4, 0, 1)]))
    scene = make_scene([quad((-5, -1, 0), (10, 0, 0), (0, 2, 0)), slab])
    origins, targets = [(-4, 0, 3), (0, 0, 3), (4, 0, 3)], [(-4, 0, 0), (0, 0, 0), (4, 0, 0)]
    for time, where in ((0.0, 0), (0.5, 1), (1.0, 2)):
        hits = cast(scene, origins, targets, time)
        assert hits.body.tolist() == [int(i == where) for i in range(3)]
        np.testing.assert_allclose(hits.position[:, 2], [1.1 if i == where else 0 for i in range(3)], atol=1e-6)
        np.testing.assert_allclose(hits.albedo[where], (0.1, 0.2, 0.3))
        np.testing.assert_allclose(hits.normal, [(0, 0, 1)] * 3, atol=1e-6)


def test_normals_rotate_with_a_rotated_and_scaled_body() -> None:
    quarter = np.array([[0, 0, 2, 0], [0, 2, 0, 0], [-2, 0, 0, 0], [0, 0, 0, 1.0]])  # +z to +x, twice as large
    scene = make_scene([wall(motion=Motion(np.array([0.0, 1.0]), np.stack([np.eye(4), quarter])))])
    hits = cast(scene, [(3, 1.5, 1.5), (-3, 0, 0)], [(0, 1.5, 1.5), (0, 0, 0)], 1.0)
    np.testing.assert_allclose(hits.distance, [1, 1], rtol=1e-6)
    np.testing.assert_allclose(hits.normal, [(1, 0, 0), (-1, 0, 0)], atol=1e-6)


def test_a_body_scaled_to_nothing_is_never_hit() -> None:
    gone = Motion(np.array([0.0, 1.0]), np.stack([np.diag([0.0, 0, 0, 1]), np.eye(4)]))
    scene = make_scene([wall(), wall(corner=(-1, -1, 1), motion=gone)])
    assert cast(scene, [FRONT], [(0, 0, 0)], 0.0).distance[0] == pytest.approx(1)
    assert cast(scene, [FRONT], [(0, 0, 0)], 1.0).distance[0] == pytest.approx(2 / 3)


def test_a_scene_far_from_the_origin_is_hit_alike() -> None:
    near = make_scene([wall(), box((-0.4, -0.4, 0.2), (0.8, 0.8, 0.5), motion=slide((0.0, 1.0), [(0, 0, 0)] * 2))])
    offset = (1e6, -2e6, 3e6)
    rng = np.random.default_rng(0)
    targets = rng.uniform(-0.9, 0.9, (100, 3)) * (1, 1, 0)
    origins = targets + np.array((0.3, 0.1, 2.0))
    here = cast(near, origins, targets)
    there = cast(moved(near, offset), origins + offset, targets + offset)
    assert (here.body == there.body).all() and set(here.body) == {0, 1}
    np.testing.assert_allclose(there.distance, here.distance, rtol=1e-5)


def test_triangles_with_non_finite_corners_are_dropped() -> None:
    corners = np.array([[(-1, -1, 0), (1, -1, 0), (0, 1, 0)],        # valid
                        [(np.nan, -1, 1), (1, -1, 1), (0, 1, 1)],    # not a number
                        [(-1, -1, 1), (np.inf, -1, 1), (0, 1, 1)],   # infinite
                        [(-1, 0, 1), (0, 0, 1), (1, 0, 1)],          # a line
                        [(0, 0, 2), (0, 0, 2), (0, 0, 2)]], float)   # a point
    hits = cast(make_scene([Part(corners)]), [FRONT] * 2, [(0.05, -0.1, 0), (0, 0, 0)])
    np.testing.assert_allclose(hits.distance, 1, rtol=1e-5)
    np.testing.assert_allclose(hits.normal, [(0, 0, 1)] * 2, atol=1e-6)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 3e38])
def test_broken_normals_colours_and_uvs_give_finite_hits(bad: float) -> None:
    checks = texture([[(1, 1, 1), (0, 0, 0)]], repeat=(False, False))
    scene = make_scene([wall(replace(GREY, albedo_map=checks))])
    rows = np.full((6, 4), bad, np.float32)
    broken = with_mesh(scene, normals=rows[:, :3], uvs=rows[:, :2], colors=rows)
    with np.errstate(over="raise", invalid="raise"):
        hits = cast(broken, [FRONT] * 2, [(0.3, 0, 0)] * 2)
    assert np.isfinite(hits.albedo).all() and (hits.albedo >= 0).all() and (hits.albedo <= 1).all()
    np.testing.assert_allclose(np.linalg.norm(hits.normal, axis=1), 1, rtol=1e-5)
    assert (hits.normal[:, 2] >= 0).all()


def test_an_empty_scene_and_one_of_a_single_triangle() -> None:
    empty = replace(make_scene([wall()]), meshes=(), instances=(), materials=(), bounds=np.zeros((2, 3)))
    hits = cast(empty, [FRONT], [(0, 0, 0)])
    assert hits.body[0] == -1 and np.isinf(hits.distance[0])
    bare = Mesh("bare", np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32))
    scene = make_scene([wall()])
    none = replace(scene, meshes=(*scene.meshes, bare), instances=(replace(scene.instances[0], mesh=1),))
    assert cast(none, [FRONT], [(0, 0, 0)]).body[0] == -1
    one = make_scene([Part(np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]], float))])
    hits = cast(one, [(0.2, 0.2, 1), (0.8, 0.8, 1)], [(0.2, 0.2, 0), (0.8, 0.8, 0)])
    assert hits.body.tolist() == [0, -1]


def test_no_rays_give_no_hits() -> None:
    none: F32 = np.zeros((0, 3), np.float32)
    assert len(Caster(make_scene([wall()])).cast(none, none).body) == 0


def test_rays_end_at_t_max() -> None:
    caster = Caster(make_scene([wall()]))
    origins, along = (np.array([v] * 2, np.float32) for v in (FRONT, (0, 0, -1)))
    hits = caster.cast(origins, along, t_max=np.array([2.9, 3.1], np.float32))
    assert hits.body.tolist() == [-1, 0]


def test_a_mesh_without_texture_coordinates_shows_no_texture() -> None:
    material = Material(albedo=(0.5, 0.6, 0.7), albedo_map=texture([[(0.1, 0.1, 0.1)]]))
    hits = cast(with_mesh(make_scene([wall(material)]), uvs=None), [FRONT], [(0, 0, 0)])
    np.testing.assert_allclose(hits.albedo, [(0.5, 0.6, 0.7)], rtol=1e-6)


def test_a_sheared_body_is_hit_up_to_its_corners() -> None:
    """A rotated square that its motion stretches along x: no column of its matrix is as long as its diagonal."""
    rotation = np.eye(4)
    rotation[:2, :2] = np.array([[1, -1], [1, 1]]) / np.sqrt(2)
    stretch = Motion(np.array([0.0, 1.0]), np.stack([np.eye(4), np.diag([5.0, 1, 1, 1])]))
    scene = make_scene([wall(motion=stretch)])
    scene = replace(scene, instances=tuple(replace(i, transform=rotation @ i.transform) for i in scene.instances))
    ends = [(x, 0.0, 0.0) for x in (-7.0, 0.0, 7.0)]
    assert (cast(scene, [(x, 0, 3) for x, _, _ in ends], ends, time=1.0).body == 1).all()


@pytest.mark.parametrize("time", [0.0, 1.0])
def test_rays_are_occluded_where_they_meet_something(time: float) -> None:
    """The same as the nearest hits say, for static, moving and alpha-tested bodies."""
    holes = texture([[(1.0,) * 3] * 2] * 2)
    pixels = holes.pixels.copy()
    pixels[::2, ::2, 3] = 0.0
    veil = Material(albedo_map=replace(holes, pixels=pixels), alpha_cutoff=0.5)
    scene = make_scene([wall(), wall(veil, (-1, -1, 1)),
                        box((-0.2, -0.2, 1.5), (0.4,) * 3, motion=slide([0, 1], [(0, 0, 0), (0.5, 0, 0)]))])
    caster = Caster(scene)
    caster.move_to(time)
    rng = np.random.default_rng(0)
    origins, ends = (rng.uniform((-1.2, -1.2, low), (1.2, 1.2, high), (4000, 3)) - caster.origin
                     for low, high in ((2.2, 3.0), (-1.0, 1.4)))
    rays = origins.astype(np.float32), (ends - origins).astype(np.float32)
    expected = caster.cast(*rays, t_max=np.ones(4000, np.float32)).body >= 0
    np.testing.assert_array_equal(caster.is_occluded(*rays, proxies_block=True), expected)
    assert 0.1 < expected.mean() < 0.9


@pytest.mark.parametrize("behind", [GREY, Material(albedo_map=texture([[(1.0,) * 3]]), alpha_cutoff=0.5)])
def test_light_proxies_block_only_if_asked(behind: Material) -> None:
    proxy = Material(is_light_proxy=True)
    for parts, blocked in (([wall(proxy)], False), ([wall(proxy, (-1, -1, 1)), wall(behind)], True),
                           ([wall(proxy), wall(behind, (-1, -1, 1))], True)):
        caster = Caster(make_scene(parts))
        origin = (np.array([FRONT], np.float64) - caster.origin).astype(np.float32)
        ray = origin, np.array([(0, 0, -6)], np.float32)
        assert caster.is_occluded(*ray, proxies_block=True).all()
        assert caster.is_occluded(*ray, proxies_block=False).tolist() == [blocked]


@pytest.mark.parametrize("is_outline", [False, True])
def test_rays_pass_culled_backs_and_light_those_of_outlines(is_outline: bool) -> None:
    """Also those of an instance that its placement mirrors; both stop at fronts."""
    lid = replace(GREY, albedo=(0.01,) * 3, is_back_culled=True) if is_outline else replace(GREY, is_back_culled=True)
    for mirrored in (False, True):
        part = replace(wall(lid), place=np.diag([-1.0 if mirrored else 1.0, 1, 1, 1]))
        behind = wall(corner=(-1, -1, -1))
        caster = Caster(make_scene([part, behind, wall(corner=(-1, -1, 1))]))
        origins, ends = (np.array(p, np.float64) - caster.origin for p in (
            [(0.1, 0, 0.5), (0.1, 0, -0.5)], [(0.1, 0, -0.5), (0.1, 0, 0.5)]))
        rays = origins.astype(np.float32), (ends - origins).astype(np.float32)
        # Light comes from the ends.
        assert caster.is_occluded(*rays, proxies_block=True).tolist() == [not is_outline, True]
        np.testing.assert_allclose(caster.cast(*rays).distance, [0.5, 1.5], rtol=1e-3)


@pytest.mark.parametrize(("metal", "factor", "share"), [(0.0, 1.0, 1.0), (1.0, 1.0, 0.0), (0.25, 0.5, 0.375)])
def test_rays_pass_glass_as_its_maps_say(metal: float, factor: float, share: float) -> None:
    """A factor of 1 for metallic and transmission, times texels."""
    glass = Material(albedo=(1.0,) * 3, metallic=1.0, transmission=Transmission(
        1.0, texture([[(factor, 0.0, 0.0)]], is_color=False)),
        metallic_roughness_map=texture([[(0.0, 0.0, metal)]], is_color=False))
    caster = Caster(make_scene([wall(glass)]))
    rng = np.random.default_rng(0)
    origins = np.column_stack([rng.uniform(-0.9, 0.9, (4000, 2)), np.full(4000, 1.0)]).astype(np.float32)
    vectors = np.tile(np.array([0, 0, -2], np.float32), (4000, 1))
    passed = ~caster.is_occluded((origins - caster.origin).astype(np.float32), vectors, proxies_block=True)
    assert passed.mean() == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("factor", [0.5, 1.0])
def test_glass_sends_back_what_it_does_not_let_through(factor: float, metallic: float) -> None:
    """The rays that don't pass it carry what it reflects: less than all light, and little of clear glass."""
    glass = Material(albedo=(0.9,) * 3, specular=(0.04,) * 3, roughness=0.5, metallic=metallic,
                     emission=(1.0,) * 3, transmission=Transmission(factor))
    opaque = replace(glass, transmission=None)
    origins, vectors = np.tile([(0.3, 0.2, 1.0)], (4000, 1)), np.tile([(0.0, 0.0, -2.0)], (4000, 1))
    origins[:, :2] += np.random.default_rng(0).uniform(-0.5, 0.5, (4000, 2))
    sent_back, emitted = {}, {}
    for material in (glass, opaque):
        caster = Caster(make_scene([wall(material)]))
        hits = caster.cast((origins - caster.origin).astype(np.float32), vectors.astype(np.float32))
        sent_back[material] = hits.albedo[:, 0].sum() / len(origins)
        emitted[material] = hits.emission[:, 0].sum() / len(origins)
    diffuse = 0.9 * (1 - metallic)
    assert sent_back[glass] == pytest.approx(sent_back[opaque] - factor * diffuse, abs=0.03)
    assert emitted[glass] == pytest.approx(emitted[opaque], rel=0.3)  # few rays meet clear glass


def test_what_a_ray_passes_counts_as_much_as_it_is_seen() -> None:
    """From the nearest on, also on different bodies; not what is behind the end. One stands for all of a ray."""
    veil = Material(albedo=(0.2,) * 3, is_blended=True, alpha=0.25)
    glass = Material(albedo=(0.25, 0.64, 0.81), transmission=Transmission(1.0))
    moving = wall(veil, (-1, -1, 1), slide((0, 1), ((0, 0, 0), (1, 0, 0))))
    scene = make_scene([wall(glass), moving, wall(corner=(-1, -1, -1)), wall(veil, (-1, -1, -2))])
    caster = Caster(scene)
    count, tint = 4000, np.array([0.25, 0.64, 0.81])
    start = np.concatenate([np.random.default_rng(0).uniform(-0.9, 0.9, (count, 2)), np.full((count, 1), 3.0)], axis=1)
    origins = (np.concatenate([start, [(0.1, 0.2, -1.5), (5.0, 0.0, 0.5)]]) - caster.origin).astype(np.float32)
    seen = caster.cast_through(origins, np.array([(0, 0, -1)] * (count + 1) + [(-1, 0, 0)], np.float32))
    np.testing.assert_allclose(seen.hits.distance[:count + 2], [4.0] * count + [np.inf] * 2, rtol=1e-4)
    np.testing.assert_allclose(seen.share[:count], np.tile(0.75 * tint, (count, 1)), rtol=1e-4)
    np.testing.assert_allclose(seen.share[count:count + 2], [[0.75] * 3, [1.0] * 3], rtol=1e-4)
    assert seen.ray.tolist() == [*range(count + 2), *range(count + 1)]
    passed, share = seen.hits.distance[count + 2:-1], seen.share[count + 2:-1]
    of_veil, of_glass = 0.25, 0.75 * (1 - tint.mean())
    np.testing.assert_allclose(share, of_veil + of_glass, rtol=1e-4)
    for distance, expected in ((2, of_veil), (3, of_glass)):
        at = np.isclose(passed, distance, rtol=1e-3)
        assert share[at, 0].sum() / count == pytest.approx(expected, abs=0.02)
    np.testing.assert_allclose(seen.hits.albedo[count + 2:-1][passed < 2.5], 0.2, rtol=1e-5)
    np.testing.assert_allclose((seen.hits.distance[-1], *seen.share[-1]), (0.5, 0.25, 0.25, 0.25), rtol=1e-3)


def test_textures_are_averaged_over_a_ray_s_width() -> None:
    """On a wall of edge 2 with 64 stripes, and on others that are scaled, mirrored, or scaled along the ray."""
    stripes = Texture(np.tile(np.where(np.arange(64) % 2, 1.0, 0.0)[None, :, None], (64, 1, 4)).astype(np.float32))
    material = Material(albedo=(1.0, 1.0, 1.0), albedo_map=stripes, emission=(1.0, 1.0, 1.0), emission_map=stripes)
    for scale, along in ((1.0, 1.0), (4.0, 4.0), (-1.0, 1.0), (1.0, 0.02), (1.0, 50.0)):
        motion = Motion(np.array([0.0]), np.diag((scale, abs(scale), along, 1.0))[None])
        scale = abs(scale)
        caster = Caster(make_scene([wall(material, motion=None if scale == along == 1.0 else motion)]))
        x = np.linspace(-0.9, 0.9, 100) * scale
        origins = (np.stack([x, 0 * x, 0 * x + 2], axis=1) - caster.origin).astype(np.float32)
        towards = np.tile(np.float32((0, 0, -1)), (100, 1))
        for beam, striped in (((0.0, 0.0), True), ((scale / 32, 0.0), True), ((scale / 8, 0.0), False),
                              ((0.0, scale / 16), False)):
            hits = caster.cast_through(origins, towards, np.tile(np.float32(beam), (100, 1))).hits
            assert (hits.albedo[:, 0].std() > 0.25) if striped else (hits.albedo[:, 0].std() < 0.01), (scale, beam)
            np.testing.assert_allclose(hits.emission, hits.albedo, atol=1e-3)
            np.testing.assert_allclose(hits.albedo.mean(), 0.5, atol=0.06)


def test_a_ray_that_starts_on_a_light_proxy_gets_past_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a masked surface, where rays go on step by step; without steps of a least length it would never end."""
    masked = Material(albedo_map=texture([[(1.0,) * 3]]), alpha_cutoff=0.5)
    caster = Caster(make_scene([wall(Material(is_light_proxy=True)), wall(masked, (9, 9, 9))]))
    casts, body = [], caster.bodies[0]
    monkeypatch.setattr(body, "cast", lambda *a, cast=body.cast: (casts.append(1), cast(*a))[1])
    origin = (np.array([(0.0, 0.0, 1e-7)]) - caster.origin).astype(np.float32)
    assert not caster.is_occluded(origin, np.array([(0, 0, -1)], np.float32), proxies_block=False).any()
    assert len(casts) <= 3


@pytest.mark.parametrize("kind", ["skin", "morph"])
def test_rays_meet_a_deformed_surface(kind: str) -> None:
    """The same hits as in a still scene in that shape, also back at another time."""
    scene = deforming_scene(kind, [wall(corner=(-1, -1, -3))])
    rng = np.random.default_rng(0)
    starts = rng.uniform([-1, 0, 2], [1, 2, 3], (400, 3))
    ends = rng.uniform([-1, 0, -0.5], [0.5, 2, 0.5], (400, 3))
    for time in (0.7, 0.2):
        shape = SHAPES[kind](scene.positions, time)
        moving, still = (cast(s, starts, ends, time) for s in (scene.scene, scene.still(shape)))
        assert (still.albedo[:, 0] > 0.7).sum() > 40
        same = np.isclose(moving.albedo, still.albedo, atol=1e-5).all(axis=1)
        assert same.mean() > 0.99
        np.testing.assert_allclose(moving.distance[same], still.distance[same], rtol=1e-4)
        np.testing.assert_allclose(moving.normal[same], still.normal[same], atol=2e-3)


def test_the_revision_changes_when_a_body_deforms() -> None:
    caster = Caster(deforming_scene("skin", []).scene)
    before = caster.revision
    caster.move_to(0.0)
    assert caster.revision == before
    caster.move_to(0.5)
    assert caster.revision > before


@pytest.mark.parametrize("kind", ["skin", "morph"])
def test_attached_points_follow_a_deformed_surface(kind: str) -> None:
    """Each stays where it is on its triangle, and its normal turns with it."""
    scene = deforming_scene(kind, [])
    caster = Caster(scene.scene)
    caster.move_to(0.1)
    rng = np.random.default_rng(0)
    targets = rng.uniform([-0.14, 0.05, 0], [0.14, 1.9, 0], (200, 3))
    start = (targets + np.array([0, 0, 3]) - caster.origin).astype(np.float32)
    hits = caster.cast(start, np.tile(np.array([0, 0, -4], np.float32), (200, 1)))
    hits = hits.select(hits.body == 1)
    assert len(hits.body) > 100
    points = AttachedPoints(caster, hits.position, hits.normal, hits.anchors)
    np.testing.assert_allclose(points.current()[0], hits.position, atol=1e-6)
    caster.move_to(0.9)
    position, normal = points.current()
    triangles = scene.scene.meshes[0].triangles
    before, now = (SHAPES[kind](scene.positions, time)[triangles] for time in (0.1, 0.9))
    expected, found = material_points(hits.position + caster.origin, before, now)
    assert found.all()
    np.testing.assert_allclose(position + caster.origin, expected, atol=1e-5)
    ray = caster.cast(position + 0.01 * normal, -normal, [1])
    np.testing.assert_allclose(ray.distance, 0.01, atol=1e-4)
    np.testing.assert_allclose(np.abs((ray.normal * normal).sum(axis=1)), 1, atol=1e-3)
    if kind == "morph":
        assert (np.abs(normal[:, 2]) < 0.97).mean() > 0.5
