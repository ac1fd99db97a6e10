"""Small scenes made in code, so that goldens depend on no file and no loader.

Together they take every branch of every shader; the docstring of each says what it contributes.
"""

from dataclasses import replace

import numpy as np

from app.animation.deformation import Deformation, Skin, Vertices
from app.animation.node_tree import NodeTrack, NodeTree
from app.animation.track import Track
from app.arrays import F64, Bytes
from app.math3d import affine_matrix, translation
from app.scene import (
    Camera,
    CameraPath,
    Clearcoat,
    DirectionalLight,
    EmissionImage,
    EmissionPoints,
    Environment,
    Instance,
    Light,
    Material,
    Mesh,
    Motion,
    PointLight,
    RectLight,
    Scene,
    Sheen,
    SpotLight,
    Texture,
    Transmission,
    bounds_of,
)
from app.simple_meshes import ball, block, quads, rotation_about_y

FRAME_SECONDS = 1 / 30
SEQUENCE = 60  # frames of the camera path of ``room``


def room() -> Scene:
    """A box with coloured walls, a sphere light, a moving glossy ball, a rough block and an emissive panel."""
    materials = (Material("white", albedo=(0.75, 0.75, 0.75)),
                 Material("red", albedo=(0.65, 0.06, 0.05)),
                 Material("green", albedo=(0.1, 0.5, 0.12)),
                 Material("glossy", albedo=(0.3, 0.3, 0.35), roughness=0.25, specular=(0.2, 0.2, 0.2)),
                 Material("panel", albedo=(0.1, 0.1, 0.1), emission=(1.5, 2.0, 3.0), double_sided=False))
    meshes = (
        quads("shell", 0, ((-1, -1, -1), (0, 0, 2), (2, 0, 0)), ((-1, 1, -1), (2, 0, 0), (0, 0, 2)),
              ((-1, -1, -1), (2, 0, 0), (0, 2, 0))),
        quads("left", 1, ((-1, -1, -1), (0, 2, 0), (0, 0, 2))),
        quads("right", 2, ((1, -1, -1), (0, 0, 2), (0, 2, 0))),
        block("tall", 3, (0.5, 1.1, 0.5)),
        block("low", 0, (0.5, 0.4, 0.5)),
        ball("ball", 3, 0.22),
        quads("panel", 4, ((0.05, 0.0, -0.98), (0.6, 0, 0), (0, 0.5, 0))),
    )
    transforms = {3: rotation_about_y(0.35, (-0.45, -0.45, -0.35)), 4: rotation_about_y(-0.3, (0.4, -0.8, -0.2)),
                  5: rotation_about_y(0.0, (0.4, -0.38, -0.2))}
    poses = np.stack([rotation_about_y(0.0, at) for at in ((0, 0, 0), (0.1, 0.5, 0.3), (0, 0, 0))])
    motions = {5: Motion(FRAME_SECONDS * np.array([0.0, SEQUENCE / 2, SEQUENCE]), poses)}
    lights = (PointLight((0.1, 0.75, 0.1), (1.4, 1.3, 1.1), radius=0.12),)
    first = Camera((0.0, 0.05, 0.98), (0.0, -0.2, -0.5), fov_y_deg=75.0)
    path = CameraPath((0.0, SEQUENCE * FRAME_SECONDS), (first, replace(first, eye=(0.35, 0.2, 0.75))))
    corner = CameraPath.still(Camera((-0.85, 0.6, 0.8), (0.3, -0.5, -0.4), fov_y_deg=70.0))
    return _scene("room", meshes, transforms, materials, lights, {"path": path, "corner": corner}, motions)


