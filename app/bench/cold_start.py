"""Start-up time and peak memory, measured in a child process.

The child runs ``python -m app.bench.cold_start``: a JSON object on standard input, another one on standard output.
"""

import json
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

from app.evaluation.configurations import Configuration
from app.io.child_process import run_module


def measure_cold_start(scene: Path, lighting: str | None, camera: str | None, variant: str | None,
                       configuration: Configuration, provider: str) -> dict[str, float]:
    """Draw one frame in a new process.

    Returns
    -------
    dict of str to float
        ``startup_s``: seconds from the loaded scene to the first picture in memory; ``peak_mb``: peak resident set
        of the whole process in MB, scene included.

    Raises
    ------
    ProcessError
        When the process fails.
    """
    task = {"scene": str(scene), "lighting": lighting, "camera": camera, "variant": variant,
            "provider": provider, "size": configuration.size, "scale": configuration.scale,
            "render_scale": configuration.render_scale,
            "models": [str(model) for model in configuration.models]}
    return json.loads(run_module("app.bench.cold_start", stdin=json.dumps(task)))


def _draw_first_frame(task: dict[str, Any]) -> dict[str, float]:
    from app.load import load_scene  # the parent process needs none of these
    from app.network.selection import find_model
    from app.renderer import Renderer
    from app.settings import Settings

    scene = load_scene(task["scene"], lighting=task["lighting"], variant=task["variant"])
    camera = scene.cameras[task["camera"] or scene.default_camera].at(0.0)
    begin = perf_counter()
    settings = Settings(size=tuple(task["size"]), scale=task["scale"], render_scale=task["render_scale"],
                        provider=task["provider"])
    with Renderer(scene, settings, [find_model(name) for name in task["models"]]) as renderer:
        renderer.render(camera)
        return {"startup_s": perf_counter() - begin, "peak_mb": _peak_bytes() / 1e6}


def _peak_bytes() -> int:
    """VmHWM of proc(5), which unlike ``getrusage`` does not include the process that this one was forked from."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024


if __name__ == "__main__":
    print(json.dumps(_draw_first_frame(json.load(sys.stdin))))
