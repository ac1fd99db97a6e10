"""A viewer in a child process, as a user starts it, and a headless browser."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")


@dataclass
class Viewer:
    """A running viewer and the link it printed."""

    process: subprocess.Popen[str]
    link: str

    @property
    def socket(self) -> str:
        return self.link.replace("http://", "ws://").replace("/?", "/live?") + ("" if "?" in self.link else "live")

    def interrupt(self) -> str:
        """Send Ctrl-C and return what the viewer printed after its link."""
        self.process.send_signal(signal.SIGINT)
        out, err = self.process.communicate(timeout=20)
        assert self.process.returncode == 0, err
        assert "Traceback" not in err
        return out


@contextmanager
def run_viewer(*args: str) -> Iterator[Viewer]:
    """Run a viewer with these arguments; interrupt it at the end if it still runs."""
    process = subprocess.Popen([sys.executable, "-m", "app", "view", *args], text=True, cwd=ROOT,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        assert process.stdout is not None and process.stderr is not None
        line = process.stdout.readline()
        if not line:
            pytest.fail(process.stderr.read())
        viewer = Viewer(process, line.split()[-1])
        yield viewer
        if process.poll() is None:
            viewer.interrupt()
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium; without it the test is skipped, except in CI, where it fails."""
    executable = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if executable is None:
        give_up = pytest.fail if os.environ.get("CI") == "true" else pytest.skip
        give_up("no Chromium; on Debian: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()
