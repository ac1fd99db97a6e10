"""The scene on the GPU: vertex buffers, textures, and culled draws."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import Any

import moderngl
import numpy as np

from app.arrays import F32, F64
from app.gl.context import Device
from app.gl.shader import Program
from app.math3d import boxes_in_frustum, frustum_planes, normal_matrix, translation
from app.scene import Material, Mesh, Scene, Texture, world_box

GL_SRGB8_ALPHA8 = 0x8C43
MAP_UNITS = {name: unit for unit, name in enumerate((
    "albedo_map", "emission_map", "metallic_roughness_map", "specular_map", "normal_map", "occlusion_map",
    "clearcoat_map", "clearcoat_roughness_map", "clearcoat_normal_map", "sheen_color_map", "sheen_roughness_map",
    "transmission_map", "thickness_map"))}


@dataclass(frozen=True)
class Drawable:
    """One instance with the features that choose its shader variant, and the textures that it has uvs for.

    ``buffers`` is an index into the scene's, ``labels`` are the numbers of instance and material, counted from 1.
    """

    instance: int
    buffers: int
    material: Material
    features: tuple[str, ...]
    maps: dict[str, Texture]
    parameters: dict[str, object]
    labels: tuple[float, float]

    @property
    def masked(self) -> bool:
        return "ALPHA_MASK" in self.features


class GpuScene:
    """Uploads ``scene`` once; ``update`` moves and deforms its instances, ``draw`` draws those in a frustum."""

    def __init__(self, device: Device, scene: Scene) -> None:
        self._device, self.scene = device, scene
        self._buffers = [_upload_mesh(device.ctx, mesh) for mesh in scene.meshes]
        self._textures: dict[tuple[object, ...], moderngl.Texture] = {}
        self._arrays: dict[tuple[int, int], moderngl.VertexArray] = {}
        self._deformed: dict[int, DeformedVertices] = {}
        self.drawables = [_drawable(scene, i, self._buffers_of(i)) for i in range(len(scene.instances))]
        self._moving = [k for k, i in enumerate(scene.instances) if i.moves]
        self.transforms: list[F64] = [i.transform for i in scene.instances]
        self.previous: list[F64] = []
        self.boxes = np.array([self._box(i, 0.0) for i in range(len(scene.instances))]).reshape(-1, 2, 3)
        self._time: float | None = None
        self.time = 0.0  # seconds, of the newest update
        self.changes = 0  # how often any instance has moved
        self.update(0.0, cut=True)

    def update(self, time: float, cut: bool = False) -> None:
        """Move all instances to where they are at ``time`` seconds; ``cut`` makes last frame's transforms the same."""
        self.previous, self.time = self.transforms, time
        for vertices in self._deformed.values():
            vertices.advance()
        if self._time is None or (self._moving and time != self._time):
            self.changes += self._move(time) or self._time is None
            self._time = time
        if cut:
            self.previous = self.transforms
            for vertices in self._deformed.values():
                vertices.advance()

    def _move(self, time: float) -> bool:
        """Move and deform the moving instances; False if nothing changed."""
        transforms = self.transforms.copy()
        for index in self._moving:
            transforms[index] = self.scene.instances[index].transform_at(time)
        moved = not np.array_equal(transforms, self.transforms)
        for index, vertices in self._deformed.items():
            moved |= vertices.replace(self.scene.instances[index].mesh_at(self.scene.meshes, time))
        if moved:
            self.transforms = transforms
            for index in self._moving:
                self.boxes[index] = self._box(index, time)
        return moved

    def _box(self, index: int, time: float) -> F64:
        return world_box(self.scene.instances[index].mesh_at(self.scene.meshes, time), self.transforms[index])

    def _buffers_of(self, index: int) -> int:
        """The buffers of an instance: its mesh's, or its own if it deforms."""
        instance = self.scene.instances[index]
        if instance.deformation is None:
            return instance.mesh
        attributes, order = self._buffers[instance.mesh]
        self._deformed[index] = DeformedVertices(self._device.ctx, instance.mesh_at(self.scene.meshes, 0.0))
        self._buffers.append(({**attributes, **self._deformed[index].attributes}, order))
        return len(self._buffers) - 1

    @contextmanager
    def looking_ahead(self, time: float) -> Iterator[None]:
        """In place of where and how instances were in the previous frame, have what they are at ``time`` seconds."""
        previous, self.previous = self.previous, self.transforms.copy()
        for index in self._moving:
            self.previous[index] = self.scene.instances[index].transform_at(time)
        for index, vertices in self._deformed.items():
            vertices.write_previous(self.scene.instances[index].mesh_at(self.scene.meshes, time).positions)
        try:
            yield
        finally:
            self.previous = previous
            for vertices in self._deformed.values():
                vertices.restore_previous()

    def visible(self, clip: F64, origin: F64, include: Callable[[Drawable], bool] = lambda _: True) -> list[Drawable]:
        """Drawables that may touch the frustum of ``clip``, which takes points relative to ``origin``."""
        inside = boxes_in_frustum(self.boxes - origin, frustum_planes(clip))
        return [d for d in self.drawables if inside[d.instance] and include(d)]

    def draw(self, drawables: Iterable[Drawable], program_of: Callable[[Drawable], Program], origin: F64,
             previous_origin: F64 | None = None) -> None:
        """Draw with per-object uniforms set; matrices lead to space relative to ``origin``."""
        to_origin = translation(-origin)
        to_previous = None if previous_origin is None else translation(-previous_origin)
        for d in sorted(drawables, key=lambda d: d.features):
            program = program_of(d)
            relative_from_object = to_origin @ self.transforms[d.instance]
            program.set(relative_from_object=relative_from_object)
            if to_previous is not None:
                program.set(previous_from_object=to_previous @ self.previous[d.instance])
            self._set_material(program, d, relative_from_object)
            self._array(program, d.buffers).render(moderngl.TRIANGLES)

    def _set_material(self, program: Program, d: Drawable, relative_from_object: F64) -> None:
        m = d.material
        surface = program.declares("normal_from_object")  # a shadow caster needs only what light passes
        is_mirrored = bool(np.linalg.det(relative_from_object[:3, :3]) < 0)
        self._cull_backs(m, is_mirrored)
        if surface:
            cofactor = normal_matrix(relative_from_object)
            program.set(normal_from_object=cofactor / max(float(np.abs(cofactor).max()), 1e-30))
            program.set(labels=d.labels, albedo=m.albedo, specular_roughness=(*m.specular, m.roughness),
                        emission=m.emission, emission_flags=(float(m.double_sided or m.is_unlit),
                                                             float(not (m.is_light_proxy or m.is_unlit)),
                                                             -1.0 if is_mirrored else 1.0))
            for name, value in d.parameters.items():
                program.set(**{name: value})
            if m.transmission is not None:
                scale = float(np.abs(np.linalg.det(relative_from_object[:3, :3]))) ** (1 / 3)
                program.set(transmission=(m.transmission.factor, m.transmission.ior, m.transmission.thickness * scale),
                            extinction=m.transmission.extinction)
        for name, texture in d.maps.items():
            if surface or program.declares(name):
                self._bind(program, name, texture)
        if program.declares("passing"):
            program.set(passing=m.passing, faces=2.0 if m.is_volume else 1.0)
            if program.declares("metallic"):
                program.set(metallic=m.metallic)
        if d.masked or m.is_see_through:
            program.set(alpha=(m.alpha, m.alpha_cutoff or 0.0))

    def _cull_backs(self, material: Material, is_mirrored: bool) -> None:
        ctx = self._device.ctx
        if material.is_one_sided:
            ctx.enable(moderngl.CULL_FACE)
            ctx.cull_face = "front" if is_mirrored else "back"
        else:
            ctx.disable(moderngl.CULL_FACE)

    def _bind(self, program: Program, name: str, texture: Texture) -> None:
        self._texture(texture).use(MAP_UNITS[name])
        transform = texture.transform.copy()
        transform[2, 0] = texture.uv_set  # of the last row, which is (0, 0, 1), shaders need nothing
        program.set(**{name: MAP_UNITS[name], name.removesuffix("map") + "uv": transform})

    def _array(self, program: Program, buffers: int) -> moderngl.VertexArray:
        key = (program.glo, buffers)
        if key not in self._arrays:
            attributes, index = self._buffers[buffers]
            content = [(buffer, kind, name) for name, (buffer, kind) in attributes.items() if name in program]
            self._arrays[key] = self._device.ctx.vertex_array(program.raw, content, index)
        return self._arrays[key]

    def _texture(self, texture: Texture) -> moderngl.Texture:
        key = id(texture.pixels), texture.is_color, texture.repeat, texture.magnified
        if key not in self._textures:
            self._textures[key] = _upload_texture(self._device, texture)
        return self._textures[key]

    def release(self) -> None:
        buffers = (b for attributes, index in self._buffers for b in (index, *(b for b, _ in attributes.values())))
        owned: Iterable[Any] = chain(self._arrays.values(), self._textures.values(), buffers)
        for resource in owned:
            resource.release()


