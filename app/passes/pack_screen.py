"""Packs a network's input tensors on screen, cube and panorama, on the GPU, from the texels nearest to each grid's."""

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import CUBE_PREFIX, cube_defines, ratio_to
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass
from app.network.channels import CHANNELS, PANORAMA, SCREEN, SEEN
from app.network.contract import ModelContract, TensorSpec
from app.radiance_scale import reflected_radiance
from app.scene import Scene

# The targets that each channel is made from; those with a question mark may be missing.
SOURCES: dict[str, tuple[str, ...]] = {
    "direct.rgb": ("direct",),
    "emission.rgb": ("emission?",),
    "radiance.rgb": ("direct", "emission?"),
    "surface_and_sky_radiance.rgb": ("direct", "emission?", "background?"),
    "albedo.rgb": ("albedo",),
    "normal.view.xyz": ("normal", "depth"),
    "normal.world.xyz": ("normal", "depth"),
    "position.view.xyz": ("depth",),
    "depth": ("depth",),
    "roughness": ("specular_roughness?",),
    "solid_angle": ("depth",),
    "on_screen": (),
    "gathered.rgb": ("gathered_light", "emission?"),
    "gathered.count": ("gathered_light",),
    "gathered.distance": ("gathered_surfels",),
    "interpolated.rgb": ("gathered_surfels",),
    "unshadowed_environment.diffuse.rgb": ("unshadowed_diffuse",),
    "unshadowed_environment.specular.rgb": ("unshadowed_specular?",),
}
GROUP = 8  # local size of pack_screen.comp


def tensor_names(contract: ModelContract) -> dict[str, str]:
    """The graph's name of each input tensor of a network."""
    kind = "environment_tensor" if contract.shades_environment else "tensor"
    return {t: f"{kind}_{t}" for t in contract.inputs}


def declare(name: str, contract: ModelContract, size: tuple[int, int], scene: Scene,
            normals: str = "normal") -> Pass:
    """The pass ``name``; ``normals`` are those of the screen."""
    grid = contract.screen_size(size)
    specs = {t: spec for t, spec in contract.inputs.items() if spec.grid in SEEN}
    names = dict.fromkeys(name for spec in specs.values() for name in _sources(spec, normals))
    buffers = tensor_names(contract)
    return Pass(name, reads=tuple(n for n in names if not n.endswith("?")),
                optional=tuple(n.removesuffix("?") for n in names if n.endswith("?")),
                writes={buffers[t]: Buf(spec.shape(grid)) for t, spec in specs.items()},
                make=lambda device, bound: make(device, bound, contract, grid, scene, normals))


def make(device: Device, bound: BoundPass, contract: ModelContract, grid: tuple[int, int], scene: Scene,
         normals: str) -> Execute:
    packers = [_packer(device, bound, contract, t, grid, scene, normals)
               for t, spec in contract.inputs.items() if spec.grid in SEEN]

    def execute(frame: FrameState, resources: Resources) -> None:
        for pack in packers:
            pack(frame, resources)
        device.ctx.memory_barrier()

    return execute


def _packer(device: Device, bound: BoundPass, contract: ModelContract, tensor: str, grid: tuple[int, int],
            scene: Scene, normals: str) -> Execute:
    spec = contract.inputs[tensor]
    sources = [name.removesuffix("?") for name in _sources(spec, normals)]
    reads = tuple(r for r in bound.reads if r in sources)
    samplers = {r: "normal" if r == normals else r.removeprefix(CUBE_PREFIX) for r in reads}
    defines: dict[str, object] = {"HAS_" + sampler.upper(): 1 for sampler in samplers.values()}
    defines["PACK_CHANNELS"] = _stores(spec)
    if spec.face is not None:
        defines |= cube_defines(spec.face, contract.cube_axes == "camera")
    glow: dict[str, float] = {}
    if "gathered.rgb" in spec.channels:  # whose grid shows no lamps
        defines["WITHOUT_LAMPS"], glow = 1, {"least_glow": reflected_radiance(scene)}
    if spec.grid == PANORAMA:
        defines["PANORAMA"] = 1
    program = device.program("pack_screen.comp", defines=defines)
    *images, height, width = spec.shape(grid)[1:]
    buffer = tensor_names(contract)[tensor]
    groups = (-(-width // GROUP), -(-height // GROUP), *(images or [1]))

    def pack(frame: FrameState, resources: Resources) -> None:
        resources.bind(program, reads=reads, samplers=samplers)
        resources.buffer(buffer).bind_to_storage_buffer(0)
        span = ratio_to(grid, frame) if spec.grid == SCREEN else (1.0, 1.0)
        program.set(extent=contract.scene_extent / scene.longest_edge, texel_span=span, grid=(width, height), **glow)
        program.raw.run(*groups)

    return pack


def _sources(spec: TensorSpec, normals: str) -> tuple[str, ...]:
    """The targets that a tensor is made from, as in ``SOURCES``, with these ``normals`` of the screen."""
    sources = dict.fromkeys(source for channel in spec.channels for source in SOURCES[channel])
    if spec.grid != SCREEN:
        return tuple(CUBE_PREFIX + source for source in sources)
    return tuple(normals if source == "normal" else source for source in sources)


def _stores(spec: TensorSpec) -> str:
    lines, row = [], 0
    for name in spec.channels:
        lines.append(f"store({row}, channel_{name.replace('.', '_')}(t));")
        row += CHANNELS[name].components
    return " ".join(lines)
