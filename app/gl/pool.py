"""Textures, buffers and framebuffers for a plan, with ping-pong history."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import chain
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from app.arrays import F32
from app.errors import DeviceError, GraphError, SettingsError
from app.gl.context import Device
from app.gl.shader import Program
from app.graph import PREVIOUS, BoundPass, Buf, Plan, Tex

DTYPES: dict[str, type] = {"f1": np.uint8, "f2": np.float16, "f4": np.float32}

Pixels = NDArray[Any]


class Pool:
    """Owns what the passes of ``plan`` read and write, in frames of one size."""

    def __init__(self, device: Device, plan: Plan, size: tuple[int, int]) -> None:
        self._device, self._plan, self._size, self.parity = device, plan, size, 0
        self._textures: dict[str, list[moderngl.Texture]] = {}
        self._buffers: dict[str, moderngl.Buffer] = {}
        self._arrays: dict[str, F32] = {}
        self._stamps: dict[str, int] = {}
        self._targets: dict[tuple[tuple[str, ...], int, bool], moderngl.Framebuffer] = {}
        self._depths: dict[tuple[int, int], moderngl.Texture] = {}
        for name, resource in plan.resources.items():
            if isinstance(resource, Tex):
                copies = 2 if name in plan.history else 1
                self._textures[name] = [self._texture(resource, size) for _ in range(copies)]
            elif resource.on_host:
                self.write_array(name, np.zeros(resource.shape, np.float32))
            else:
                self._buffers[name] = device.ctx.buffer(reserve=4 * int(np.prod(resource.shape)))
        self._check_memory()

    def _check_memory(self) -> None:
        """GL does not refuse allocations that do not fit into memory; it only sets an error flag."""
        error = self._device.ctx.error
        if error == "GL_OUT_OF_MEMORY":
            raise DeviceError(f"not enough graphics memory for {self._size[0]}x{self._size[1]}", self._device.renderer,
                              "expected a smaller size")
        if error != "GL_NO_ERROR":
            raise DeviceError(f"can't allocate textures ({error})", self._device.renderer,
                              "expected an OpenGL 4.5 driver that accepts what the specification allows")

    def _texture(self, tex: Tex, size: tuple[int, int]) -> moderngl.Texture:
        width, height = tex.resolve(size)
        if max(width, height) > self._device.max_size:
            raise SettingsError(f"{width}x{height} is too large for {self._device.renderer}", "size",
                                f"expected at most {self._device.max_size} pixels a side")
        texture = self._device.ctx.texture((width, height), tex.components, dtype=tex.dtype)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        self._device.clear(texture)
        return texture

    def texture(self, name: str) -> moderngl.Texture:
        """The texture of ``name``, or of ``name@prev`` last frame's."""
        resource = name.removesuffix(PREVIOUS)
        copies = self._textures[resource]
        return copies[(self.parity + (resource != name)) % len(copies)]

    def buffer(self, name: str) -> moderngl.Buffer:
        return self._buffers[name]

    def array(self, name: str) -> F32:
        """A tensor on the CPU; read-only, and another object whenever its numbers are others."""
        return self._arrays[name]

    def write_array(self, name: str, values: F32) -> None:
        """Replace a tensor on the CPU; ``values`` must not be modified any more."""
        values.flags.writeable = False
        self._arrays[name] = values
        self.renew_stamp(name)

    def holds_texture(self, name: str) -> bool:
        return name.removesuffix(PREVIOUS) in self._textures

    def target(self, names: tuple[str, ...], with_depth: bool) -> moderngl.Framebuffer:
        """The framebuffer of textures ``names``; passes share depth buffers, which hold nothing for the next one."""
        key = (names, self.parity, with_depth)
        if key not in self._targets:
            colors = [self.texture(w) for w in names]
            depth = None
            if with_depth:
                size = colors[0].size
                if size not in self._depths:
                    self._depths[size] = self._device.depth_texture(size)
                    self._check_memory()
                depth = self._depths[size]
            self._targets[key] = self._device.ctx.framebuffer(colors, depth)
        return self._targets[key]

    def stamp(self, name: str) -> int:
        """A number that changes when a cached resource is made again or written from outside its pass."""
        return self._stamps.get(name, 0)

    def renew_stamp(self, name: str) -> None:
        self._stamps[name] = self.stamp(name) + 1

    def read(self, name: str, newest: bool = False) -> Pixels:
        """A resource as it lies on the GPU, top row first; half floats as float32.

        Parameters
        ----------
        newest : bool
            Between frames: the newest copy of a resource with a history, which was swapped at the frame's end.
        """
        resource = self._plan.resources[name]
        if name in self._arrays:
            return self._arrays[name]
        if isinstance(resource, Buf):
            return np.frombuffer(self._buffers[name].read(), np.float32).reshape(resource.shape)
        texture = self.texture(name + PREVIOUS if newest and name in self._plan.history else name)
        kind = DTYPES[resource.dtype]
        image: Pixels = np.frombuffer(texture.read(alignment=1), kind).reshape(texture.height, texture.width, -1)[::-1]
        return image.astype(np.float32) if kind is np.float16 else image

    def write(self, name: str, values: Pixels | float) -> None:
        """Replace a resource by a constant, an image [H, W, C] with its top row first, or a tensor."""
        resource = self._plan.resources[name]
        if isinstance(resource, Buf):
            tensor = np.broadcast_to(values, resource.shape).astype(np.float32)
            if resource.on_host:
                self.write_array(name, tensor)
                return
        self.renew_stamp(name)
        if isinstance(resource, Buf):
            self._buffers[name].write(tensor.tobytes())
            return
        texture = self.texture(name)
        shape = texture.height, texture.width, texture.components
        with np.errstate(invalid="ignore", over="ignore"):
            pixels: Pixels = np.broadcast_to(np.asarray(values, np.float32), shape)[::-1].astype(DTYPES[resource.dtype])
        texture.write(pixels.tobytes(), alignment=1)

    def count_non_finite(self, name: str) -> int:
        """Texels of a resource, or numbers of a tensor, that are NaN or infinite."""
        resource = self._plan.resources[name]
        if isinstance(resource, Tex) and resource.dtype == "f1":
            return 0
        components = 0 if isinstance(resource, Buf) else -1
        return int(np.count_nonzero(~np.isfinite(self.read(name)).all(axis=components)))

    def swap(self) -> None:
        """Make this frame's textures last frame's."""
        self.parity ^= 1

    def take_history(self, other: Pool) -> None:
        """Between frames: go on with the histories of ``other``, resampled where sizes differ; clear those it lacks."""
        for name in self._plan.history:
            target = self._framebuffer(name + PREVIOUS)
            if name in other._plan.history:
                self._device.blit(other._framebuffer(name + PREVIOUS), target)
            else:
                target.clear()  # of an older picture, or never written

    def _framebuffer(self, name: str) -> moderngl.Framebuffer:
        """A framebuffer of the texture of ``name``, or of ``name@prev``, alone."""
        key = ((name,), self.parity, False)
        if key not in self._targets:
            self._targets[key] = self._device.ctx.framebuffer([self.texture(name)])
        return self._targets[key]

    def release(self) -> None:
        owned: Iterable[Any] = chain(self._targets.values(), *self._textures.values(), self._depths.values(),
                                     self._buffers.values())
        for resource in owned:
            resource.release()


