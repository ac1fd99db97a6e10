"""The headless EGL context and what moderngl does not wrap."""

import ctypes
import ctypes.util
import gc
import os
import weakref
from collections.abc import Callable, Mapping
from typing import Any

import moderngl

from app.errors import DeviceError
from app.gl.shader import Program, compile_program

GL_LOWER_LEFT, GL_ZERO_TO_ONE = 0x8CA1, 0x935F
GL_MAP_READ_BIT, GL_MAP_WRITE_BIT, GL_MAP_PERSISTENT_BIT, GL_MAP_COHERENT_BIT = 0x1, 0x2, 0x40, 0x80
MAPPED = GL_MAP_READ_BIT | GL_MAP_WRITE_BIT | GL_MAP_PERSISTENT_BIT | GL_MAP_COHERENT_BIT
GL_COLOR_BUFFER_BIT, GL_NEAREST = 0x4000, 0x2600
GL_TEXTURE_2D, GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT = 0x0DE1, 0x8CAC, 0x1902, 0x1406
GL_FORMATS = {1: 0x1903, 2: 0x8227, 4: 0x1908}  # of red, red and green, all four channels
REQUIRED = 450  # clip control, fine derivatives
DEVICE_INDEX = "GLCONTEXT_DEVICE_INDEX"  # environment variable that glcontext reads: number of an EGL device, from 0
ANISOTROPY = 8.0
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")


