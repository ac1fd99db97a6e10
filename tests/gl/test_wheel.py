"""The wheel has one package with all it needs, and works beside other packages ``app`` and ``export``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from app.io.image import read_exr, read_png

ROOT = Path(__file__).parents[2]
MAX_IMPORT_SECONDS = 0.3


def run(*command: object, **options: object) -> subprocess.CompletedProcess[str]:
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, ROOT)
    return next(folder.glob("*.whl"))


class Installed:
    """The wheel in an environment of its own, run in a folder with unrelated packages ``app`` and ``export``."""

    def __init__(self, wheel: Path, folder: Path) -> None:
        self.python, self.folder = folder / "venv" / "bin" / "python", folder / "elsewhere"
        run(sys.executable, "-m", "venv", "--without-pip", folder / "venv")
        run(sys.executable, "-m", "pip", "--python", self.python, "install", "--quiet", "--no-deps", "--no-index",
            wheel)
        others = folder / "others"
        for name in ("app", "export"):
            (others / name).mkdir(parents=True)
            (others / name / "__init__.py").write_text("raise ImportError('an unrelated package was imported')")
        self.folder.mkdir()
        # The dependencies come from the environment of the tests, the program from the wheel alone.
        self._environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(others), sysconfig.get_path("purelib")))}

    def run(self, *arguments: object) -> str:
        return run(self.python, "-P", *arguments, cwd=self.folder, env=self._environment).stdout


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    return Installed(wheel, tmp_path_factory.mktemp("installed"))


def test_wheel_has_one_package_with_shaders_networks_and_data(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    inner = "afterglow/_app"
    for folder, place in (("shaders", f"{inner}/_bundle/shaders"), ("nets", f"{inner}/_bundle/nets"),
                          ("app", inner), ("export", "afterglow/export")):
        for file in (ROOT / folder).rglob("*"):
            if file.is_file() and file.suffix != ".pyc":
                assert f"{place}/{file.relative_to(ROOT / folder).as_posix()}" in held
    assert {name.split("/")[0].split("-")[0] for name in held} == {"afterglow"}


def test_import_is_quick_and_loads_neither_torch_nor_opengl(installed: Installed) -> None:
    program = ("import sys, time; start = time.perf_counter(); import afterglow; print(time.perf_counter() - start); "
               "print({'torch', 'moderngl', 'onnxruntime', 'mitsuba'} & set(sys.modules)); print(afterglow.__file__)")
    seconds, loaded, file = installed.run("-c", program).splitlines()
    assert float(seconds) < MAX_IMPORT_SECONDS and loaded == "set()"
    assert file.startswith(str(installed.folder.parent / "venv"))


def test_every_module_of_the_wheel_can_be_imported(installed: Installed) -> None:
    program = ("import importlib, pkgutil, afterglow._app as a\n"
               "for m in pkgutil.walk_packages(a.__path__, 'afterglow._app.'):\n"
               "    m.name.endswith('__main__') or importlib.import_module(m.name)\n"
               "import afterglow; [getattr(afterglow, name) for name in afterglow.__all__]")
    installed.run("-c", program)


@pytest.mark.gl
def test_wheel_renders_elsewhere(installed: Installed) -> None:
    installed.run("-m", "afterglow", "--size", "64x48")
    assert read_png(installed.folder / "out" / "0000.png").shape == (48, 64, 3)
    assert read_exr(installed.folder / "out" / "0000.exr")[""].mean() > 0


@pytest.mark.gl
def test_wheel_starts_child_processes(installed: Installed) -> None:
    pytest.importorskip("mitsuba")
    installed.run("-m", "afterglow", "compare", "--models", "none,reference", "--size", "16x12", "--spp", "8", "--out",
                  installed.folder / "compare.html")
    assert (installed.folder / "compare.html").stat().st_size > 0


@pytest.mark.gl
def test_wheel_draws_batches(installed: Installed) -> None:
    scene = ROOT / "app" / "data" / "cornell-box.obj"
    (installed.folder / "jobs.jsonl").write_text(json.dumps({"scene": str(scene), "model": "none", "size": [24, 18]}))
    installed.run("-m", "afterglow", "batch", "jobs.jsonl", "--out", "pictures")
    assert read_png(installed.folder / "pictures" / "0000" / "000.png").shape == (18, 24, 3)


def test_messages_of_the_wheel_name_its_own_commands(installed: Installed) -> None:
    assert "python -m afterglow" in installed.run("-m", "afterglow", "--help")
    assert "python -m app" not in installed.run("-m", "afterglow", "render", "--help")


@pytest.mark.gl
def test_every_example_runs_from_the_wheel(installed: Installed) -> None:
    for package in ("av", "flip_evaluator", "mitsuba", "onnx"):
        pytest.importorskip(package)
    short = {"dataset_with_masks.py": {"count": 2}, "light_animation.py": {"frames": 2},
             "compare_with_path_tracer.py": {"spp": 8}}
    calls = [(str(file), short.get(file.name, {})) for file in sorted((ROOT / "examples").glob("*.py"))]
    installed.run("-c", "import runpy, pathlib\n"
                  f"for file, options in {calls!r}:\n"
                  "    runpy.run_path(file)['main'](pathlib.Path('.'), (48, 36), **options)")
    cells = json.loads((ROOT / "examples" / "first_picture.ipynb").read_text())["cells"]
    installed.run("-c", "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"))
    assert {file.name for file in installed.folder.iterdir()} >= {
        "hello.png", "own_network.png", "0001.exr", "light_animation.mp4", "ember.png"}
