"""The layers of docs/design.md: a module imports only from its own folder and from lower layers."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

APP_LAYERS = (
    {"errors", "arrays", "paths", "data"},
    {"scene", "settings", "extras", "graph"},
    {"math3d", "embree"},
    {"environment", "sky_parts", "radiance_scale", "simple_meshes", "specular_albedo", "animation"},
    {"io", "gl"},
    {"network", "load"},
    {"raycast"},
    {"surfels", "exchange"},
    {"passes"},
    {"frame"},
    {"renderer"},
    {"evaluation"},
    {"bench", "golden", "view", "api"},
    {"batch", "doctor"},
    {"cli"},
    {"__main__"},
)
EXPORT_LAYERS = (
    {"models", "reference", "toml_config"},
    {"dataset"},
    {"training"},
    {"onnx"},
    {"validation"},
    {"__main__"},
)
LAYERS = {f"{package}.{name}": (package, level) for package, layers in (("app", APP_LAYERS), ("export", EXPORT_LAYERS))
          for level, names in enumerate(layers) for name in names}
TRAINING_ONLY = {"torch", "onnx", "mitsuba", "export", "tests"}


def module_name(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_name(file): file for package in ("app", "export") for file in sorted((ROOT / package).rglob("*.py"))}


@cache
def parsed(name: str) -> ast.Module:
    return ast.parse(MODULES[name].read_text("utf-8"))


def imported(name: str, nodes: Iterable[ast.AST]) -> Iterator[tuple[str, int]]:
    """Names of the modules that ``nodes`` import into the module ``name``, with lines."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module, f"{name}:{node.lineno}: a relative import"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield (full if full in MODULES else node.module), node.lineno


def executed_on_import(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """The statements outside functions and outside of ``if TYPE_CHECKING``."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        yield node
        for part in ("body", "orelse", "finalbody"):
            yield from executed_on_import(getattr(node, part, []))


def layer_of(module: str) -> tuple[str, int] | None:
    return LAYERS.get(".".join(module.split(".")[:2]))


INNER = [name for name in MODULES if "." in name]


@pytest.mark.parametrize("name", INNER)
def test_every_module_is_in_a_layer(name: str) -> None:
    assert layer_of(name) is not None, f"{name} is in no layer of docs/design.md"


@pytest.mark.parametrize("name", INNER)
def test_imports_go_down(name: str) -> None:
    package, level = layer_of(name) or ("", 0)
    own = name.split(".")[1]
    upward = []
    for module, line in imported(name, ast.walk(parsed(name))):
        other = layer_of(module)
        if other is not None and other[0] == package and module.split(".")[1] != own and other[1] >= level:
            upward.append(f"line {line}: {module} (layer {other[1]}) from layer {level}")
    assert not upward


def test_no_modules_import_each_other() -> None:
    graph = {name: {module for module, _ in imported(name, executed_on_import(parsed(name).body)) if module in MODULES}
             for name in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("name", [name for name in MODULES if name.split(".")[0] == "app"])
def test_app_does_not_import_training_code(name: str) -> None:
    assert not TRAINING_ONLY & {module.split(".")[0] for module, _ in imported(name, ast.walk(parsed(name)))}


@pytest.mark.parametrize("name", [name for name in MODULES if name.split(".")[0] == "export"])
def test_export_does_not_use_the_command_line_of_app(name: str) -> None:
    assert not [module for module, _ in imported(name, ast.walk(parsed(name))) if module.startswith("app.cli")]
