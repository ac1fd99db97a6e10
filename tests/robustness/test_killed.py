"""A process that is killed while it writes leaves every file complete, either the old one or the new one."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from app.io.image import read_exr, read_png
from tests.robustness.writer import PARTS, VERSIONS, display, image, text

ROOT = Path(__file__).parents[2]
MAX_DELAY = 0.05  # seconds after the first round; a round takes about as long


def visible(folder: Path) -> list[Path]:
    """Files that are finished; the names of others start with a dot."""
    return sorted(p for p in folder.iterdir() if not p.name.startswith("."))


def assert_complete(folder: Path) -> None:
    exr, png, report = read_exr(folder / "image.exr")[""], read_png(folder / "image.png"), folder / "report.json"
    assert any(np.array_equal(exr, image(v).astype(np.float32)) for v in range(VERSIONS))
    assert any(np.array_equal(png, display(v)) for v in range(VERSIONS))
    texts = [text(v) for v in range(VERSIONS)]
    assert report.read_text() in texts
    # Between the two renames of a folder it is missing; the old one is then complete beside it.
    goldens = folder / "goldens"
    if not goldens.exists():
        (goldens,) = folder.glob(".*-old-goldens")
    parts = [p.read_text() for p in sorted(goldens.iterdir())]
    assert len(parts) == PARTS and len(set(parts)) == 1 and parts[0] in texts


@pytest.mark.parametrize("runs", [6, pytest.param(200, marks=pytest.mark.long)])
def test_all_files_are_complete_after_a_kill_at_any_moment(runs: int, tmp_path: Path) -> None:
    rng = random.Random(0)
    for run in range(runs):
        folder = tmp_path / f"{run}"
        folder.mkdir()
        child = subprocess.Popen([sys.executable, "-m", "tests.robustness.writer", str(folder)], cwd=ROOT,
                                 stdout=subprocess.PIPE)
        assert child.stdout is not None and child.stdout.readline() == b"written\n"
        time.sleep(rng.uniform(0, MAX_DELAY))
        child.kill()
        assert child.wait() == -signal.SIGKILL
        assert_complete(folder)


@pytest.mark.parametrize("point", ["before", "after"])
@pytest.mark.parametrize("call", ["replace", "rename 1", "rename 2"])
def test_all_files_are_complete_after_a_kill_around_each_rename(point: str, call: str, tmp_path: Path) -> None:
    """Moments that random kills rarely hit: just before and after each rename of the second round."""
    name, _, count = call.partition(" ")
    program = f"""
import os, pathlib, signal, sys
from tests.robustness.writer import write
folder = pathlib.Path({str(tmp_path)!r})
write(folder, 0)
real, left = pathlib.Path.{name}, [{count or 1}]
def rename_and_die(self, target):
    left[0] -= 1
    if left[0] == 0 and {point == "before"}:
        os.kill(os.getpid(), signal.SIGKILL)
    result = real(self, target)
    if left[0] == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return result
pathlib.Path.{name} = rename_and_die
write(folder, 1)
"""
    child = subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False)
    assert child.returncode == -signal.SIGKILL
    assert_complete(tmp_path)


@pytest.mark.gl
@pytest.mark.usefixtures("egl")
@pytest.mark.parametrize("runs", [2, pytest.param(30, marks=pytest.mark.long)])
def test_the_program_leaves_complete_frames_when_killed(runs: int, tmp_path: Path) -> None:
    """Frames appear in order, and each can be read and has its size."""
    rng = random.Random(1)
    for run in range(runs):
        folder = tmp_path / f"{run}"
        command = ["app", "--out", str(folder), "--frames", "5000", "--size", "64x48", "--model", "none",
                   "--timing", str(folder / "timing.json")]
        child = subprocess.Popen([sys.executable, "-m", *command], cwd=ROOT, stdout=subprocess.DEVNULL,
                                 stderr=subprocess.DEVNULL)
        while not (folder / "0001.png").exists() and child.poll() is None:
            time.sleep(0.01)
        time.sleep(rng.uniform(0, 0.3))
        child.kill()
        assert child.wait() == -signal.SIGKILL
        files = visible(folder)
        for file in files:
            pixels = read_exr(file)[""] if file.suffix == ".exr" else read_png(file)
            assert pixels.shape == (48, 64, 3) and pixels.max() > 0
        frames = sorted({int(file.stem) for file in files})
        assert frames == list(range(len(frames))) and len(files) >= 2 * len(frames) - 1
        assert not (folder / "timing.json").exists()


def test_readers_never_see_an_unfinished_file(tmp_path: Path) -> None:
    """A reader that polls while a writer runs only sees complete JSON."""
    command = [sys.executable, "-m", "tests.robustness.writer", str(tmp_path)]
    child = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE)
    try:
        assert child.stdout is not None and child.stdout.readline() == b"written\n"
        versions = {json.loads((tmp_path / "report.json").read_text())["version"] for _ in range(300)}
    finally:
        child.kill()
        child.wait()
    assert versions == set(range(VERSIONS))