class Device:
    """One standalone context, its compiled programs and its full-screen triangle.

    Parameters
    ----------
    strict : bool
        Refuse a software renderer.

    Attributes
    ----------
    defines : dict of str to object
        For all programs that are asked for from now on.

    Raises
    ------
    DeviceError
        When EGL or a good enough OpenGL is missing; the message says what to install.
    """

    def __init__(self, strict: bool = False) -> None:
        try:
            # EGL finds all functions; without this, libGL would be needed too, for nothing.
            options: dict[str, Any] = {"backend": "egl", "libgl": ctypes.util.find_library("EGL")}
            self.ctx = moderngl.create_context(require=REQUIRED, standalone=True, **options)
        except Exception as error:  # glcontext raises bare Exceptions
            if DEVICE_INDEX in os.environ and (isinstance(error, ValueError) or "device index" in str(error)):
                raise DeviceError(f"no OpenGL device {os.environ.get(DEVICE_INDEX)!r} ({error})", DEVICE_INDEX,
                                  "expected the number of an EGL device, counted from 0") from None
            raise DeviceError(f"no OpenGL context ({error})", "EGL",
                              "expected OpenGL 4.5 or later: on Debian install libegl1 and libgl1-mesa-dri, "
                              "or the EGL library of the GPU's driver") from None
        self.ctx.gc_mode = "context_gc"  # what nobody refers to any more waits for ``collect``
        info = self.ctx.info
        self.renderer: str = info["GL_RENDERER"]
        self.version: str = info["GL_VERSION"]
        self.software = any(name in self.renderer.lower() for name in SOFTWARE)
        if strict and self.software:
            renderer = self.renderer
            self.ctx.release()
            raise DeviceError(f"software renderer {renderer!r}", "strict_device", "expected a GPU with an EGL driver")
        # The driver's memory would outlive a device that nobody closes.
        self._destroy = weakref.finalize(self, self.ctx.release)
        self._destroy.atexit = False
        # llvmpipe's anisotropic lookups take more time than all other passes together (docs/design.md).
        self.anisotropy = 1.0 if self.software else ANISOTROPY
        self.mixes_levels = not self.software  # llvmpipe spends a sixth of the G-buffer of sponza on the second level
        self._functions = _EglFunctions()
        self._functions.call("glClipControl", GL_LOWER_LEFT, GL_ZERO_TO_ONE)
        self.max_size: int = info["GL_MAX_TEXTURE_SIZE"]
        self.max_storage_bytes: int = info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"]
        while self.ctx.error != "GL_NO_ERROR":  # moderngl asks for limits that some drivers don't know
            pass
        self.defines: dict[str, object] = {}
        self._programs: dict[object, Program] = {}
        self._triangle: dict[int, moderngl.VertexArray] = {}
        self._shared: dict[str, moderngl.TextureArray] = {}

    def program(self, *stages: str, defines: Mapping[str, object] | None = None) -> Program:
        """The program of shader files ``stages`` (``.vert``, ``.frag``, ``.comp``); compiled once per variant."""
        defines = {**self.defines, **(defines or {})}
        key = (stages, tuple(sorted(defines.items(), key=str)))
        if key not in self._programs:
            self._programs[key] = compile_program(self.ctx, stages, defines)
        return self._programs[key]

    def fullscreen(self, fragment: str, defines: Mapping[str, object] | None = None) -> Program:
        """The program that draws ``fragment`` over a whole target."""
        return self.program("fullscreen.vert", fragment, defines=defines)

    def draw_fullscreen(self, program: Program) -> None:
        """Draw one triangle that covers the bound framebuffer."""
        vao = self._triangle.get(program.glo)
        if vao is None:
            vao = self._triangle[program.glo] = self.ctx.vertex_array(program.raw, [])
        vao.render(moderngl.TRIANGLES, vertices=3)

    def shared_texture(self, name: str, make: Callable[[], moderngl.TextureArray]) -> moderngl.TextureArray:
        """What ``make`` gives when it is called for the first time; all passes share it."""
        if name not in self._shared:
            self._shared[name] = make()
        return self._shared[name]

    def depth_texture(self, size: tuple[int, int]) -> moderngl.Texture:
        """A 32-bit float depth buffer; moderngl's own has 24 bits, too few for reversed Z."""
        texture = self.ctx.depth_texture(size)
        texture.use(0)
        self._functions.call("glTexImage2D", GL_TEXTURE_2D, 0, GL_DEPTH_COMPONENT32F, *size, 0,
                             GL_DEPTH_COMPONENT, GL_FLOAT, None)
        return texture

    def blit(self, source: moderngl.Framebuffer, target: moderngl.Framebuffer) -> None:
        """Copy the nearest texels of ``source`` to ``target``, of any size."""
        target.use()
        self._functions.call("glBlitNamedFramebuffer", source.glo, target.glo, 0, 0, *source.size, 0, 0, *target.size,
                             GL_COLOR_BUFFER_BIT, GL_NEAREST)

    def clear(self, texture: moderngl.Texture) -> None:
        """Set all texels to 0; new ones hold whatever was in the GPU's memory."""
        self._functions.call("glClearTexImage", texture.glo, 0, GL_FORMATS[texture.components], GL_FLOAT, None)

    def map_buffer(self, size: int) -> tuple[moderngl.Buffer, int]:
        """A buffer of ``size`` bytes that stays mapped for reading and writing, and the address of its memory.

        The CPU sees what passes have written when they are finished; what the CPU writes, later passes see.
        """
        buffer = self.ctx.buffer(reserve=size)
        length = ctypes.c_ssize_t(size)
        self._functions.call("glNamedBufferStorage", buffer.glo, length, None, MAPPED)
        address = self._functions.call("glMapNamedBufferRange", buffer.glo, ctypes.c_ssize_t(0), length, MAPPED,
                                       result=ctypes.c_void_p)
        if address is None:
            raise DeviceError(f"can't map a buffer of {size} bytes", self.renderer, "expected OpenGL 4.5")
        return buffer, address

    def flush(self) -> None:
        """Let the GPU begin with what it has been told, without waiting for it."""
        self._functions.call("glFlush")

    def collect(self) -> None:
        """Release GL objects that nobody refers to any more."""
        self.ctx.detect_framebuffer(0).use()  # moderngl binds the last one again, which would be an error once released
        gc.collect()  # passes are closures, which may refer to themselves
        self.ctx.gc()

    def close(self) -> None:
        """Release everything that hangs on the context, then the context."""
        with self.ctx:
            for vao in self._triangle.values():
                vao.release()
            for texture in self._shared.values():
                texture.release()
            for program in self._programs.values():
                program.raw.release()
        self._destroy()


class _EglFunctions:
    """GL entry points that moderngl has no call for."""

    def __init__(self) -> None:
        library = ctypes.CDLL(ctypes.util.find_library("EGL") or "libEGL.so.1")
        self._address = library.eglGetProcAddress
        self._address.restype, self._address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]

    def call(self, name: str, *args: int | ctypes.c_ssize_t | None, result: Any = None) -> Any:
        """Call ``name`` with integers, or pointers that are None; returns a ``result`` of that ctypes type."""
        address = self._address(name.encode())
        if not address:
            raise DeviceError(f"no {name}", "EGL", "expected OpenGL 4.5")
        types = [ctypes.c_void_p if a is None else ctypes.c_int if isinstance(a, int) else type(a) for a in args]
        return ctypes.CFUNCTYPE(result, *types)(address)(*args)
