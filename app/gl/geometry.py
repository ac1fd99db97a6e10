"""The scene on the GPU: vertex buffers, textures, and culled draws."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any

import moderngl
import numpy as np

from app.arrays import F64
from app.gl.context import Device
from app.gl.shader import Program
from app.math3d import boxes_in_frustum, frustum_planes, normal_matrix, translation
from app.scene import Material, Mesh, Scene, Texture, world_box

GL_SRGB8_ALPHA8 = 0x8C43
ALBEDO_UNIT, EMISSION_UNIT = 0, 1


@dataclass(frozen=True)
class Drawable:
    """One instance with the features that choose its shader variant."""

    instance: int
    mesh: int
    material: Material
    features: tuple[str, ...]

    @property
    def masked(self) -> bool:
        return "ALPHA_MASK" in self.features


class GpuScene:
    """Uploads ``scene`` once; ``update`` moves its instances, ``draw`` draws those in a frustum."""

    def __init__(self, device: Device, scene: Scene) -> None:
        self._device, self.scene = device, scene
        self._buffers = [_upload_mesh(device.ctx, mesh) for mesh in scene.meshes]
        self._textures: dict[int, moderngl.Texture] = {}
        self._arrays: dict[tuple[int, int], moderngl.VertexArray] = {}
        self.drawables = [_drawable(scene, i) for i in range(len(scene.instances))]
        self._is_animated = any(i.motion is not None for i in scene.instances)
        self.transforms: list[F64] = []
        self.previous: list[F64] = []
        self._time: float | None = None
        self.time = 0.0  # seconds, of the newest update
        self.changes = 0  # how often any instance has moved
        self.update(0.0, cut=True)

    def update(self, time: float, cut: bool = False) -> None:
        """Move all instances to where they are at ``time`` seconds; ``cut`` makes last frame's transforms the same."""
        self.previous, self.time = self.transforms, time
        if self._time is None or (self._is_animated and time != self._time):
            transforms = [i.transform_at(time) for i in self.scene.instances]
            self._time = time
            if not self.transforms or not np.array_equal(transforms, self.transforms):
                self.transforms = transforms
                boxes = [world_box(self.scene.meshes[i.mesh], m)
                         for i, m in zip(self.scene.instances, transforms, strict=True)]
                self.boxes = np.array(boxes).reshape(-1, 2, 3)
                self.changes += 1
        if cut:
            self.previous = self.transforms

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
            self._array(program, d.mesh).render(moderngl.TRIANGLES)

    def _set_material(self, program: Program, d: Drawable, relative_from_object: F64) -> None:
        m = d.material
        surface = program.declares("normal_from_object")  # a shadow caster needs only its mask
        if surface:
            cofactor = normal_matrix(relative_from_object)
            program.set(normal_from_object=cofactor / max(float(np.abs(cofactor).max()), 1e-30))
            program.set(albedo=m.albedo, specular_roughness=(*m.specular, m.roughness), emission=m.emission,
                        emission_flags=(float(m.double_sided), float(not m.is_light_proxy),
                                        -1.0 if np.linalg.det(relative_from_object[:3, :3]) < 0 else 1.0))
        if m.albedo_map is not None and "ALBEDO_MAP" in d.features:
            self._texture(m.albedo_map).use(ALBEDO_UNIT)
            program.set(albedo_map=ALBEDO_UNIT, albedo_uv=m.albedo_map.transform)
        if surface and m.emission_map is not None and "EMISSION_MAP" in d.features:
            self._texture(m.emission_map).use(EMISSION_UNIT)
            program.set(emission_map=EMISSION_UNIT, emission_uv=m.emission_map.transform)
        if d.masked:
            program.set(alpha=(m.alpha, m.alpha_cutoff or 0.0))

    def _array(self, program: Program, mesh: int) -> moderngl.VertexArray:
        key = (program.glo, mesh)
        if key not in self._arrays:
            attributes, index = self._buffers[mesh]
            content = [(buffer, kind, name) for name, (buffer, kind) in attributes.items() if name in program]
            self._arrays[key] = self._device.ctx.vertex_array(program.raw, content, index)
        return self._arrays[key]

    def _texture(self, texture: Texture) -> moderngl.Texture:
        key = id(texture.pixels)
        if key not in self._textures:
            self._textures[key] = _upload_texture(self._device, texture)
        return self._textures[key]

    def release(self) -> None:
        buffers = (b for attributes, index in self._buffers for b in (index, *(b for b, _ in attributes.values())))
        owned: Iterable[Any] = chain(self._arrays.values(), self._textures.values(), buffers)
        for resource in owned:
            resource.release()


def _drawable(scene: Scene, index: int) -> Drawable:
    instance = scene.instances[index]
    mesh = scene.meshes[instance.mesh]
    m = scene.materials[mesh.material]
    features = {
        "ALBEDO_MAP": m.albedo_map is not None and mesh.uvs is not None,
        "EMISSION_MAP": m.emission_map is not None and mesh.uvs is not None and m.emits,
        "VERTEX_COLOR": mesh.colors is not None,
        "ALPHA_MASK": m.alpha_cutoff is not None,
        "EMITS": m.emits,
    }
    return Drawable(index, instance.mesh, m, tuple(sorted(name for name, is_used in features.items() if is_used)))


Attributes = dict[str, tuple[moderngl.Buffer, str]]


def _upload_mesh(ctx: moderngl.Context, mesh: Mesh) -> tuple[Attributes, moderngl.Buffer]:
    arrays = {"in_position": (mesh.positions, "3f4"), "in_normal": (mesh.normals, "3f4"),
              "in_uv": (mesh.uvs, "2f4"), "in_color": (mesh.colors, "4f4")}
    attributes = {name: (ctx.buffer(np.ascontiguousarray(a, np.float32).tobytes()), kind)
                  for name, (a, kind) in arrays.items() if a is not None}
    finite = np.asarray(np.isfinite(mesh.positions).all(axis=1))
    triangles = mesh.triangles if finite.all() else mesh.triangles[finite[mesh.triangles].all(axis=1)]
    return attributes, ctx.buffer(triangles.astype(np.uint32).tobytes() or bytes(12))  # GL refuses empty buffers


def _upload_texture(device: Device, texture: Texture) -> moderngl.Texture:
    ctx = device.ctx
    pixels = np.ascontiguousarray(texture.pixels[::-1])  # files are top-down, GL is bottom-up
    size = (pixels.shape[1], pixels.shape[0])
    if pixels.dtype == np.uint8:
        result = ctx.texture(size, 4, pixels.tobytes(), dtype="f1", internal_format=GL_SRGB8_ALPHA8)
    else:
        sanitized = np.nan_to_num(pixels, nan=0.0, posinf=65504.0, neginf=0.0).clip(0.0, 65504.0)
        result = ctx.texture(size, 4, sanitized.astype(np.float16).tobytes(), dtype="f2")
    result.build_mipmaps()
    result.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    result.anisotropy = device.anisotropy
    result.repeat_x, result.repeat_y = texture.repeat
    return result
