"""Packs a network's input tensors on the GPU, from the texels that stand for each grid's texels."""

from __future__ import annotations

from collections.abc import Callable

from app.channels import CHANNELS, CUBE
from app.contract import ModelContract, TensorSpec
from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass

# Which G-buffer targets each channel is made from; those with a question mark may be missing.
SOURCES: dict[str, tuple[str, ...]] = {
    "direct.rgb": ("direct",),
    "emission.rgb": ("emission?",),
    "radiance.rgb": ("direct", "emission?"),
    "albedo.rgb": ("albedo",),
    "normal.view.xyz": ("normal", "depth"),
    "normal.world.xyz": ("normal", "depth"),
    "position.view.xyz": ("depth",),
    "depth": ("depth",),
    "roughness": ("gloss?",),
    "solid_angle": ("depth",),
    "on_screen": (),
}
GROUP = 8  # local size of pack.comp
SURROUND = "surround_"


def tensor_name(tensor: str) -> str:
    """The graph's name of a network's input tensor."""
    return f"tensor_{tensor}"


def tensor_shape(spec: TensorSpec, grid: tuple[int, int]) -> tuple[int, ...]:
    """[C, h, w], or [C, 6, n, n], for a screen ``grid`` of width and height."""
    if spec.grid == CUBE:
        assert spec.size is not None
        return spec.components, 6, spec.size, spec.size
    return spec.components, grid[1], grid[0]


def declare(contract: ModelContract, tensor: str, size: tuple[int, int], extent: float) -> Pass:
    """Packs input ``tensor``; ``extent`` is the length of the scene's longest edge in scene units."""
    spec = contract.inputs[tensor]
    grid = contract.screen_size(size)
    reads, optional = _sources(spec)
    return Pass(f"downsample_{tensor}", reads=reads, optional=optional,
                writes={tensor_name(tensor): Buf(tensor_shape(spec, grid))},
                make=lambda device, bound: make(device, bound, contract, spec, grid, extent))


def make(device: Device, bound: BoundPass, contract: ModelContract, spec: TensorSpec, grid: tuple[int, int],
         extent: float) -> Callable[[FrameState, Resources], None]:
    cube = spec.grid == CUBE
    defines: dict[str, object] = {"HAS_" + r.removeprefix(SURROUND).upper(): 1 for r in bound.reads}
    defines["PACK_CHANNELS"] = _stores(spec)
    if cube:
        defines |= {"GRID_CUBE": 1, "CUBE_SIZE": spec.size}
        if contract.cube_axes == "camera":
            defines["CUBE_CAMERA_AXES"] = 1
    program = device.program("pack.comp", defines=defines)
    width, height = (spec.size or 0, spec.size or 0) if cube else grid
    groups = (-(-width // GROUP), -(-height // GROUP), 6 if cube else 1)

    def execute(frame: FrameState, resources: Resources) -> None:
        resources.bind(program, strip=SURROUND)
        resources.buffer(bound.writes[0]).bind_to_storage_buffer(0)
        span = (1.0, 1.0) if cube else (frame.size[0] / grid[0], frame.size[1] / grid[1])
        program.set(extent=contract.scene_extent / extent, texel_span=span, grid=(width, height))
        program.raw.run(*groups)
        device.ctx.memory_barrier()

    return execute


def _sources(spec: TensorSpec) -> tuple[tuple[str, ...], tuple[str, ...]]:
    prefix = SURROUND if spec.grid == CUBE else ""
    names = dict.fromkeys(source for channel in spec.channels for source in SOURCES[channel])
    return (tuple(prefix + n for n in names if not n.endswith("?")),
            tuple(prefix + n.removesuffix("?") for n in names if n.endswith("?")))


def _stores(spec: TensorSpec) -> str:
    lines, row = [], 0
    for name in spec.channels:
        lines.append(f"store({row}, channel_{name.replace('.', '_')}(t));")
        row += CHANNELS[name].components
    return " ".join(lines)