def outdoor() -> Scene:
    """Soft sun, hard spot and a visible rectangle light over coloured ground; a masked card and a moving block."""
    materials = (Material("ground"),
                 Material("card", albedo=(0.9, 0.9, 0.9), albedo_map=Texture(_chequers()), alpha_cutoff=0.5),
                 Material("block", albedo=(0.2, 0.35, 0.7), roughness=0.4, specular=(0.04, 0.04, 0.04)),
                 Material("light panel", emission=(4.0, 3.0, 2.0), is_light_proxy=True))
    edge_u, edge_v = (0.0, 0.6, 0.0), (0.0, 0.0, 0.8)
    meshes = (
        _coloured(quads("ground", 0, ((-4, 0, 4), (8, 0, 0), (0, 0, -8)))),
        quads("card", 1, ((-0.9, 0.0, -0.6), (1.4, 0, 0), (0, 1.4, 0))),
        block("block", 2, (0.5, 0.5, 0.5)),
        quads("light panel", 3, ((-1.9, 0.5, -0.4), edge_u, edge_v)),
    )
    poses = np.stack([np.eye(4), rotation_about_y(0.4, (0.3, 0.1, 0.2))])
    motions = {2: Motion(np.array([0.0, 4 * FRAME_SECONDS]), poses)}
    lights = (
        DirectionalLight((-0.5, -1.0, 0.4), (1.5, 1.4, 1.2), angular_radius_deg=1.5),
        SpotLight((1.6, 2.0, 1.0), (-0.6, -1.0, -0.5), (5.0, 1.0, 4.0), inner_deg=14.0, outer_deg=24.0),
        RectLight((-1.9, 0.8, 0.0), edge_u, edge_v, (4.0, 3.0, 2.0)),
    )
    first = Camera((0.5, 1.1, 3.4), (0.0, 0.45, 0.0), fov_y_deg=45.0)
    path = CameraPath((0.0, 4 * FRAME_SECONDS), (first, replace(first, eye=(0.45, 1.12, 3.4))))
    transforms = {2: rotation_about_y(0.2, (0.9, 0.3, 0.5))}
    return _scene("outdoor", meshes, transforms, materials, lights, {"path": path}, motions)