class Resources:
    """One pass's window on the pool: touching what it did not declare is an error."""

    def __init__(self, pool: Pool, bound: BoundPass) -> None:
        self._pool, self._bound = pool, bound
        self._made_from: dict[tuple[str, ...], object] = {}

    def __getitem__(self, name: str) -> moderngl.Texture:
        self._check(name, (*self._bound.reads, *self._bound.writes))
        return self._pool.texture(name)

    def buffer(self, name: str) -> moderngl.Buffer:
        self._check(name, (*self._bound.reads, *self._bound.writes))
        return self._pool.buffer(name)

    def array(self, name: str) -> F32:
        """A tensor on the CPU, as ``Pool.array`` gives it."""
        self._check(name, self._bound.reads)
        return self._pool.array(name)

    def write_array(self, name: str, values: F32) -> None:
        """Replace a tensor on the CPU; ``values`` must not be modified any more."""
        self._check(name, self._bound.writes)
        self._pool.write_array(name, values)

    def rows(self, name: str) -> F32:
        """A tensor on the CPU of shape (C, N) as N rows, shape (N, C)."""
        return np.ascontiguousarray(self.array(name).T)

    def target(self, *names: str, with_depth: bool = False) -> moderngl.Framebuffer:
        """The framebuffer of ``names``, or of everything the pass writes, bound for drawing."""
        for name in names:
            self._check(name, self._bound.writes)
        target = self._pool.target(names or self._bound.writes, with_depth)
        target.use()
        return target

    def bind(self, program: Program, strip: str = "", reads: tuple[str, ...] | None = None,
             samplers: Mapping[str, str] | None = None) -> None:
        """Bind the textures that the pass reads to the sampler uniforms of their names.

        Parameters
        ----------
        strip : str
            Prefix of resource names that samplers lack; ``@prev`` becomes ``_prev``.
        reads : tuple of str, optional
            The resources that ``program`` uses; all that the pass reads by default.
        samplers : mapping of str to str, optional
            Samplers with names of their own, by resource.
        """
        textures = [r for r in (self._bound.reads if reads is None else reads) if self._pool.holds_texture(r)]
        for unit, name in enumerate(textures):
            self._pool.texture(name).use(unit)
            sampler = (samplers or {}).get(name, name.replace(PREVIOUS, "_prev").removeprefix(strip))
            program.set(**{sampler: unit})

    def read_stamps(self, *names: str) -> tuple[int, ...]:
        """Stamps of ``names``, or of all that the pass reads, of which only cached resources change theirs."""
        return tuple(self._pool.stamp(name) for name in names or self._bound.reads)

    def is_current(self, key: object, *names: str) -> bool:
        """Whether ``names``, or all that the pass writes, hold what ``set_current`` noted for an equal ``key``."""
        names = names or self._bound.writes
        return self._made_from.get(names) == (key, self._write_stamps(names))

    def set_current(self, key: object, *names: str) -> None:
        """Note that ``names``, or all that the pass writes, were made from ``key`` just now."""
        names = names or self._bound.writes
        for name in names:
            self._pool.renew_stamp(name)
        self._made_from[names] = key, self._write_stamps(names)

    def _write_stamps(self, names: tuple[str, ...]) -> tuple[int, ...]:
        return tuple(self._pool.stamp(name) for name in names)

    def _check(self, name: str, declared: tuple[str, ...]) -> None:
        if name not in declared:
            raise GraphError(f"the pass touches {name!r}, which it does not declare", f"pass {self._bound.name!r}",
                             f"expected one of: {', '.join(declared)}")
