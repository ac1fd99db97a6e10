"""The set-up shared by run.sh and test.sh, with stand-ins for the commands that would change the machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


class Machine:
    """A copy of the set-up files, and a folder of stand-in commands that write down how they were called."""

    def __init__(self, folder: Path) -> None:
        self.root, self.bin, self.log = folder / "project", folder / "bin", folder / "log"
        self.bin.mkdir(parents=True)
        shutil.copytree(ROOT / "scripts", self.root / "scripts")
        for name in ("pyproject.toml", "constraints.txt"):
            shutil.copy(ROOT / name, self.root)
        self.stand_in(self.bin / "dpkg-query", "echo installed")
        self.stand_in(self.bin / "id", "echo 1000")
        self.stand_in(self.bin / "apt-get", "exit 0")

    def stand_in(self, path: Path, body: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'#!/bin/bash\necho "{path.name} $*" >>"{self.log}"\n{body}\n')
        path.chmod(0o755)

    def with_environment(self, body: str = "exit 0") -> None:
        self.stand_in(self.root / ".venv" / "bin" / "python", body)

    def set_up(self, mode: str = "run") -> tuple[int, str, list[str]]:
        """Exit code, stderr and the calls of stand-ins."""
        self.log.write_text("")
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", f"source {self.root}/scripts/setup.sh; set_up {mode}"], text=True,
            capture_output=True, check=False, env={**os.environ, "PATH": f"{self.bin}:{os.environ['PATH']}"})
        calls = [line for line in self.log.read_text().splitlines() if not line.startswith(("dpkg-query", "id"))]
        return done.returncode, done.stderr, calls


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def installs(calls: list[str]) -> int:
    return sum("pip install" in call for call in calls)


def test_a_second_call_installs_nothing(machine: Machine) -> None:
    machine.with_environment()
    assert installs(machine.set_up()[2]) == 1
    assert machine.set_up() == (0, "", [])


def test_what_the_tests_need_is_enough_to_run(machine: Machine) -> None:
    machine.with_environment()
    assert installs(machine.set_up("test export test lint")[2]) == 1
    assert machine.set_up("run") == (0, "", [])


def test_other_pins_are_installed(machine: Machine) -> None:
    machine.with_environment()
    machine.set_up()
    (machine.root / "constraints.txt").write_text("numpy==2.0.0\n")
    assert installs(machine.set_up()[2]) == 1


def test_an_interrupted_set_up_starts_again(machine: Machine) -> None:
    machine.with_environment('[[ "$*" != *"pip install"* ]]')
    code, text, _ = machine.set_up()
    assert code == 2
    assert text.splitlines()[-1].startswith("error: pip: could not install")
    machine.with_environment()
    assert installs(machine.set_up()[2]) == 1


def test_missing_packages_are_named(machine: Machine) -> None:
    machine.stand_in(machine.bin / "dpkg-query", "exit 1")
    machine.with_environment()
    code, text, calls = machine.set_up()
    assert code == 2
    assert text == ("error: system packages: missing libegl1 libgl1-mesa-dri "
                    "(expected them installed; on Debian: sudo apt-get install libegl1 libgl1-mesa-dri)\n")
    assert calls == []


def test_root_installs_missing_packages(machine: Machine) -> None:
    machine.stand_in(machine.bin / "dpkg-query", "exit 1")
    machine.stand_in(machine.bin / "id", "echo 0")
    machine.with_environment()
    assert machine.set_up()[0] == 0
    calls = [line for line in machine.log.read_text().splitlines() if line.startswith("apt-get")]
    assert calls == ["apt-get update -qq",
                     "apt-get install -y -qq --no-install-recommends libegl1 libgl1-mesa-dri"]


@pytest.mark.parametrize(("package", "tests"), [("libllvm", "the path tracer's"), ("chromium", "the viewer's"),
                                                ("glslang", "the reference compiler's")])
def test_only_the_tests_get_what_they_alone_need(machine: Machine, package: str, tests: str) -> None:
    machine.stand_in(machine.bin / "dpkg-query", f'[[ "$*" == *{package}* ]] || echo installed')
    machine.stand_in(machine.bin / "id", "echo 0")
    machine.stand_in(machine.bin / "apt-get", "exit 1")
    machine.with_environment()
    assert not [call for call in machine.set_up()[2] if call.startswith("apt-get")]
    code, text, calls = machine.set_up("test export")
    assert code == 0 and f"{tests} tests will be skipped" in text
    assert calls[0] == "apt-get update -qq"
    assert not [call for call in machine.set_up("test export")[2] if call.startswith("apt-get")]


def test_a_python_without_venv_is_named(machine: Machine) -> None:
    machine.stand_in(machine.bin / "python3", '[[ "$*" != *ensurepip* ]]')
    code, text, _ = machine.set_up()
    assert code == 2
    assert "system packages: missing python3-venv" in text


def test_an_old_python_is_named(machine: Machine) -> None:
    for name in ("python3", *(f"python3.{minor}" for minor in range(11, 15))):
        machine.stand_in(machine.bin / name, '[[ "$*" == --version ]] && echo Python 3.9.2')
    code, text, _ = machine.set_up()
    assert code == 2
    assert text == "error: Python 3.9.2: too old (expected Python 3.11 or newer)\n"


def test_constraints_name_no_host() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert all(line.startswith("#") or line.count("==") == 1 for line in lines)
    assert not any(mark in line for line in lines for mark in ("://", "@", "--", "+"))


def test_an_extra_may_name_others() -> None:
    listed = subprocess.run([sys.executable, ROOT / "scripts" / "requirements.py", "test"], text=True,
                            capture_output=True, check=True).stdout
    assert {"numpy", "pytest", "scikit-image"} <= {line.split(">")[0] for line in listed.splitlines()}
    assert "[" not in listed
