"""Running compute shaders over the texels of a grid."""

from collections.abc import Mapping, Sequence

import moderngl

from app.gl.context import Device
from app.gl.shader import Program


def run_over_grid(device: Device, program: Program, grid: tuple[int, int], side: int,
                  samplers: Mapping[str, moderngl.Texture], images: Sequence[moderngl.Texture]) -> None:
    """Run a shader for each texel of a ``grid`` of width and height.

    Parameters
    ----------
    side : int
        Texels along the edges of what one of the shader's work groups does.
    samplers : mapping of str to Texture
        What it reads, by the samplers' names.
    images : sequence of Texture
        What it stores into, by the images' bindings; passes that follow see it.
    """
    for unit, (name, texture) in enumerate(samplers.items()):
        texture.use(unit)
        program.set(**{name: unit})
    for binding, image in enumerate(images):
        image.bind_to_image(binding)
    program.raw.run(*(-(-extent // side) for extent in grid))
    device.ctx.memory_barrier()
