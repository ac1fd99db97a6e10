"""The scene on the GPU: vertex buffers, instances, textures, and culled draws.

One call (``glMultiDrawElementsIndirect``) draws all instances that share a surface and the layout of their vertices.
What differs among them is in a buffer with a row for each instance.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from app.arrays import F64, Bools, Ints
from app.gl.context import Device
from app.gl.shader import Program
from app.gl.surface import MAP_UNITS, NORMAL_MAPS, Surface, describe_surface
from app.gl.vertex_buffers import DeformedVertices, VertexBuffers, attribute_names, upload_meshes
from app.math3d import boxes_in_frustum, frustum_planes, normal_matrix
from app.scene import Scene, Texture, world_box

GL_SRGB8_ALPHA8 = 0x8C43
# Rows of the matrices to relative space now and one frame ago, and of the normals' with a number each: instance.glsl.
INSTANCE_ATTRIBUTES = tuple(f"in_{matrix}_{axis}" for matrix in ("relative", "previous", "normal") for axis in "xyz")
RELATIVE_ROWS, PREVIOUS_ROWS, NORMAL_ROWS = slice(0, 3), slice(3, 6), slice(6, 9)
COMMAND_SIZE = 5    # numbers of indices and instances, first index, vertex and instance
MIN_SCALE = 1e-30
SPREAD_SCALE = 4.0  # of the square of what tilts normals, in the alpha of their maps, as in normal_map.glsl


@dataclass(frozen=True, eq=False)
class Batch:
    """Instances that one draw can draw."""

    surface: Surface
    buffers: VertexBuffers


class GpuScene:
    """Uploads ``scene`` once; ``update`` moves and deforms its instances, ``draw`` draws some of them.

    Attributes
    ----------
    boxes : ndarray, float64, shape (N, 2, 3)
        Around each instance, in world space.
    is_see_through, is_light_proxy : ndarray of bool, shape (N,)
        Of each instance's material.
    time : float
        Seconds, of the newest update.
    changes : int
        How often any instance has moved.
    """

    def __init__(self, device: Device, scene: Scene) -> None:
        self._device, self.scene = device, scene
        self._textures: dict[tuple[object, ...], moderngl.Texture] = {}
        self._samplers: dict[tuple[object, ...], moderngl.Sampler] = {}
        self._arrays: dict[tuple[int, int], moderngl.VertexArray] = {}
        self._applied: dict[int, Surface] = {}  # whose uniforms a program has
        self._deformed = {k: DeformedVertices(device.ctx, i.mesh_at(scene.meshes, 0.0))
                          for k, i in enumerate(scene.instances) if i.deformation is not None}
        self.batches, self._batch_of, self._commands = self._make_batches()
        materials = [scene.meshes[i.mesh].material for i in scene.instances]
        self.is_see_through = np.array([scene.materials[m].is_see_through for m in materials], bool)
        self.is_volume = np.array([scene.materials[m].is_volume for m in materials], bool)
        self.is_light_proxy = np.array([scene.materials[m].is_light_proxy for m in materials], bool)
        count = len(scene.instances)
        self._rows = np.zeros((count, len(INSTANCE_ATTRIBUTES), 4), np.float32)
        self._rows[:, 6, 3], self._rows[:, 7, 3] = np.arange(count) + 1, np.array(materials, np.int64) + 1
        self._instances = device.ctx.buffer(reserve=max(self._rows.nbytes, 4))  # GL refuses empty buffers
        self._indirect = device.ctx.buffer(reserve=max(self._commands.nbytes, 4))
        self._uploaded: tuple[object, ...] = ()
        self._revision = 0  # of transforms and previous ones
        self._moving = [k for k, i in enumerate(scene.instances) if i.moves]
        self.transforms: F64 = np.array([i.transform for i in scene.instances], np.float64).reshape(-1, 4, 4)
        self.previous = self.transforms
        self.boxes = np.array([self._box(i, 0.0) for i in range(count)]).reshape(-1, 2, 3)
        self._is_mirrored = np.zeros(count, bool)
        self._place(range(count))
        self._order, self._runs = self._sort()
        self._time: float | None = None
        self.time, self.changes = 0.0, 0
        self.update(0.0, cut=True)

    def update(self, time: float, cut: bool = False) -> None:
        """Move all instances to where they are at ``time`` seconds; ``cut`` makes last frame's transforms the same."""
        self.time = time
        self._set_previous(self.transforms)
        for vertices in self._deformed.values():
            vertices.advance()
        if self._time is None or (self._moving and time != self._time):
            self.changes += self._move(time) or self._time is None
            self._time = time
        if cut:
            self._set_previous(self.transforms)
            for vertices in self._deformed.values():
                vertices.advance()

    def _set_previous(self, transforms: F64) -> None:
        if self.previous is not transforms:
            self.previous = transforms
            self._revision += 1

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
            self._revision += 1
            self._place(self._moving)
            for index in self._moving:
                self.boxes[index] = self._box(index, time)
        return moved

    def _place(self, instances: Iterable[int]) -> None:
        """Note what draws need of the present transforms of some instances besides their matrices."""
        mirrored = self._is_mirrored.copy()
        for k in instances:
            cofactor, determinant = normal_matrix(self.transforms[k]), float(np.linalg.det(self.transforms[k, :3, :3]))
            self._rows[k, NORMAL_ROWS, :3] = cofactor / max(float(np.abs(cofactor).max()), 1e-30)
            mirrored[k] = determinant < 0
            self._rows[k, 8, 3] = (-1.0 if mirrored[k] else 1.0) * max(abs(determinant) ** (1 / 3), MIN_SCALE)
        if (mirrored != self._is_mirrored).any():
            self._is_mirrored = mirrored
            self._order, self._runs = self._sort()

    def _box(self, index: int, time: float) -> F64:
        return world_box(self.scene.instances[index].mesh_at(self.scene.meshes, time), self.transforms[index])

    @contextmanager
    def looking_ahead(self, time: float) -> Iterator[None]:
        """In place of where and how instances were in the previous frame, have what they are at ``time`` seconds."""
        previous, following = self.previous, self.transforms.copy()
        for index in self._moving:
            following[index] = self.scene.instances[index].transform_at(time)
        self._set_previous(following)
        for index, vertices in self._deformed.items():
            vertices.write_previous(self.scene.instances[index].mesh_at(self.scene.meshes, time).positions)
        try:
            yield
        finally:
            self._set_previous(previous)
            for vertices in self._deformed.values():
                vertices.restore_previous()

    def visible(self, clip: F64, origin: F64) -> Bools:
        """Which instances may touch the frustum of ``clip``, which takes points relative to ``origin``; shape (N,)."""
        return boxes_in_frustum(self.boxes - origin, frustum_planes(clip))

    def draw(self, instances: Bools, program_of: Callable[[tuple[str, ...]], Program], origin: F64,
             previous_origin: F64 | None = None, one_level: bool = False, for_light: bool = False,
             only_backs: bool = False) -> None:
        """Draw some instances, a mask of shape (N,); matrices lead to space relative to ``origin``.

        Parameters
        ----------
        program_of : callable
            The program for surfaces of given features, called once for each.
        one_level : bool
            Whether textures are looked up in the nearest level of detail instead of the two around.
        for_light : bool
            Whether light is to be blocked, which passes fewer backs than cameras see through.
        only_backs : bool
            Whether to draw the backs of surfaces, and those alone.
        """
        drawn = instances[self._order]
        if not drawn.any():
            return
        self._upload_instances(origin, origin if previous_origin is None else previous_origin)
        self._indirect.write(self._commands[self._order[drawn]])
        programs: dict[tuple[str, ...], Program] = {}
        first = 0
        for batch, is_mirrored, begin, end in self._runs:
            count = int(np.count_nonzero(drawn[begin:end]))
            if not count:
                continue
            features = batch.surface.features
            if features not in programs:
                programs[features] = program_of(features)
            self._apply(programs[features], batch.surface, is_mirrored, one_level, for_light, only_backs)
            array = self._array(programs[features], batch.buffers)
            array.render_indirect(self._indirect, moderngl.TRIANGLES, count, first)
            first += count
        if one_level:
            self._device.ctx.clear_samplers(0, len(MAP_UNITS))

    def _upload_instances(self, origin: F64, previous_origin: F64) -> None:
        key = self._revision, origin.tobytes(), previous_origin.tobytes()
        if key == self._uploaded:
            return
        self._uploaded = key
        for rows, transforms, point in ((RELATIVE_ROWS, self.transforms, origin),
                                        (PREVIOUS_ROWS, self.previous, previous_origin)):
            self._rows[:, rows, :3] = transforms[:, :3, :3]
            self._rows[:, rows, 3] = transforms[:, :3, 3] - point
        self._instances.write(self._rows)

    def _apply(self, program: Program, surface: Surface, is_mirrored: bool, one_level: bool, for_light: bool,
               only_backs: bool) -> None:
        """Set the state, textures and uniforms of a surface."""
        ctx = self._device.ctx
        if only_backs or (surface.material.is_lit_through if for_light else surface.material.is_one_sided):
            ctx.enable(moderngl.CULL_FACE)
            ctx.cull_face = "front" if is_mirrored != only_backs else "back"
        else:
            ctx.disable(moderngl.CULL_FACE)
        for name, texture in surface.maps.items():
            if name in program:
                self._texture(texture, name in NORMAL_MAPS).use(MAP_UNITS[name])
                if one_level:
                    self._sampler(texture).use(MAP_UNITS[name])
        if self._applied.get(program.glo) is not surface:
            program.set(**{name: value for name, value in surface.uniforms.items() if name in program})
            self._applied[program.glo] = surface

    def _array(self, program: Program, buffers: VertexBuffers) -> moderngl.VertexArray:
        key = (program.glo, id(buffers))
        if key not in self._arrays:
            content: list[tuple[Any, ...]] = [(buffer, kind, name)
                                              for name, (buffer, kind) in buffers.attributes.items() if name in program]
            used = [name for name in INSTANCE_ATTRIBUTES if name in program]
            formats = " ".join("4f4" if name in used else "16x" for name in INSTANCE_ATTRIBUTES)
            content.append((self._instances, f"{formats}/i", *used))
            self._arrays[key] = self._device.ctx.vertex_array(program.raw, content, buffers.indices)
        return self._arrays[key]

    def _upload(self) -> dict[int, tuple[VertexBuffers, tuple[int, int, int]]]:
        """The buffers of each instance, and its range in them."""
        scene, ctx = self.scene, self._device.ctx
        layouts: dict[tuple[str, ...], list[int]] = {}
        for mesh in sorted({i.mesh for i in scene.instances if i.deformation is None}):
            layouts.setdefault(attribute_names(scene.meshes[mesh]), []).append(mesh)
        ranges: dict[int, tuple[VertexBuffers, tuple[int, int, int]]] = {}
        for meshes in layouts.values():
            buffers = upload_meshes(ctx, [scene.meshes[mesh] for mesh in meshes])
            ranges |= {mesh: (buffers, part) for mesh, part in zip(meshes, buffers.ranges, strict=True)}
        return {k: ranges[i.mesh] if i.deformation is None
                else (self._deformed[k].buffers, self._deformed[k].buffers.ranges[0])
                for k, i in enumerate(scene.instances)}

    def _make_batches(self) -> tuple[list[Batch], Ints, NDArray[np.uint32]]:
        """The batches sorted by features, that of each instance, shape (N,), and the commands, shape (N, 5)."""
        scene, uploaded = self.scene, self._upload()
        batches: dict[tuple[int, int], Batch] = {}
        keys = []
        for k, (instance, (buffers, _)) in enumerate(zip(scene.instances, uploaded.values(), strict=True)):
            mesh = scene.meshes[instance.mesh]
            keys.append((mesh.material, id(buffers)))
            if keys[k] not in batches:
                surface = describe_surface(instance, mesh, scene.materials[mesh.material])
                batches[keys[k]] = Batch(surface, buffers)
        order = sorted(batches, key=lambda key: batches[key].surface.features)
        commands = [(count, 1, index, vertex, k) for k, (_, (count, index, vertex)) in uploaded.items()]
        return ([batches[key] for key in order], np.array([order.index(key) for key in keys], np.int64),
                np.array(commands, np.uint32).reshape(-1, COMMAND_SIZE))

    def _sort(self) -> tuple[Ints, list[tuple[Batch, bool, int, int]]]:
        """The instances in the order of drawing, shape (N,), and runs: batch, whether mirrored, first and last + 1."""
        culled = np.array([m.is_one_sided or m.is_volume for m in (b.surface.material for b in self.batches)], bool)
        is_mirrored = self._is_mirrored & culled[self._batch_of]
        key = 2 * self._batch_of + is_mirrored
        order = np.argsort(key, kind="stable")
        values, begin, counts = np.unique(key[order], return_index=True, return_counts=True)
        runs = np.stack([values, begin, begin + counts], axis=1).tolist()
        return order, [(self.batches[value // 2], bool(value % 2), first, end) for value, first, end in runs]

    def _texture(self, texture: Texture, is_normal_map: bool) -> moderngl.Texture:
        key = id(texture.pixels), texture.is_color, texture.repeat, texture.magnified, is_normal_map
        if key not in self._textures:
            self._textures[key] = _upload_texture(
                self._device, replace(texture, pixels=_with_spread(texture.pixels)) if is_normal_map else texture)
        return self._textures[key]

    def _sampler(self, texture: Texture) -> moderngl.Sampler:
        """Reads ``texture`` as it would be read, but in one level of detail."""
        key = texture.repeat, texture.magnified
        if key not in self._samplers:
            self._samplers[key] = self._device.ctx.sampler(
                *texture.repeat, filter=(moderngl.LINEAR_MIPMAP_NEAREST, _magnification(texture)),
                anisotropy=self._device.anisotropy)
        return self._samplers[key]

    def release(self) -> None:
        buffers = {id(batch.buffers): batch.buffers for batch in self.batches}
        owned: Iterable[Any] = chain(self._arrays.values(), self._textures.values(), self._samplers.values(),
                                     buffers.values(), (self._instances, self._indirect))
        for resource in owned:
            resource.release()


def _with_spread(pixels: NDArray[Any]) -> NDArray[Any]:
    """A normal map with the square of what tilts its normals in alpha, so that coarser levels know its mean."""
    most = 255 if pixels.dtype == np.uint8 else 1.0
    tilt = 2 * np.asarray(pixels[..., :2], np.float32) / most - 1
    spread = np.minimum(SPREAD_SCALE * (tilt * tilt).sum(axis=-1, keepdims=True), 1) * most
    return np.concatenate([pixels[..., :3], np.round(spread).astype(np.uint8) if most == 255 else spread], axis=-1)


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
    result.filter = moderngl.LINEAR_MIPMAP_LINEAR, _magnification(texture)
    result.anisotropy = device.anisotropy
    result.repeat_x, result.repeat_y = texture.repeat
    return result


def _magnification(texture: Texture) -> int:
    return moderngl.LINEAR if texture.magnified == "linear" else moderngl.NEAREST
