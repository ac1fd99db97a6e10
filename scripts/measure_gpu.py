"""Measure the renderer on this machine's GPU: what the driver says, what is drawn, and what it costs.

``OUT/gpu.json`` has all numbers. The script also runs without a GPU or without CUDA; sections that can't run say why.
"""

from __future__ import annotations

import argparse
import json
import sys
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # app and export, which need not be installed

from gpu_sections.agreement import goldens, pictures, run_tests
from gpu_sections.common import Json, Options
from gpu_sections.device import machine, transfers
from gpu_sections.exchanges import exchanges
from gpu_sections.frames import frames
from gpu_sections.networks import network, onnxruntime_cuda
from gpu_sections.shaders import shaders

Section = Callable[[Options], Json]

SECTIONS: dict[str, Section] = {
    "machine": machine, "transfers": transfers, "shaders": shaders, "frames": frames, "network": network,
    "exchanges": exchanges, "onnxruntime_cuda": onnxruntime_cuda,
    "pictures": pictures, "goldens": goldens}
MAX_PRINTED = 1500  # characters of a section's result


def main() -> None:
    arguments = _parse_arguments()
    options = Options(arguments.out, arguments.quick, arguments.scene)
    options.out.mkdir(parents=True, exist_ok=True)
    sections = {name: SECTIONS[name] for name in arguments.sections or SECTIONS}
    if arguments.tests:
        sections = {"machine": machine, "tests": partial(run_tests, seconds=arguments.test_seconds)}
    results: Json = {}
    for name, section in sections.items():
        begin = perf_counter()
        results[name] = _run(section, options)
        text = json.dumps(results[name], default=str)
        print(f"== {name} {perf_counter() - begin:.1f} s: {text[:MAX_PRINTED]}", flush=True)
        (options.out / "gpu.json").write_text(json.dumps(results, indent=1, default=str) + "\n", "utf-8")


def _run(section: Section, options: Options) -> Json:
    """A section's result; a failure must not stop the others."""
    try:
        return section(options)
    except Exception as error:
        return {"failed": f"{type(error).__name__}: {error}", "trace": traceback.format_exc()[-MAX_PRINTED:]}


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="OUT", help="folder for gpu.json, pictures and logs")
    parser.add_argument("sections", nargs="*", type=_section_name, metavar="SECTION",
                        help=f"measure only these, of {', '.join(SECTIONS)} (default: all)")
    parser.add_argument("--quick", action="store_true", help="draw small pictures and few frames")
    parser.add_argument("--scene", type=Path, metavar="FILE", help="also time the frames of this scene")
    parser.add_argument("--tests", action="store_true", help="run the GL tests instead of the other sections")
    parser.add_argument("--test-seconds", type=float, default=200, metavar="S", help="stop the tests after this time")
    arguments = parser.parse_args()
    if arguments.tests and arguments.sections:
        parser.error("--tests runs no other section")
    return arguments


def _section_name(name: str) -> str:
    if name not in SECTIONS:
        raise argparse.ArgumentTypeError(f"no section {name!r}, expected one of {', '.join(SECTIONS)}")
    return name


if __name__ == "__main__":
    main()
