"""Shader files to programs: includes, defines, error logs with file names, checked uniforms."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import moderngl
import numpy as np

from app.errors import ShaderError
from app.paths import shader_dir

VERSION = "#version 450 core"
_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
_UNIFORM = re.compile(r"\buniform\s+\w+\s+(\w+)")
_LOG_POSITION = re.compile(r"\b(\d+)([:(])(\d+)")
_STAGES = {".vert": "vertex_shader", ".frag": "fragment_shader", ".comp": "compute_shader"}


class Program:
    """A linked program whose uniforms are set by name and checked against its reflection."""

    def __init__(self, raw: Any, name: str, declared: frozenset[str]) -> None:
        self.raw, self.name, self.glo = raw, name, raw.glo
        self._declared = declared
        self._active = {key: raw[key] for key in raw}

    def __contains__(self, name: str) -> bool:
        """Whether this variant really uses attribute, uniform or block ``name``."""
        return name in self._active

    def declares(self, name: str) -> bool:
        """Whether a source of the program declares uniform ``name``, used by this variant or not."""
        return name in self._declared

    def set(self, **values: Any) -> None:
        """Set uniforms; texture units are ints, matrices numpy arrays of row-major math.

        Raises
        ------
        ShaderError
            For a name that no source of the program declares; the real ones are listed.
        """
        for key, value in values.items():
            member = self._active.get(key)
            if member is None:
                if key not in self._declared:
                    raise ShaderError(f"no uniform {key!r}", self.name,
                                      "expected one of " + ", ".join(sorted(self._declared)))
                continue  # declared, but unused in this variant
            if isinstance(value, np.ndarray) and value.ndim == 2:
                member.write(np.ascontiguousarray(value.T, np.float32))
            else:
                member.value = value


def compile_program(ctx: Any, stages: Sequence[str], defines: Mapping[str, object]) -> Program:
    """Compile and link shader files from the shader folder.

    Raises
    ------
    ShaderError
        With the driver's log, in which source positions are file names and lines.
    """
    files: list[Path] = []
    sources = {_STAGES[Path(stage).suffix]: resolve(shader_dir() / stage, defines, files) for stage in stages}
    try:
        raw = ctx.compute_shader(*sources.values()) if "compute_shader" in sources else ctx.program(**sources)
    except moderngl.Error as error:
        raise ShaderError(_map_log(str(error), files), " + ".join(stages), "expected a shader that compiles") from None
    declared = frozenset(name for text in sources.values() for name in _UNIFORM.findall(text))
    for binding, block in enumerate(("CameraBlock", "LightBlock")):
        if block in raw:  # otherwise this variant does not use it
            raw[block].binding = binding
    return Program(raw, " + ".join(stages), declared)


def resolve(path: Path, defines: Mapping[str, object], files: list[Path]) -> str:
    """Source text of ``path`` with includes pasted once each; ``files`` collects the ``#line`` numbers."""
    header = [VERSION] + [f"#define {key} {value}" for key, value in defines.items()]
    return "\n".join(header + _lines(path, files, [], set())) + "\n"


def _lines(path: Path, files: list[Path], stack: list[Path], seen: set[Path]) -> list[str]:
    if path in stack:
        chain = " -> ".join(p.name for p in [*stack, path])
        raise ShaderError("shader includes form a cycle", chain, "expected includes without cycles")
    if path in seen:
        return []
    seen.add(path)
    try:
        text = path.read_text()
    except OSError:
        where = stack[-1] if stack else "shaders"
        raise ShaderError(f"no shader file {path}", where, "expected an existing file") from None
    number = len(files)
    files.append(path)
    out = [f"#line 1 {number}"]
    for line_number, line in enumerate(text.splitlines(), 1):
        include = _INCLUDE.match(line)
        if include:
            out += _lines(shader_dir() / "include" / include[1], files, [*stack, path], seen)
            out.append(f"#line {line_number + 1} {number}")
        else:
            out.append(line)
    return out


def _map_log(log: str, files: Sequence[Path]) -> str:
    def position(match: re.Match[str]) -> str:
        index = int(match[1])
        name = files[index].name if index < len(files) else match[1]
        return f"{name}{match[2]}{match[3]}"

    lines = [line.strip() for line in log.splitlines() if line.strip() and set(line.strip()) != {"="}]
    return "; ".join(_LOG_POSITION.sub(position, line) for line in lines)
