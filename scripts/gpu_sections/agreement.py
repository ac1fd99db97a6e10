"""Agreement with other machines: golden images, pictures and tests."""

from __future__ import annotations

import shutil
import subprocess

from gpu_sections.common import Json, Options, run_python

MAX_PAGE_BYTES = 15 << 20
VERDICTS = (" differs", "unsteady", "missing")
TEST_PROCESSES = 8


def goldens(options: Options) -> Json:
    """Compare with the golden images; the log is ``golden.txt``, the page of differences ``golden.html``."""
    page = options.out / "golden.html"
    cases = ["spotlights"] if options.quick else []
    done = run_python("-P", "-m", "app", "golden", "check", *cases, "--report", str(page.resolve()))
    (options.out / "golden.txt").write_text(done.stdout + done.stderr, "utf-8")
    if page.exists() and page.stat().st_size > MAX_PAGE_BYTES:
        page.unlink()
    broken = [line for line in done.stdout.splitlines() if any(verdict in line for verdict in VERDICTS)]
    return {"exit_code": done.returncode, "broken": len(broken), "first": broken[:12]}


def pictures(options: Options) -> Json:
    """Draw EXR files to be compared with those of the same command on another machine."""
    rows = {}
    for model in ("none", "ember", "ssgi"):
        folder = (options.out / f"frames_{model}").resolve()
        done = run_python("-P", "-m", "app", "--size", "96x72" if options.quick else "1024x768", "--model", model,
                          "--provider", "cpu", "--out", str(folder), "--check", "--format", "exr")
        rows[model] = {"exit_code": done.returncode, "error": done.stderr[-300:] if done.returncode else ""}
        if done.returncode == 0:
            shutil.copy(folder / "0000.exr", options.out / f"{model}.exr")
    return rows


def run_tests(options: Options, seconds: float) -> Json:
    """Run the GL tests for at most ``seconds``; the log is ``tests.txt``."""
    try:
        done = run_python("-m", "pytest", "-q", "--maxfail=40", "-p", "no:cacheprovider", "-n", str(TEST_PROCESSES),
                          "--dist", "loadfile", "tests/gl", "tests/robustness", "--ignore=tests/gl/test_wheel.py",
                          timeout=seconds)
    except subprocess.TimeoutExpired:
        return {"timed_out_after_s": seconds}
    (options.out / "tests.txt").write_text(done.stdout[-400_000:] + done.stderr[-20_000:], "utf-8")
    return {"exit_code": done.returncode, "last_lines": done.stdout.splitlines()[-25:]}