def dusk() -> Scene:
    """A block under a sky of bands, chequers and a small bright patch; the camera turns, quickly at first."""
    rows, columns = 24, 48
    y, x = np.mgrid[:rows, :columns]
    bands = np.linspace([0.2, 0.4, 1.0], [1.0, 0.7, 0.4], rows)[:, None]
    radiance = np.where(y[..., None] < rows // 2, bands, 0.3) * (0.7 + 0.3 * ((x // 3 + y // 3) % 2))[..., None]
    radiance[7, 21] = (30.0, 25.0, 20.0)
    meshes = (quads("ground", 0, ((-2, 0, 2), (4, 0, 0), (0, 0, -4))), block("block", 1, (0.6, 1.4, 0.6)))
    materials = Material("ground", albedo=(0.6, 0.6, 0.6)), Material("block", albedo=(0.7, 0.3, 0.2))
    first = Camera((0.2, 0.9, 3.2), (-0.4, 1.0, 0.0), fov_y_deg=55.0)
    path = CameraPath((0.0, 2 * FRAME_SECONDS, 6 * FRAME_SECONDS),
                      (first, replace(first, target=(0.1, 1.1, 0.0)), replace(first, target=(0.12, 1.1, 0.0))))
    scene = _scene("dusk", meshes, {1: rotation_about_y(0.4, (0.4, 0.7, -0.3))}, materials, (), {"path": path})
    return replace(scene, environment=Environment(radiance.astype(np.float32), 25.0))


def parallel(scene: Scene, height: float) -> Scene:
    """``scene`` with orthographic cameras whose pictures are ``height`` high."""
    cameras = {name: replace(path, keys=tuple(replace(k, orthographic_height=height) for k in path.keys))
               for name, path in scene.cameras.items()}
    return replace(scene, name=f"{scene.name}, parallel", cameras=cameras)


def noon() -> Scene:
    """``dusk`` with specular ground, a metal block, a point light, and a mast thinner than a texel."""
    scene = dusk()
    mast = block("mast", 1, (0.02, 2.2, 0.02))
    ground, metal = scene.materials
    ground = replace(ground, roughness=0.5, specular=(0.04, 0.04, 0.04))
    metal = replace(metal, roughness=0.25, specular=(0.9, 0.6, 0.3), albedo=(0.1, 0.1, 0.1))
    light = PointLight((-1.0, 1.2, 0.8), (0.6, 0.5, 0.4))
    meshes = (*scene.meshes, mast)
    instances = (*scene.instances, Instance("mast", 2, rotation_about_y(0.0, (-0.8, 1.1, 0.2))))
    return replace(scene, name="noon", materials=(ground, metal), lights=(light,), meshes=meshes, instances=instances)


def mirrors() -> Scene:
    """A closed room with a mirror, a polished floor, a chrome ball, a ball of rough gold and an emissive panel."""
    materials = (Material("white", albedo=(0.75, 0.75, 0.75)),
                 Material("red", albedo=(0.65, 0.06, 0.05)),
                 Material("blue", albedo=(0.1, 0.15, 0.6)),
                 Material("mirror", albedo=(0.95, 0.95, 0.95), metallic=1.0, roughness=0.0),
                 Material("gold", albedo=(0.9, 0.65, 0.3), metallic=1.0, roughness=0.3),
                 Material("floor", albedo=(0.4, 0.25, 0.15), specular=(0.04, 0.04, 0.04), roughness=0.5),
                 Material("panel", albedo=(0.1, 0.1, 0.1), emission=(1.5, 2.0, 3.0), double_sided=False))
    meshes = (
        quads("shell", 0, ((-1, 1, -1), (2, 0, 0), (0, 0, 2)), ((-1, -1, -1), (2, 0, 0), (0, 2, 0)),
              ((1, -1, -1), (0, 0, 2), (0, 2, 0))),
        quads("left", 1, ((-1, -1, -1), (0, 2, 0), (0, 0, 2))),
        quads("behind", 2, ((-1, -1, 1), (0, 2, 0), (2, 0, 0))),
        quads("mirror", 3, ((-0.7, -0.5, -0.99), (1.2, 0, 0), (0, 1.2, 0))),
        quads("floor", 5, ((-1, -1, -1), (0, 0, 2), (2, 0, 0))),
        quads("panel", 6, ((0.99, -0.4, -0.5), (0, 0, 0.6), (0, 0.5, 0))),
        ball("chrome", 3, 0.25),
        ball("gold", 4, 0.3),
    )
    transforms = {6: translation(np.array([-0.4, -0.7, -0.2])), 7: translation(np.array([0.45, -0.65, -0.3]))}
    lights = (PointLight((0.1, 0.8, 0.2), (1.4, 1.3, 1.1), radius=0.05),)
    first = Camera((0.0, 0.05, 0.9), (0.0, -0.2, -0.5), fov_y_deg=70.0)
    path = CameraPath((0.0, 4 * FRAME_SECONDS), (first, replace(first, eye=(0.08, 0.1, 0.85))))
    return _scene("mirrors", meshes, transforms, materials, lights, {"path": path}, {})


def hard() -> Scene:
    """Lights without extent (point, sun, narrow and wide spot), masks by texture and by vertices, face normals."""
    flipped = np.array([[0.0, 1.0, 0.0], [1.5, 0.0, -0.2], [0.0, 0.0, 1.0]])
    materials = (Material("ground", albedo=(0.7, 0.7, 0.7)),
                 Material("card", albedo_map=Texture(_chequers(), flipped, (False, False)), alpha_cutoff=0.5),
                 Material("veil", albedo=(0.9, 0.8, 0.3), alpha=0.9, alpha_cutoff=0.4),
                 Material("plain", albedo=(0.3, 0.5, 0.7), alpha=0.8, alpha_cutoff=0.7))
    pebble = ball("pebble", 3, 0.35, rows=5)
    meshes = (
        quads("ground", 0, ((-3, 0, 3), (6, 0, 0), (0, 0, -6))),
        quads("card", 1, ((-1.3, 0.1, -0.4), (1.1, 0, 0), (0, 1.2, 0))),
        _coloured(quads("veil", 2, ((0.2, 0.1, -0.6), (1.0, 0, 0.4), (0, 1.2, 0))), (1.0, 0.2, 0.9, 0.6)),
        replace(pebble, normals=np.zeros_like(pebble.normals)),
        quads("far wall", 0, ((-1, 0, 40), (2, 0, 0), (0, 1, 0))),  # behind the eye; for it, the sun has a near cascade
    )
    lights = (
        PointLight((-1.6, 1.4, 1.0), (2.0, 1.0, 0.6)),
        DirectionalLight((0.4, -1.0, -0.6), (0.8, 0.9, 1.0)),
        SpotLight((1.2, 2.0, 1.2), (-0.5, -1.0, -0.8), (3.0, 3.0, 1.0), inner_deg=18.0, outer_deg=25.0),
        SpotLight((0.2, 1.8, 1.6), (0.0, -1.0, -0.3), (0.5, 1.5, 0.8), inner_deg=30.0, outer_deg=70.0),
    )
    still = CameraPath.still(Camera((0.3, 1.4, 3.2), (0.0, 0.4, 0.0), fov_y_deg=48.0))
    return _scene("hard", meshes, {3: rotation_about_y(0.0, (0.1, 0.35, 0.8))}, materials, lights, {"main": still})


def area_lights() -> Scene:
    """A two-sided rectangle light whose back shines through bars onto a glossy floor, and a small sphere and spot.

    Also an emission map, on an instance and on its mirror image.
    """
    emission = np.zeros((8, 8, 4), np.float32)
    emission[..., :3] = np.linspace(0.0, 2.0, 8)[:, None, None] * (1.0, 0.6, 0.2)
    emission[..., 3] = 1.0
    materials = (Material("floor", albedo=(0.4, 0.4, 0.45), roughness=0.3, specular=(0.3, 0.3, 0.3)),
                 Material("post", albedo=(0.6, 0.3, 0.2)),
                 Material("sign", emission=(1.0, 1.0, 1.0), emission_map=Texture(emission), double_sided=False),
                 Material("light panel", emission=(2.0, 2.5, 3.0), is_light_proxy=True))
    edge_u, edge_v = (-0.7, 0.0, 0.0), (0.0, 0.5, 0.3)
    bars = (((-1.2, 0.4, -0.9 + 0.13 * i), (1.4, 0.0, 0.0), (0.0, 0.0, -0.02)) for i in range(8))
    sign = quads("sign", 2, ((0.0, 0.0, 0.0), (0.6, 0, 0), (0, 0.5, 0)))
    meshes = (
        quads("floor", 0, ((-3, 0, 3), (6, 0, 0), (0, 0, -6))),
        block("post", 1, (0.15, 1.2, 0.15)),
        sign, replace(sign, name="mirrored sign"),
        quads("light panel", 3, ((-0.2, 0.6, -1.0), edge_u, edge_v)),
        quads("bars", 1, *bars),
    )
    mirrored = affine_matrix(np.diag([-1.0, 1.0, 1.0]), (-0.7, 0.1, 0.7))
    transforms = {1: rotation_about_y(0.5, (0.1, 0.6, 0.3)), 2: rotation_about_y(0.3, (0.7, 0.1, -0.3)), 3: mirrored}
    lights = (
        RectLight((-0.55, 0.85, -0.85), edge_u, edge_v, (2.0, 2.5, 3.0), two_sided=True),
        PointLight((1.2, 1.0, 0.6), (0.8, 0.5, 0.3), radius=0.02),
        SpotLight((-1.3, 1.5, 1.1), (0.8, -1.0, -0.6), (1.2, 0.3, 0.9), inner_deg=20.0, outer_deg=50.0, radius=0.03),
    )
    first = Camera((0.0, 1.1, 3.0), (0.0, 0.35, 0.0), fov_y_deg=50.0)
    path = CameraPath((0.0, 4 * FRAME_SECONDS), (first, replace(first, eye=(0.1, 1.1, 3.0))))
    return _scene("area_lights", meshes, transforms, materials, lights, {"path": path})


def screen() -> Scene:
    """``area_lights`` with a coated post; the rectangle light has an image: stripes that differ in colour, one dark."""
    scene = area_lights()
    materials = (scene.materials[0], replace(scene.materials[1], clearcoat=Clearcoat(0.9, 0.3)), *scene.materials[2:])
    colors = np.array([(3.0, 0.2, 0.4), (0.5, 2.8, 0.6), (0.5, 1.0, 3.0), (0.0, 0.0, 0.0)], np.float32)
    ramp = np.linspace(0.2, 1.8, 256, dtype=np.float32)
    pixels = colors.repeat(64, axis=0)[:, None] * ramp[:, None]
    image = EmissionImage(np.ascontiguousarray((pixels / pixels.mean(axis=(0, 1))).astype(np.float32)))
    return replace(scene, name="screen", materials=materials, lights=tuple(
        replace(light, image=image) if isinstance(light, RectLight) else light for light in scene.lights))


def spotlights() -> Scene:
    """Only narrow spots, one with a radius and one without, on a glossy ball and the ground."""
    materials = (Material("ground", albedo=(0.6, 0.6, 0.6)),
                 Material("ball", albedo=(0.5, 0.1, 0.1), roughness=0.35, specular=(0.5, 0.5, 0.5)))
    meshes = (quads("ground", 0, ((-2, 0, 2), (4, 0, 0), (0, 0, -4))), ball("ball", 1, 0.4))
    lights = (
        SpotLight((-1.2, 1.8, 0.9), (1.2, -1.5, -0.9), (4.0, 3.6, 3.0), inner_deg=12.0, outer_deg=22.0, radius=0.04),
        SpotLight((1.3, 1.6, 1.0), (-1.3, -1.3, -1.0), (0.6, 1.2, 3.0), inner_deg=10.0, outer_deg=25.0),
    )
    still = CameraPath.still(Camera((0.2, 1.2, 2.6), (0.0, 0.3, 0.0), fov_y_deg=45.0))
    return _scene("spotlights", meshes, {1: rotation_about_y(0.0, (0.0, 0.4, 0.0))}, materials, lights, {"main": still})


def terrace() -> Scene:
    """Only a soft sun, on rough and glossy steps, beside an emitter that lights others and one that does not.

    Also a wire in front of the sky that is too thin for the network's grid.
    """
    materials = (Material("stone", albedo=(0.7, 0.65, 0.55)),
                 Material("tile", albedo=(0.1, 0.3, 0.3), roughness=0.5, specular=(0.1, 0.1, 0.1)),
                 Material("window", albedo=(0.2, 0.2, 0.2), emission=(0.6, 0.5, 0.2)),
                 Material("screen", albedo=(0.2, 0.2, 0.2), emission=(0.2, 0.3, 0.8), is_light_proxy=True))
    meshes = (
        quads("ground", 0, ((-2, 0, 2), (4, 0, 0), (0, 0, -4)), ((-1.2, 0, -1), (2.4, 0, 0), (0, 1.6, 0))),
        block("step", 1, (1.4, 0.4, 0.8)),
        quads("window", 2, ((-0.9, 0.7, -0.98), (0.6, 0, 0), (0, 0.6, 0))),
        quads("screen", 3, ((0.3, 0.7, -0.98), (0.6, 0, 0), (0, 0.6, 0))),
        quads("wire", 0, ((1.5, 0.0, -1.0), (0.018, 0, 0), (0, 1.6, 0))),
    )
    lights = (DirectionalLight((0.7, -1.0, -0.5), (2.0, 1.9, 1.6), angular_radius_deg=3.0),)
    still = CameraPath.still(Camera((0.5, 1.5, 1.7), (0.0, 0.4, -0.6), (0.2, 1.0, 0.0), fov_y_deg=60.0))
    return _scene("terrace", meshes, {1: rotation_about_y(0.3, (0.0, 0.2, -0.2))}, materials, lights, {"main": still})


def emissive() -> Scene:
    """No lights but two emissive panels in a closed, diffuse box."""
    materials = (Material("wall", albedo=(0.6, 0.6, 0.6)), Material("warm", emission=(3.0, 1.5, 0.6)),
                 Material("cold", emission=(0.3, 0.8, 2.0)))
    meshes = (
        block("walls", 0, (2.0, 1.6, 2.4)),
        quads("warm", 1, ((-0.99, -0.4, -0.6), (0, 0.8, 0), (0, 0, 0.8))),
        quads("cold", 2, ((0.1, 0.79, -0.8), (0.7, 0, 0), (0, 0, 0.7))),
        block("crate", 0, (0.5, 0.5, 0.5)),
    )
    still = CameraPath.still(Camera((0.2, 0.1, 1.1), (0.0, -0.2, -0.5), fov_y_deg=70.0))
    return _scene("emissive", meshes, {3: rotation_about_y(0.6, (0.1, -0.55, -0.2))}, materials, (), {"main": still})


def materials() -> Scene:
    """Every map of a material, two uv sets, mirrored uvs and a mirrored instance, clear coats, sheen, unlit signs.

    Also lights behind a surface whose mapped normals face them, and a rectangle that stands for a diagonal of points.
    """
    noise = np.random.default_rng(1).integers(0, 256, (32, 32, 4)).astype(np.uint8)
    ramp = np.broadcast_to(np.linspace(40, 255, 16).astype(np.uint8)[:, None, None], (16, 16, 4))
    bumps, colors, numbers = Texture(_bumps(), is_color=False), Texture(ramp), Texture(ramp, is_color=False)
    turned = np.array([[0.0, 2.0, 0.1], [-2.0, 0.0, 0.3], [0.0, 0.0, 1.0]])
    tiles = Material("tiles", albedo_map=Texture(_chequers()), normal_map=bumps, normal_scale=0.8, metallic=0.9,
                     roughness=0.9, metallic_roughness_map=Texture(noise, is_color=False, magnified="nearest"),
                     specular=(0.04, 0.05, 0.06), specular_map=replace(colors, uv_set=1),
                     occlusion_map=replace(numbers, transform=turned, uv_set=1), occlusion_strength=0.7)
    materials = (
        tiles,
        Material("lacquer", albedo=(0.5, 0.1, 0.1), metallic=0.6, roughness=0.6, specular=(0.04,) * 3, normal_map=bumps,
                 clearcoat=Clearcoat(0.9, 0.5, numbers, numbers, replace(bumps, transform=turned), 0.4)),
        Material("velvet", albedo=(0.2, 0.1, 0.4), sheen=Sheen((0.9, 0.7, 0.5), 0.8, colors, numbers)),
        Material("pearl", albedo=(0.6, 0.6, 0.5), emission=(0.1, 0.1, 0.2),
                 sheen=Sheen((0.3, 0.3, 0.3), 0.4), clearcoat=Clearcoat(1.0, 0.2)),
        Material("sign", albedo=(0.8, 0.6, 0.2), albedo_map=Texture(_chequers()), is_unlit=True, is_back_culled=True),
    )
    ground = _with_tangents(quads("ground", 0, ((-2, 0, 2), (4, 0, 0), (0, 0, -4))))
    card = _with_tangents(quads("mirrored uvs", 1, ((1.5, 0.0, -0.9), (-0.9, 0, 0.1), (0, 0.9, 0))), handedness=-1.0)
    crate = _with_tangents(block("crate", 1, (0.6, 0.6, 0.6)))
    sign = quads("sign", 4, ((-0.4, 1.0, -0.9), (0.6, 0, 0), (0, 0.5, 0)))
    assert ground.uvs is not None and card.uvs is not None
    meshes = (
        replace(ground, uvs=3 * ground.uvs, second_uvs=ground.uvs),
        replace(card, uvs=card.uvs * np.array([-1.0, 1.0], np.float32)),
        crate, replace(crate, name="mirrored crate"),
        quads("curtain", 2, ((-1.6, 0.0, -0.8), (0.9, 0, -0.3), (0, 1.1, 0))),
        ball("pearl", 3, 0.3), sign, replace(sign, name="sign from behind"),
    )
    mirrored = affine_matrix(np.diag([-1.0, 1.0, 1.0]), (0.45, 0.3, 0.5))
    transforms = {2: rotation_about_y(0.6, (-0.7, 0.3, 0.5)), 3: mirrored, 5: rotation_about_y(0.0, (-0.1, 0.3, 0.2)),
                  7: rotation_about_y(np.pi, (0.6, 0.0, -1.8))}
    panel = RectLight((0.8, 1.6, 0.2), (-0.8, 0.0, 0.0), (0.0, 0.0, -0.8), (2.0, 1.8, 1.5))
    lights = (PointLight((-1.0, 1.0, 1.4), (1.2, 1.1, 1.0)), panel,
              DirectionalLight((0.9, -0.12, 0.05), (0.7, 0.7, 0.9), angular_radius_deg=0.5),
              PointLight((1.05, 1.0, -1.0), (0.5, 0.5, 0.4), radius=0.01),
              SpotLight((0.2, 1.4, 1.6), (-0.1, -0.8, -1.0), (1.0, 1.0, 1.2), inner_deg=20.0, outer_deg=40.0))
    still = CameraPath.still(Camera((0.2, 0.8, 2.6), (0.0, 0.35, 0.0), fov_y_deg=46.0))
    scene = replace(_scene("materials", meshes, transforms, materials, lights, {"main": still}),
                    approximate_lights={panel: _diagonal(panel)})
    sky = np.linspace([0.1, 0.15, 0.3], [0.3, 0.25, 0.2], 8)[:, None]
    return replace(scene, environment=Environment(np.broadcast_to(sky, (8, 16, 3)).astype(np.float32)))


def glass() -> Scene:
    """Blended and transmissive surfaces before each other: thin, thick, rough, metallic, coated, cut out, moving."""
    ramp = np.broadcast_to(np.linspace(60, 255, 16).astype(np.uint8)[:, None, None], (16, 16, 4))
    numbers = Texture(ramp, is_color=False)
    materials = (
        Material("ground", albedo_map=Texture(_chequers()), roughness=0.5, specular=(0.04,) * 3),
        Material("stained", albedo=(0.9, 0.5, 0.2), albedo_map=Texture(_stripes()), alpha=0.9, is_blended=True,
                 emission=(0.03, 0.02, 0.08), roughness=0.4, specular=(0.04,) * 3),
        Material("veil", albedo=(0.3, 0.4, 0.9), alpha=0.8, is_blended=True),
        Material("frosted", albedo=(0.7, 0.95, 0.8), roughness=0.6, specular=(0.04,) * 3, metallic=0.3,
                 metallic_roughness_map=numbers, transmission=Transmission(0.9, replace(numbers, uv_set=1))),
        Material("vase", albedo=(0.95, 0.9, 0.9), roughness=0.25, specular=(0.04,) * 3,
                 transmission=Transmission(1.0, None, 1.5, 0.3, numbers, (0.4, 0.9, 0.6), 0.3)),
        Material("film", albedo=(0.9, 0.6, 0.9), roughness=0.1, specular=(0.04,) * 3, metallic=0.2,
                 clearcoat=Clearcoat(0.8, 0.3), sheen=Sheen((0.4, 0.2, 0.2), 0.6), albedo_map=Texture(_chequers()),
                 alpha_cutoff=0.5, transmission=Transmission(0.7)),
    )
    frosted = quads("frosted", 3, ((0.1, 0.05, 0.2), (0.9, 0, 0.1), (0, 0.9, 0)))
    assert frosted.uvs is not None
    meshes = (
        quads("ground", 0, ((-2, 0, 2), (4, 0, 0), (0, 0, -4))),
        quads("stained", 1, ((-1.2, 0.1, 0.3), (1.0, 0, 0.2), (0, 1.0, 0))),
        _coloured(quads("veil", 2, ((-0.9, 0.2, 0.6), (0.8, 0, -0.9), (0, 0.7, 0))), (1.0, 0.3, 0.9, 0.6)),
        replace(frosted, second_uvs=np.ascontiguousarray(frosted.uvs[:, ::-1])),
        block("vase", 4, (0.35, 0.6, 0.35)),
        quads("film", 5, ((0.3, 0.2, 0.7), (0.6, 0, -0.2), (0, 0.5, 0))),
        block("block", 0, (0.4, 0.5, 0.4)),
    )
    poses = np.stack([np.eye(4), rotation_about_y(0.3, (0.2, 0.0, 0.1))])
    motions = {1: Motion(np.array([0.0, 4 * FRAME_SECONDS]), poses)}
    lights = (DirectionalLight((-0.5, -1.0, -0.7), (1.5, 1.4, 1.2)),
              PointLight((0.9, 1.4, 0.9), (0.8, 0.7, 0.9), radius=0.02),
              SpotLight((-0.6, 1.8, 1.4), (0.2, -1.0, -0.8), (1.5, 1.2, 1.0), inner_deg=15.0, outer_deg=30.0))
    transforms = {4: rotation_about_y(0.0, (-0.15, 0.31, 0.0)), 6: rotation_about_y(0.4, (-0.8, 0.25, 0.9))}
    first = Camera((0.1, 0.9, 2.8), (0.0, 0.4, 0.0), fov_y_deg=45.0)
    path = CameraPath((0.0, 4 * FRAME_SECONDS), (first, replace(first, eye=(0.15, 0.9, 2.8))))
    scene = _scene("glass", meshes, transforms, materials, lights, {"path": path}, motions)
    return replace(scene, environment=Environment(np.full((4, 8, 3), (0.2, 0.25, 0.35), np.float32)))


def _diagonal(light: RectLight) -> EmissionPoints:
    """Eight points, half of them two-sided, which fill little of the light."""
    along = np.linspace(-0.45, 0.45, 8, dtype=np.float32)[:, None]
    normal = np.cross(light.edge_u, light.edge_v)
    area = float(np.linalg.norm(normal)) / len(along)
    tile = np.ones_like(along)
    return EmissionPoints(along * np.add(light.edge_u, light.edge_v, dtype=np.float32),
                          tile * (normal / np.linalg.norm(normal)).astype(np.float32),
                          tile * np.multiply(light.radiance, area, dtype=np.float32), area * tile[:, 0],
                          np.arange(len(along)) % 2 == 0, is_sparse=True)


def _stripes() -> Bytes:
    """White, with an alpha that falls to 0 and back."""
    pixels = np.full((16, 16, 4), 255, np.uint8)
    pixels[..., 3] = np.abs(np.linspace(-255, 255, 16))
    return pixels


def _bumps() -> Bytes:
    """A normal map of smooth, steep bumps."""
    y, x = np.mgrid[:32, :32] / 32 * 2 * np.pi
    normals = np.stack([0.8 * np.sin(2 * x), 0.8 * np.cos(3 * y), np.full_like(x, 0.6), np.ones_like(x)], axis=-1)
    return np.rint(255 * (0.5 + 0.5 * normals)).astype(np.uint8)


def _with_tangents(mesh: Mesh, handedness: float = 1.0) -> Mesh:
    """Parallelograms with tangents along their first edge, or against it where their uvs are mirrored."""
    edges = mesh.positions[1::4] - mesh.positions[::4]
    edges *= handedness / np.linalg.norm(edges, axis=1, keepdims=True)
    tangents = np.column_stack([edges, np.full(len(edges), handedness)])
    return replace(mesh, tangents=np.repeat(tangents, 4, axis=0).astype(np.float32))


def waving() -> Scene:
    """A banner that two joints bend and a ball that a morph target squashes, under a hard and a large light."""
    materials = (Material("ground", albedo=(0.6, 0.6, 0.6)), Material("banner", albedo=(0.8, 0.3, 0.2)),
                 Material("ball", albedo=(0.2, 0.4, 0.7), roughness=0.35, specular=(0.1, 0.1, 0.1)))
    meshes = (quads("ground", 0, ((-2, 0, 2), (4, 0, 0), (0, 0, -4))),
              quads("banner", 1, *(((-0.3, 0.1 * i, 0.0), (0.6, 0, 0), (0, 0.1, 0)) for i in range(14))),
              ball("ball", 2, 0.3))
    lights = (PointLight((1.2, 2.0, 1.4), (3.0, 2.8, 2.4)),
              RectLight((-1.3, 1.2, 0.8), (0.0, 0.6, 0.0), (0.5, 0.0, 0.5), (2.0, 2.4, 3.0)))
    still = CameraPath.still(Camera((0.4, 1.1, 2.8), (0.1, 0.6, 0.0), fov_y_deg=48.0))
    scene = _scene("waving", meshes, {1: rotation_about_y(0.2, (-0.4, 0.0, 0.0)), 2: rotation_about_y(
        0.0, (0.7, 0.3, 0.3))}, materials, lights, {"main": still})
    deformations = {1: _bend(meshes[1]), 2: _squash(meshes[2])}
    return replace(scene, instances=tuple(replace(instance, deformation=deformations.get(index))
                                          for index, instance in enumerate(scene.instances)))


def _bend(mesh: Mesh) -> Deformation:
    """Two joints, of which the upper one, at a height of 0.6, turns about an oblique axis within six frames."""
    half = 0.45  # of the angle, radians
    turned = [*(np.sin(half) * np.array([0.6, 0.0, 0.8])), np.cos(half)]
    keys = Track(FRAME_SECONDS * np.array([0.0, 6.0]), np.array([[[0.0, 0.0, 0.0, 1.0]], [turned]]), are_rotations=True)
    offset = np.array([0.0, 0.6, 0.0])
    local = np.stack([np.eye(4), translation(offset)])
    tree = NodeTree(np.array([-1, 0]), local, local[:, :3, 3], np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)), np.ones((2, 3)),
                    (NodeTrack(np.array([1]), "rotation", keys),), 6 * FRAME_SECONDS)
    upper = np.clip((mesh.positions[:, 1].astype(np.float64) - 0.4) / 0.4, 0.0, 1.0)
    skin = Skin(tree, np.array([0, 1]), np.stack([np.eye(4), translation(-offset)]),
                np.tile(np.array([0, 1]), (len(upper), 1)), np.stack([1 - upper, upper], axis=1))
    return Deformation(_vertices(mesh), (), np.zeros(0), skin, tree.times)


