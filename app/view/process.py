"""Commands of this program in processes of their own, which end with the task that waits for them."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import Sequence

from app.bench.cold_start import environment
from app.errors import AfterglowError, PathTracerError

NICE = 5  # so that frames come first


async def run_module(module: str, arguments: Sequence[str], *, nice: bool = False) -> str:
    """Run ``python -m module`` and wait for its end; what it printed.

    Raises
    ------
    AfterglowError
        With the command's own error line when it fails.
    """
    prefix = ("nice", "-n", str(NICE)) if nice else ()
    process = await asyncio.create_subprocess_exec(
        *prefix, sys.executable, "-P", "-m", module, *arguments, env=environment(), start_new_session=True,
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE)
    try:
        out, err = await process.communicate()
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, 9)
            await process.wait()
    if process.returncode:
        raise _error(module, err.decode(errors="replace"))
    return out.decode(errors="replace")


def _error(module: str, text: str) -> AfterglowError:
    lines = text.strip().splitlines() or ["no reason given"]
    reason = next((line for line in lines if line.startswith("error: ")), lines[-1]).removeprefix("error: ")
    return PathTracerError(f"it failed ({reason})", f"python -m {module}", "expected it to end well")
