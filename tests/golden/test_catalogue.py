"""The catalogue covers every branch of every shader and every channel."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import app.gl.context
from app.gl.shader import Program, compile_program, resolve
from app.golden import SceneCase, Shot, catalogue
from app.golden.catalogue import PROBE, PROBE_ENVIRONMENT
from app.golden.copy_case import CopyCase
from app.network.channels import CHANNELS
from app.network.contract_json import read_contract
from app.network.selection import find_model
from app.paths import SHADERS, shader_dir
from tests.coarse_shadows import coarse_shadow_maps

Line = tuple[str, int]
Defines = tuple[tuple[str, object], ...]
ProgramKey = tuple[tuple[str, ...], Defines]
GLSLANG = "glslangValidator"
LINE = re.compile(r"#line (\d+) (\d+)")


def lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines of code with their numbers: no comments, directives or braces."""
    for number, line in enumerate(text.splitlines(), 1):
        code = line.split("//")[0].strip()
        if code.strip("{};") and not code.startswith("#"):
            yield number, code


def holds(condition: str, defined: set[str]) -> bool:
    """``#ifdef`` and ``#if`` of names; ``LIGHT_COUNT > 0`` and the like are not used by the shaders."""
    if condition.startswith("#ifdef"):
        return condition.split()[1] in defined
    names = re.sub(r"defined\((\w+)\)", lambda m: str(m[1] in defined), condition.removeprefix("#if"))
    return bool(eval(names.replace("||", " or ").replace("&&", " and ").replace("!", " not ")))


def compiled(stage: str, defines: Mapping[str, object]) -> Iterator[Line]:
    """File and number of every line that the preprocessor lets through."""
    files: list[Path] = []
    defined, open_blocks = set(defines), [True]
    place, number = 0, 0
    for line in resolve(shader_dir() / stage, defines, files).splitlines():
        directive = line.strip()
        if match := LINE.match(directive):
            number, place = int(match[1]) - 1, int(match[2])
            continue
        number += 1
        if directive.startswith("#if"):
            open_blocks.append(open_blocks[-1] and holds(directive, defined))
        elif directive.startswith("#else"):
            taken = open_blocks.pop()
            open_blocks.append(open_blocks[-1] and not taken)
        elif directive.startswith("#endif"):
            open_blocks.pop()
        elif open_blocks[-1] and files:
            yield files[place].name, number


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> list[ProgramKey]:
    """Stages and defines of every program that the catalogue compiles."""
    found: dict[ProgramKey, None] = {}

    def spy(ctx: Any, stages: Sequence[str], defines: Mapping[str, object]) -> Program:
        found[tuple(stages), tuple(defines.items())] = None
        return compile_program(ctx, stages, defines)

    folder = tmp_path_factory.mktemp("catalogue")
    with pytest.MonkeyPatch.context() as patch, coarse_shadow_maps():
        patch.setattr(app.gl.context, "compile_program", spy)
        CopyCase().draw(folder)
        for case in catalogue().values():
            if isinstance(case, SceneCase):
                frames = min(2, case.shots[0].frames)
                shots = (Shot(case.shots[0].camera, frames),)
                # A small picture is no larger than its grid of reflections, and has no detail.
                size = case.size if "reflection_detail" in (case.stages or ()) else (24, 18)
                replace(case, size=size, shots=shots, golden_frames=(frames,)).draw(folder)
    return [*found]


@pytest.mark.gl
@pytest.mark.usefixtures("egl")
def test_every_line_of_every_shader_is_compiled(programs: list[ProgramKey]) -> None:
    compiled_lines = {line for stages, defines in programs for stage in stages
                      for line in compiled(stage, dict(defines))}
    files = [f for f in shader_dir().rglob("*.*") if f.is_file()]
    missing = [f"{f.name}:{n}: {code}" for f in files for n, code in lines(f.read_text())
               if (f.name, n) not in compiled_lines]
    assert not missing, "\n".join(missing)


@pytest.mark.gl
@pytest.mark.usefixtures("egl")
def test_the_reference_compiler_accepts_every_program(programs: list[ProgramKey], tmp_path: Path) -> None:
    """Khronos' glslang, without warnings: a driver may accept what the language does not allow."""
    if shutil.which(GLSLANG) is None:
        pytest.skip(f"no {GLSLANG}: install Debian's glslang-tools")
    assert not glslang(programs, tmp_path)


def test_the_reference_compiler_finds_mistakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if shutil.which(GLSLANG) is None:
        pytest.skip(f"no {GLSLANG}: install Debian's glslang-tools")
    monkeypatch.setenv(SHADERS, str(tmp_path))
    (tmp_path / "whole.frag").write_text("out vec4 color;\nvoid main() { color = vec4(SIZE); }\n")
    good, bad = ((("whole.frag",), defines) for defines in ((("SIZE", 1.0),), ()))
    assert not glslang([good], tmp_path)
    assert "'SIZE' : undeclared identifier" in glslang([good, bad], tmp_path)


def glslang(programs: Sequence[ProgramKey], folder: Path) -> str:
    """What the reference compiler says about the stages of programs; empty if nothing."""
    stages = dict.fromkeys((name, defines) for names, defines in programs for name in names)
    files = []
    for number, (name, defines) in enumerate(stages):
        files.append(str(folder / f"{number}-{name}"))
        Path(files[-1]).write_text(resolve(shader_dir() / name, dict(defines), []))
    result = subprocess.run([GLSLANG, *files], capture_output=True, text=True, check=False)
    said = [line for line in result.stdout.splitlines() if line not in files]
    return "\n".join(said) or ("failed without a message" if result.returncode else "")


def test_the_probes_and_the_model_of_gathered_light_read_every_channel() -> None:
    """Otherwise run ``python -m export onnx probe``."""
    read = {(name, spec.grid) for probe in (PROBE, PROBE_ENVIRONMENT, find_model("final-gather"))
            for spec in read_contract(probe).inputs.values() for name in spec.channels}
    assert read == {(name, grid) for name, c in CHANNELS.items() if not c.output for grid in c.grids}
