"""The layers of docs/design.md: a file imports only from a lower one."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

LAYERS = {
    "errors": 0, "channels": 0, "paths": 0, "scene": 0, "data": 0,
    "atomic": 1, "settings": 1, "math3d": 1, "contract": 1, "graph": 1, "extras": 1,
    "environment": 1,
    "image": 2, "gl": 2, "infer": 2, "kept": 1,
    "load": 3, "surfels": 3, "bounces": 3, "preview": 3, "video": 2,
    "passes": 4, "metrics": 4,
    "models": 4,
    "frame": 5,
    "renderer": 6,
    "golden": 7, "bench": 7,
    "view": 8,
    "cli": 9,
    "__main__": 10,
}
PACKAGES_WITH_INNER_IMPORTS = {"load", "gl", "surfels", "golden", "bench", "view", "cli"}
FOREIGN = {"torch", "onnx", "mitsuba", "export", "tests"}


def modules(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def imported(file: Path) -> Iterator[tuple[str, int]]:
    """Absolute module names that ``file`` imports, with lines; ``from a import b`` counts as ``a.b``."""
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: a relative import"
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)


def part_of(file: Path) -> str:
    return file.relative_to(ROOT / "app").parts[0].removesuffix(".py")


APP = [file for file in modules("app") if file != ROOT / "app" / "__init__.py"]


def name(file: Path) -> str:
    return str(file.relative_to(ROOT))


@pytest.mark.parametrize("file", APP, ids=name)
def test_every_file_has_a_layer(file: Path) -> None:
    assert part_of(file) in LAYERS, f"{file} is in no layer of docs/design.md"


@pytest.mark.parametrize("file", APP, ids=name)
def test_imports_go_down(file: Path) -> None:
    own = part_of(file)
    wrong = []
    for module, line in imported(file):
        parts = module.split(".")
        if parts[0] != "app" or parts[1] not in LAYERS:
            continue
        inner = parts[1] == own and own in PACKAGES_WITH_INNER_IMPORTS
        if not inner and LAYERS[parts[1]] >= LAYERS[own]:
            wrong.append(f"line {line}: {module} (layer {LAYERS[parts[1]]}) from layer {LAYERS[own]}")
    assert not wrong


@pytest.mark.parametrize("file", modules("app"), ids=name)
def test_app_stays_free_of_training_code(file: Path) -> None:
    assert not FOREIGN & {module.split(".")[0] for module, _ in imported(file)}


@pytest.mark.parametrize("file", modules("export"), ids=name)
def test_export_does_not_use_the_command_line(file: Path) -> None:
    assert not [module for module, _ in imported(file) if module.startswith("app.cli")]