class DeformedVertices:
    """Vertices of one instance that deforms, now and in the previous frame.

    Attributes
    ----------
    attributes : dict of str to (Buffer, str)
        In place of those of its mesh.
    """

    def __init__(self, ctx: moderngl.Context, mesh: Mesh) -> None:
        self._arrays = _deforming_arrays(mesh)
        self.attributes = _upload_attributes(ctx, self._arrays)
        self._now = self._before = mesh.positions
        self.attributes["in_previous_position"] = (ctx.buffer(mesh.positions.tobytes()), "3f4")

    def replace(self, mesh: Mesh) -> bool:
        """Take the vertices of ``mesh``; False, and no change, if they are the same."""
        arrays = _deforming_arrays(mesh)
        if all(np.array_equal(values, self._arrays[name][0]) for name, (values, _) in arrays.items()):
            return False
        self._now, self._arrays = mesh.positions, arrays
        for name, (values, _) in arrays.items():
            self.attributes[name][0].write(np.ascontiguousarray(values, np.float32).tobytes())
        return True

    def advance(self) -> None:
        """Make the present vertices the previous ones."""
        if self._before is not self._now:
            self._before = self._now
            self.restore_previous()

    def write_previous(self, positions: F32) -> None:
        """Have other previous positions until ``restore_previous``."""
        self.attributes["in_previous_position"][0].write(np.ascontiguousarray(positions, np.float32).tobytes())

    def restore_previous(self) -> None:
        self.write_previous(self._before)


