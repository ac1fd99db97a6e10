"""``python -m export`` in a process of its own, so that ``app`` stays free of it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence

from app.bench.cold_start import environment
from app.errors import PathTracerError


def run_export(arguments: Sequence[str], expected: str) -> None:
    """Run one command of it.

    Raises
    ------
    PathTracerError
        With the command's own error line and what was ``expected`` when it fails.
    """
    done = subprocess.run([sys.executable, "-m", "export", *arguments], capture_output=True, text=True, check=False,
                          env=environment())
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        reason = next((line for line in lines if line.startswith("error: ")), lines[-1]).removeprefix("error: ")
        raise PathTracerError(f"it failed ({reason})", f"python -m export {' '.join(arguments[:2])}", f"expected {expected}")
