"""Start-up time and peak memory, in a process that does nothing else.

Run as ``python -m app.bench.cold_start``, with a JSON object on standard input and another one on standard output.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

from app.errors import DeviceError
from app.evaluation.configurations import Configuration

PACKAGES = Path(__file__).resolve().parents[2]  # where ``app`` and ``export`` lie


def environment() -> dict[str, str]:
    """Variables of a process that is to find this very ``app``, wherever it is started."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(PACKAGES), os.environ.get("PYTHONPATH", "")])}


def start(scene: Path, lighting: str | None, camera: str | None, configuration: Configuration,
          provider: str) -> dict[str, float]:
    """Draw one frame in a process of its own.

    Returns
    -------
    dict of str to float
        ``startup_s``: seconds from a loaded scene to the first picture in memory; ``peak_mb``: largest resident
        set in MB of the whole process, scene included.

    Raises
    ------
    DeviceError
        When that process fails.
    """
    task = {"scene": str(scene), "lighting": lighting, "camera": camera, "size": configuration.size,
            "models": [str(model) for model in configuration.models], "provider": provider}
    done = subprocess.run([sys.executable, "-m", "app.bench.cold_start"], input=json.dumps(task), capture_output=True,
                          text=True, check=False, env=environment())
    if done.returncode:
        reason = (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1]
        raise DeviceError(f"the first frame failed in a fresh process ({reason})", configuration.label,
                          "expected a picture")
    return json.loads(done.stdout)


def _draw_first_frame(task: dict[str, Any]) -> dict[str, float]:
    from app.load import load_scene
    from app.network.contract import find_model
    from app.renderer import Renderer
    from app.settings import Settings

    scene = load_scene(task["scene"], lighting=task["lighting"])
    camera = scene.cameras[task["camera"] or scene.default_camera].at(0.0)
    begin = perf_counter()
    settings = Settings(size=tuple(task["size"]), provider=task["provider"])
    with Renderer(scene, settings, [find_model(name) for name in task["models"]]) as renderer:
        renderer.render(camera)
        return {"startup_s": perf_counter() - begin, "peak_mb": _peak_bytes() / 1e6}


def _peak_bytes() -> int:
    """VmHWM of proc(5): unlike ``getrusage`` it forgets what the process was forked from."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024


if __name__ == "__main__":
    print(json.dumps(_draw_first_frame(json.load(sys.stdin))))