def _drawable(scene: Scene, index: int, buffers: int) -> Drawable:
    instance = scene.instances[index]
    mesh = scene.meshes[instance.mesh]
    m = scene.materials[mesh.material]
    uvs = (mesh.uvs, mesh.second_uvs)
    maps = {name: texture for name, texture in m.maps.items() if uvs[texture.uv_set] is not None}
    if not m.emits:
        maps.pop("emission_map", None)
    if mesh.tangents is None:
        maps.pop("normal_map", None)
        maps.pop("clearcoat_normal_map", None)
    features = {
        "UV": bool(maps),
        "SECOND_UV": any(texture.uv_set for texture in maps.values()),
        "TANGENT": "normal_map" in maps or "clearcoat_normal_map" in maps,
        "VERTEX_COLOR": mesh.colors is not None,
        "ALPHA_MASK": m.alpha_cutoff is not None,
        "METALLIC": m.metallic > 0,
        "SPECULAR": m.has_specular,
        "CLEARCOAT": m.clearcoat is not None,
        "SHEEN": m.sheen is not None,
        "UNLIT": m.is_unlit,
        "BLENDED": m.is_blended,
        "TRANSMISSION": m.transmission is not None,
        "EMITS": m.emits,
        "DEFORMED": instance.deformation is not None,
    }
    used = [*(name for name, is_used in features.items() if is_used), *(name.upper() for name in maps)]
    return Drawable(index, buffers, m, tuple(sorted(used)), maps, _parameters(m), (index + 1.0, mesh.material + 1.0))


