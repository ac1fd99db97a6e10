"""The commands of the Dockerfile, on a bare Debian in a folder; the image itself is not built."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from app.io.image import read_png

pytestmark = [pytest.mark.gl, pytest.mark.long]
ROOT = Path(__file__).parents[2]
DOCKERFILE = (ROOT / "Dockerfile").read_text()
NETWORK = ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "PIP_INDEX_URL")
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")  # which this machine trusts, for pip


def instruction(name: str) -> str:
    return re.search(rf"^{name} (.*)$", DOCKERFILE, re.MULTILINE)[1]


@pytest.fixture(scope="module")
def debian(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the bare system that the image begins with, and this machine's way to the network."""
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        pytest.skip("a bare Debian needs root and debootstrap (apt-get install debootstrap)")
    folder = tmp_path_factory.mktemp("debian")
    suite = re.fullmatch(r"debian:(\w+)-slim", instruction("FROM"))[1]
    made = subprocess.run(["debootstrap", "--variant=minbase", suite, str(folder)], capture_output=True, text=True,
                          check=False)
    if made.returncode:
        pytest.skip(f"debootstrap: {made.stdout.splitlines()[-1]}")
    shutil.copy("/etc/resolv.conf", folder / "etc")
    if CERTIFICATES.exists():
        shutil.copy(CERTIFICATES, folder)
    return folder


def run(root: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """Run a command in the system in ``root``."""
    environment = {"PATH": "/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
                   **{name: os.environ[name] for name in NETWORK if name in os.environ}}
    if (root / CERTIFICATES.name).exists():
        environment["PIP_CERT"] = f"/{CERTIFICATES.name}"
    return subprocess.run(["unshare", "--mount", "--pid", "--fork", f"--mount-proc={root}/proc", "chroot", str(root),
                           *command], env=environment, capture_output=True, text=True, check=False)


def test_the_commands_install_a_program_that_draws(debian: Path) -> None:
    files = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=ROOT,
                           capture_output=True, text=True, check=True).stdout.splitlines()
    ignored = set((ROOT / ".dockerignore").read_text().split())
    for file in (file for file in files if file.split("/")[0] not in ignored):
        (debian / "src" / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / file, debian / "src" / file)
    installed = run(debian, "sh", "-c", instruction("RUN"))
    assert installed.returncode == 0, installed.stdout[-3000:] + installed.stderr[-3000:]
    assert not (debian / "src").exists()
    drawn = run(debian, *json.loads(instruction("ENTRYPOINT")), "--size", "64x48", "--out", instruction("WORKDIR"))
    assert drawn.returncode == 0, drawn.stderr
    assert read_png(debian / instruction("WORKDIR").strip("/") / "0000.png").mean() > 20
