"""Prepares a network's inputs on the GPU, as ``app.network.inputs`` does on the CPU, and unpacks its light."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import moderngl
import numpy as np

from app.gl.context import Device
from app.gl.shader import Program
from app.network.channels import CHANNELS, GLOBALS, PANORAMA, RAYS, SCREEN
from app.network.contract import ModelContract, TensorSpec
from app.network.inputs import MAX_RATIO_TO_MEAN, MIN_MEAN_RADIANCE, surface_guides

SUM_GROUP, EXPOSE_GROUP = 256, 64  # local sizes of sum_radiance.comp and expose.comp
MAX_SUMS = 64                      # workgroups that sum one tensor
MAX_EXPOSE_GROUPS = 65535          # as many as every OpenGL takes
PACKED, GUIDE, MEAN_RADIANCE, EXPOSED, LIGHT = range(5)  # bindings of buffers

Buffers = Mapping[str, moderngl.Buffer]
Step = Callable[[Buffers], None]


def is_exposed(spec: TensorSpec) -> bool:
    """Whether an input is exposed here; others hold no light, nor surfaces that light is on."""
    return spec.has_radiance or spec.grid not in (RAYS, GLOBALS)


class Exposure:
    """Turns packed tensors into what a network is fed, and what it has written into light.

    Parameters
    ----------
    exposed : mapping of str to Buffer
        The inputs of the graph, with the batch and the padded grid.
    size : tuple of int
        Width and height of the screen grid.
    """

    def __init__(self, device: Device, contract: ModelContract, exposed: Buffers, size: tuple[int, int]) -> None:
        self._device, self._contract, self._exposed, self._size = device, contract, exposed, size
        self._shapes = contract.padded_shapes(contract.inputs, size)
        self._guides = surface_guides(contract)
        packed = {t: spec for t, spec in contract.inputs.items() if is_exposed(spec)}
        self._has_mean = contract.exposure != "none" and any(spec.has_radiance for spec in packed.values())
        summed = {t: min(MAX_SUMS, -(-self._plane(t) // SUM_GROUP)) for t, spec in packed.items()
                  if spec.has_radiance and spec.grid != GLOBALS}
        count = max(sum(summed.values()), 1)
        self._defines: dict[str, object] = {}
        if self._has_mean:
            self._defines = {"HAS_MEAN": 1, "MAX_RATIO_TO_MEAN": MAX_RATIO_TO_MEAN,
                             "MIN_MEAN_RADIANCE": MIN_MEAN_RADIANCE}
        self._means = device.ctx.buffer(bytes(4 * 2 * (1 + count)))
        self._steps: list[Step] = []
        if self._has_mean:
            for index in range(2):
                first = 0
                for tensor, groups in summed.items():
                    self._steps.append(self._sum(tensor, first, groups, index))
                    first += groups
                self._steps.append(self._mean(index))
        self._steps += [self._expose(tensor) for tensor in packed]
        self._unpack_program = device.fullscreen("unpack.frag", self._defines)

    def expose(self, packed: Buffers) -> None:
        """Fill the inputs that are exposed here, each from its ``TensorSpec.shape``, which may be the same buffer."""
        self._means.bind_to_storage_buffer(MEAN_RADIANCE)
        for step in self._steps:
            step(packed)

    def unpack(self, output: moderngl.Buffer, shape: tuple[int, ...], row: int) -> None:
        """Draw the light in three channels of an output on the screen, from ``row`` on, into the bound framebuffer."""
        output.bind_to_storage_buffer(LIGHT)
        self._means.bind_to_storage_buffer(MEAN_RADIANCE)
        self._unpack_program.set(grid=self._size, padded=shape[:1:-1], row=row)
        self._device.ctx.enable_only(moderngl.NOTHING)
        self._device.draw_fullscreen(self._unpack_program)

    def read_mean(self) -> np.float32:
        """What radiance was divided by, read back from the GPU; 1 if it was not."""
        return np.frombuffer(self._means.read(8), np.float32)[1] if self._has_mean else np.float32(1)

    def release(self) -> None:
        """Free the buffer of means."""
        self._means.release()

    def _plane(self, tensor: str) -> int:
        """Numbers in one channel of a packed tensor."""
        return math.prod(self._contract.inputs[tensor].shape(self._size)[1:])

    def _sum(self, tensor: str, first: int, groups: int, index: int) -> Step:
        spec = self._contract.inputs[tensor]
        calls = [f"add({rows.start}, {rows.stop - rows.start}, {channel.range[1]}, "
                 f"{'surface' if self._is_masked(spec, name) else '1.0'}, texel);"
                 for name, rows in spec.rows() for channel in [CHANNELS[name]] if channel.radiance]
        program = self._device.program("sum_radiance.comp", defines={
            **self._defines, **self._guide_defines(spec), "ADD_CHANNELS": " ".join(calls)})
        is_capped = index == 1 and spec.grid != PANORAMA  # the only small lit area around the camera is no firefly

        def run(packed: Buffers) -> None:
            self._bind(tensor, packed)
            self._run(program, groups, plane=self._plane(tensor), first=first, is_capped=is_capped)

        return run

    def _mean(self, index: int) -> Step:
        program = self._device.program("mean_radiance.comp", defines=self._defines)
        return lambda packed: self._run(program, 1, index=index)

    def _expose(self, tensor: str) -> Step:
        spec = self._contract.inputs[tensor]
        calls = []
        for name, rows in spec.rows():
            channel = CHANNELS[name]
            factor = ("1.0" if not (channel.radiance and self._has_mean)
                      else "exposure * surface" if self._is_masked(spec, name) else "exposure")
            calls.append(f"put({rows.start}, {rows.stop - rows.start}, {channel.background}, {channel.range[0]}, "
                         f"{channel.range[1]}, {factor});")
        program = self._device.program("expose.comp", defines={
            **self._defines, **self._guide_defines(spec), "PUT_CHANNELS": " ".join(calls)})
        grid = self._size if spec.grid == SCREEN else (self._plane(tensor), 1)
        padded = self._shapes[tensor][:1:-1] if spec.grid == SCREEN else grid
        groups = min(MAX_EXPOSE_GROUPS, -(-math.prod(padded) // EXPOSE_GROUP))

        def run(packed: Buffers) -> None:
            self._bind(tensor, packed)
            self._exposed[tensor].bind_to_storage_buffer(EXPOSED)
            self._run(program, groups, plane=self._plane(tensor), grid=grid, padded=padded)

        return run

    def _is_masked(self, spec: TensorSpec, name: str) -> bool:
        """Whether a channel's radiance counts on surfaces alone."""
        return not CHANNELS[name].sky and spec.grid in self._guides

    def _guide_defines(self, spec: TensorSpec) -> dict[str, object]:
        """Where a tensor's guide shows surfaces; none without exposure, which alone needs them."""
        if spec.grid not in self._guides or not (self._has_mean and spec.has_radiance):
            return {}
        tensor, name = self._guides[spec.grid]
        low, high = CHANNELS[name].range
        return {"GUIDE_ROW": dict(self._contract.inputs[tensor].rows())[name].start,
                "GUIDE_COMPONENTS": CHANNELS[name].components, "GUIDE_LOW": low, "GUIDE_HIGH": high}

    def _bind(self, tensor: str, packed: Buffers) -> None:
        packed[tensor].bind_to_storage_buffer(PACKED)
        guide, _ = self._guides.get(self._contract.inputs[tensor].grid, (tensor, ""))
        packed[guide].bind_to_storage_buffer(GUIDE)

    def _run(self, program: Program, groups: int, **uniforms: object) -> None:
        program.set(**uniforms)
        program.raw.run(groups)
        self._device.ctx.memory_barrier()
