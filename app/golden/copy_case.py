"""The yardstick of pass times, a full-screen copy that no frame contains, on a known image."""

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import moderngl
import numpy as np

from app.gl.context import Device
from app.golden.case import Picture, gl_origin

SIZE = (64, 48)


@dataclass(frozen=True)
class CopyCase:
    """``copy.frag`` on an image of all values from 0 to 1."""

    name: str = "copy"

    def origin(self) -> str:
        """GL renderer and version."""
        return gl_origin()

    def draw(self, saved: Path) -> list[Picture]:
        """The output of the copy; ``saved`` is not used."""
        width, height = SIZE
        image = np.linspace(0, 1, width * height * 4, dtype=np.float16).reshape(height, width, 4)
        with closing(Device()) as device, device.ctx:
            source = device.ctx.texture(SIZE, 4, image[::-1].tobytes(), dtype="f2")
            target = device.ctx.texture(SIZE, 4, dtype="f2")
            device.ctx.framebuffer([target]).use()
            device.ctx.enable_only(moderngl.NOTHING)
            source.use(0)
            program = device.fullscreen("copy.frag")
            program.set(source=0)
            device.draw_fullscreen(program)
            copied = np.frombuffer(target.read(), np.float16).reshape(height, width, 4)[::-1].astype(np.float32)
        return [Picture("copy", "copy", {1: copied})]