def _parameters(m: Material) -> dict[str, object]:
    """Uniforms of the features that few materials have."""
    parameters: dict[str, object] = {}
    if m.metallic > 0:
        parameters["metallic"] = m.metallic
    if m.normal_map is not None:
        parameters["normal_scale"] = m.normal_scale
    if m.occlusion_map is not None:
        parameters["occlusion_strength"] = m.occlusion_strength
    if m.clearcoat is not None:
        parameters["clearcoat"] = (m.clearcoat.strength, m.clearcoat.roughness)
        parameters["clearcoat_normal_scale"] = m.clearcoat.normal_scale
    if m.sheen is not None:
        parameters["sheen"] = (*m.sheen.color, m.sheen.roughness)
    return parameters


Attributes = dict[str, tuple[moderngl.Buffer, str]]
Arrays = dict[str, tuple[F32, str]]


def _deforming_arrays(mesh: Mesh) -> Arrays:
    arrays = {"in_position": (mesh.positions, "3f4"), "in_normal": (mesh.normals, "3f4")}
    return arrays if mesh.tangents is None else arrays | {"in_tangent": (mesh.tangents, "4f4")}


def _upload_attributes(ctx: moderngl.Context, arrays: Arrays) -> Attributes:
    return {name: (ctx.buffer(np.ascontiguousarray(values, np.float32).tobytes()), kind)
            for name, (values, kind) in arrays.items()}


def _upload_mesh(ctx: moderngl.Context, mesh: Mesh) -> tuple[Attributes, moderngl.Buffer]:
    others = {"in_uv": (mesh.uvs, "2f4"), "in_color": (mesh.colors, "4f4"), "in_second_uv": (mesh.second_uvs, "2f4")}
    attributes = _upload_attributes(ctx, _deforming_arrays(mesh) | {
        name: (values, kind) for name, (values, kind) in others.items() if values is not None})
    finite = np.asarray(np.isfinite(mesh.positions).all(axis=1))
    triangles = mesh.triangles if finite.all() else mesh.triangles[finite[mesh.triangles].all(axis=1)]
    return attributes, ctx.buffer(triangles.astype(np.uint32).tobytes() or bytes(12))  # GL refuses empty buffers


def _upload_texture(device: Device, texture: Texture) -> moderngl.Texture:
    ctx = device.ctx
    pixels = np.ascontiguousarray(texture.pixels[::-1])  # files are top-down, GL is bottom-up
    size = (pixels.shape[1], pixels.shape[0])
    if pixels.dtype == np.uint8:
        encoding = {"internal_format": GL_SRGB8_ALPHA8} if texture.is_color else {}
        result = ctx.texture(size, 4, pixels.tobytes(), dtype="f1", **encoding)
    else:
        sanitized = np.nan_to_num(pixels, nan=0.0, posinf=65504.0, neginf=0.0).clip(0.0, 65504.0)
        result = ctx.texture(size, 4, sanitized.astype(np.float16).tobytes(), dtype="f2")
    result.build_mipmaps()
    result.filter = (moderngl.LINEAR_MIPMAP_LINEAR,
                     moderngl.LINEAR if texture.magnified == "linear" else moderngl.NEAREST)
    result.anisotropy = device.anisotropy
    result.repeat_x, result.repeat_y = texture.repeat
    return result
