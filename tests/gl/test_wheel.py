"""The wheel carries all it needs: installed elsewhere, it renders from an unrelated folder."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from app.io.image import read_exr, read_png

ROOT = Path(__file__).parents[2]


def run(*command: object, **options: object) -> subprocess.CompletedProcess[str]:
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, ROOT)
    return next(folder.glob("*.whl"))


def test_wheel_carries_shaders_networks_and_data(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    for folder, place in (("shaders", "app/_bundle/shaders"), ("nets", "app/_bundle/nets"), ("app/data", "app/data")):
        for file in (ROOT / folder).rglob("*"):
            if file.is_file() and file.suffix != ".pyc":
                assert f"{place}/{file.relative_to(ROOT / folder).as_posix()}" in held
    assert not [name for name in held if name.startswith(("tests/", "shaders/", "nets/"))]


@pytest.mark.gl
def test_wheel_renders_elsewhere(wheel: Path, tmp_path: Path) -> None:
    python = tmp_path / "venv" / "bin" / "python"
    run(sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv")
    run(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index", wheel)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    # The dependencies come from this environment, the program from the wheel alone.
    environment = {**os.environ, "PYTHONPATH": sysconfig.get_path("purelib")}
    where = run(python, "-P", "-c", "import app; print(app.__file__)", cwd=elsewhere, env=environment).stdout
    assert where.startswith(str(tmp_path))
    run(python, "-P", "-m", "app", "--size", "64x48", cwd=elsewhere, env=environment)
    assert read_png(elsewhere / "out" / "0000.png").shape == (48, 64, 3)
    assert read_exr(elsewhere / "out" / "0000.exr")[""].mean() > 0
