"""The layout of the wheel, whose only top-level package is ``afterglow``.

A checkout has the packages ``app`` and ``export``, names that other projects have too. In the wheel they are
``afterglow._app`` and ``afterglow.export``, and what ``app.api`` offers is ``afterglow`` itself. The files are the same
but for the names of the packages in imports, in dotted names of modules, and in commands that are shown to users.
"""

import re
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PACKAGES = {"app": "afterglow._app", "export": "afterglow.export"}
PROGRAMS = {"app": "afterglow", "export": "afterglow.export"}
BUNDLED = ("shaders", "nets")
IGNORED = shutil.ignore_patterns("__pycache__", "*.pyc")

_IMPORT = re.compile(r"^(\s*(?:from|import) )(app|export)(?=[. ])", re.MULTILINE)
_MODULE = re.compile(r'(?<=")(app|export)(?=(\.\w+)+")')
_COMMAND = re.compile(r"\bpython -m (app|export)\b")


class WheelLayout(BuildHookInterface):  # type: ignore[type-arg]
    """Adds the renamed packages to a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            raise RuntimeError("a checkout can't be installed as editable; run it with python -m app in its folder")
        self._folder = TemporaryDirectory()
        lay_out(Path(self.root), Path(self._folder.name))
        build_data["force_include"][str(Path(self._folder.name) / "afterglow")] = "afterglow"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        self._folder.cleanup()


def lay_out(root: Path, site: Path) -> None:
    """Write the packages of the checkout ``root`` into the folder ``site`` as a wheel has them."""
    for name, package in PACKAGES.items():
        _copy(root / name, site.joinpath(*package.split(".")))
    for name in BUNDLED:
        shutil.copytree(root / name, site / "afterglow" / "_app" / "_bundle" / name, ignore=IGNORED)
    for source, name in (("api/__init__.py", "__init__.py"), ("__main__.py", "__main__.py")):
        (site / "afterglow" / name).write_text(rename((root / "app" / source).read_text("utf-8")), "utf-8")
    (site / "afterglow" / "py.typed").touch()


def rename(source: str) -> str:
    """Python source with the names that the packages have in a wheel."""
    source = _IMPORT.sub(lambda m: m[1] + PACKAGES[m[2]], source)
    source = _MODULE.sub(lambda m: PACKAGES[m[1]], source)
    return _COMMAND.sub(lambda m: f"python -m {PROGRAMS[m[1]]}", source)


def _copy(source: Path, target: Path) -> None:
    shutil.copytree(source, target, ignore=IGNORED)
    for file in target.rglob("*.py"):
        file.write_text(rename(file.read_text("utf-8")), "utf-8")