def _squash(mesh: Mesh) -> Deformation:
    """Half as high and a third wider within six frames."""
    change = np.array([0.33, -0.5, 0.33])
    target = Vertices(mesh.positions * change, mesh.normals * (1 / (1 + change) - 1))
    times = FRAME_SECONDS * np.array([0.0, 6.0])
    return Deformation(_vertices(mesh), (target,), Track(times, np.array([[[0.0]], [[1.0]]])), None, times)


def _vertices(mesh: Mesh) -> Vertices:
    return Vertices(mesh.positions.astype(np.float64), mesh.normals.astype(np.float64))


def _chequers() -> Bytes:
    """A texture with gradients in green and blue, transparent in every second square."""
    pixels = np.full((16, 16, 4), 255, np.uint8)
    pixels[..., 1] = np.arange(16)[:, None] * 16
    pixels[..., 2] = np.arange(16) * 16
    pixels[..., 3] = 255 * ((np.arange(16)[:, None] // 4 + np.arange(16) // 4) % 2)
    return pixels


def _coloured(mesh: Mesh, alpha: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)) -> Mesh:
    """A parallelogram with a colour and an opacity at each corner."""
    corners = np.array([[0.8, 0.3, 0.2], [0.3, 0.8, 0.2], [0.3, 0.3, 0.9], [0.8, 0.8, 0.8]])
    return replace(mesh, colors=np.column_stack([corners, alpha]).astype(np.float32))


def _scene(name: str, meshes: tuple[Mesh, ...], transforms: dict[int, F64], materials: tuple[Material, ...],
           lights: tuple[Light, ...], cameras: dict[str, CameraPath],
           motions: dict[int, Motion] | None = None) -> Scene:
    """A scene with one instance of each mesh; its first camera is the default."""
    instances = tuple(Instance(m.name, i, transforms.get(i, np.eye(4)), (motions or {}).get(i))
                      for i, m in enumerate(meshes))
    return Scene(name, meshes, instances, materials, lights, cameras, next(iter(cameras)),
                 bounds_of(meshes, instances))
