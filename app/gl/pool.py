"""Textures, buffers and framebuffers for a plan, with ping-pong history."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from app.errors import DeviceError, GraphError, SettingsError
from app.gl.context import Device
from app.gl.shader import Program
from app.graph import PREVIOUS, BoundPass, Buf, Plan, Tex


class Pool:
    """Owns what the passes of ``plan`` read and write, for one output size."""

    def __init__(self, device: Device, plan: Plan, size: tuple[int, int]) -> None:
        if max(size) > device.max_size:
            raise SettingsError(f"bad size {size[0]}x{size[1]}", "--size",
                                f"expected at most {device.max_size} pixels a side on {device.renderer}")
        self._device, self._size, self.parity = device, size, 0
        self._textures: dict[str, list[moderngl.Texture]] = {}
        self._buffers: dict[str, moderngl.Buffer] = {}
        self._targets: dict[tuple[tuple[str, ...], int], moderngl.Framebuffer] = {}
        self._depths: dict[str, moderngl.Texture] = {}
        for name, resource in plan.resources.items():
            if isinstance(resource, Buf):
                self._buffers[name] = device.ctx.buffer(reserve=4 * int(np.prod(resource.shape)))
            else:
                copies = 2 if name in plan.history else 1
                self._textures[name] = [self._texture(resource, size) for _ in range(copies)]
        self._check_memory()

    def _check_memory(self) -> None:
        """GL does not refuse what it has no memory for; it only keeps a note of it."""
        if self._device.ctx.error != "GL_NO_ERROR":
            raise DeviceError(f"not enough graphics memory for {self._size[0]}x{self._size[1]}", self._device.renderer,
                              "expected a smaller --size")

    def _texture(self, tex: Tex, size: tuple[int, int]) -> moderngl.Texture:
        texture = self._device.ctx.texture(tex.resolve(size), tex.components, dtype=tex.dtype)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture

    def texture(self, name: str) -> moderngl.Texture:
        """The texture of ``name``, or of ``name@prev`` last frame's."""
        resource = name.removesuffix(PREVIOUS)
        copies = self._textures[resource]
        return copies[(self.parity + (resource != name)) % len(copies)]

    def buffer(self, name: str) -> moderngl.Buffer:
        return self._buffers[name]

    def holds_texture(self, name: str) -> bool:
        return name.removesuffix(PREVIOUS) in self._textures

    def target(self, bound: BoundPass, names: tuple[str, ...], with_depth: bool) -> moderngl.Framebuffer:
        """The framebuffer of textures ``names``; the depth buffer belongs to the pass."""
        key = (names, self.parity)
        if key not in self._targets:
            colors = [self.texture(w) for w in names]
            depth = None
            if with_depth:
                if bound.name not in self._depths:
                    self._depths[bound.name] = self._device.depth_texture(colors[0].size)
                    self._check_memory()
                depth = self._depths[bound.name]
            self._targets[key] = self._device.ctx.framebuffer(colors, depth)
        return self._targets[key]

    def swap(self) -> None:
        """Make this frame's textures last frame's."""
        self.parity ^= 1

    def release(self) -> None:
        for target in self._targets.values():
            target.release()
        for texture in (t for copies in self._textures.values() for t in copies):
            texture.release()
        for depth in self._depths.values():
            depth.release()
        for buffer in self._buffers.values():
            buffer.release()


class Resources:
    """One pass's window on the pool: touching what it did not declare is an error."""

    def __init__(self, pool: Pool, bound: BoundPass) -> None:
        self._pool, self._bound = pool, bound

    def __getitem__(self, name: str) -> moderngl.Texture:
        self._check(name, (*self._bound.reads, *self._bound.writes))
        return self._pool.texture(name)

    def buffer(self, name: str) -> moderngl.Buffer:
        self._check(name, (*self._bound.reads, *self._bound.writes))
        return self._pool.buffer(name)

    def target(self, *names: str, with_depth: bool = False) -> moderngl.Framebuffer:
        """The framebuffer of ``names``, or of everything the pass writes, bound for drawing."""
        for name in names:
            self._check(name, self._bound.writes)
        target = self._pool.target(self._bound, names or self._bound.writes, with_depth)
        target.use()
        return target

    def bind(self, program: Program, strip: str = "", reads: tuple[str, ...] | None = None,
             samplers: Mapping[str, str] | None = None) -> None:
        """Bind every texture read to its sampler uniform: same name, ``@prev`` as ``_prev``, without ``strip``.

        ``reads`` are those that ``program`` has a use for, all without it; ``samplers`` gives those of other names.
        """
        textures = [r for r in (self._bound.reads if reads is None else reads) if self._pool.holds_texture(r)]
        for unit, name in enumerate(textures):
            self._pool.texture(name).use(unit)
            sampler = (samplers or {}).get(name, name.replace(PREVIOUS, "_prev").removeprefix(strip))
            program.set(**{sampler: unit})

    def _check(self, name: str, declared: tuple[str, ...]) -> None:
        if name not in declared:
            raise GraphError(f"pass {self._bound.name!r} touches {name!r}", "frame graph",
                             "expected one of its declared reads and writes: " + ", ".join(declared))
