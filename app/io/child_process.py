"""Python modules run in child processes, among them ``python -m export``, which ``app`` never imports."""

import asyncio
import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from app.errors import ProcessError

ROOT = Path(__file__).resolve().parents[__name__.count(".")]  # contains the outermost packages
NICENESS = 5  # of children that must not slow this process down
GROUPS = ("dataset", "onnx", "validate", "golden")  # commands that have commands of their own
ERROR_LINE = re.compile(r"(?:error|[\w.]+\.errors\.\w+): (.+?): (.+) \((.+)\)")  # of a command, or a traceback's


def run_module(module: str, arguments: Sequence[str] = (), *, stdin: str = "") -> str:
    """Run ``python -m module`` with a text as its standard input and return what it printed.

    Raises
    ------
    ProcessError
        When it fails; says what its own error line says.
    """
    done = subprocess.run(_command(module, arguments), input=stdin, capture_output=True, text=True, check=False,
                          env=child_environment())
    if done.returncode:
        raise _error(module, arguments, done.returncode, done.stderr)
    return done.stdout


async def run_module_async(module: str, arguments: Sequence[str] = (), *, nice: bool = False) -> str:
    """``run_module`` without input; the child is killed when the waiting task is cancelled.

    Parameters
    ----------
    nice : bool
        Run it at a lower priority than this process.
    """
    prefix = ("nice", "-n", str(NICENESS)) if nice else ()
    process = await asyncio.create_subprocess_exec(
        *prefix, *_command(module, arguments), env=child_environment(), start_new_session=True,
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE)
    try:
        out, err = await process.communicate()
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            await process.wait()
    if process.returncode:
        raise _error(module, arguments, process.returncode, err.decode(errors="replace"))
    return out.decode(errors="replace")


def _command(module: str, arguments: Sequence[str]) -> list[str]:
    return [sys.executable, "-P", "-m", module, *arguments]  # -P: a file in the working directory can't hide a module


def child_environment() -> dict[str, str]:
    """Environment variables with which a child process imports these packages, whatever its working directory."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))}


def _error(module: str, arguments: Sequence[str], code: int, stderr: str) -> ProcessError:
    lines = stderr.strip().splitlines()
    if found := next(filter(None, map(ERROR_LINE.fullmatch, reversed(lines))), None):
        where, what, expected = found.groups()
        return ProcessError(what, where, expected)
    named = 2 if arguments and arguments[0] in GROUPS else 1
    reason = lines[-1] if lines else f"exit code {code}"
    return ProcessError(f"failed: {reason}", shlex.join(["python", "-m", module, *arguments[:named]]),
                        "run it in a terminal for all that it prints")
