"""Batches: resumable, and nothing is lost but the job in which something goes wrong."""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from app.batch import jobs as batch_jobs
from app.batch import worker_process
from app.batch.draw import TaskDrawer
from app.batch.jobs import BadLine, Job, Task, read_jobs, tasks_of
from app.batch.run import run_batch
from app.errors import DeviceError, SceneError
from app.io.image import read_exr

pytestmark = pytest.mark.gl
ROOT = Path(__file__).parents[2]
BOX = ROOT / "app" / "data" / "cornell-box.obj"
FAST = {"scene": str(BOX), "model": "none", "size": [24, 18]}
MAX_BYTES = 20_000  # of a file, more than the pictures of FAST have
CLOSE = {"eye": [0, 1, 3], "target": [0, 1, 0]}


def write_jobs(path: Path, *jobs: object) -> Path:
    path.write_text("\n".join(job if isinstance(job, str) else json.dumps(job) for job in jobs))
    return path


def start(file: Path, out: Path, *options: str, preexec: Callable[[], None] | None = None) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "app", "batch", str(file), "--out", str(out), *(options or ("--workers", "2"))]
    return subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            preexec_fn=preexec)


def heed_interrupts() -> None:
    """Shells let what they start in the background ignore interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def limit_files() -> None:
    """Let writing large files fail, as it does on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (MAX_BYTES, MAX_BYTES))


def contents(out: Path) -> dict[str, bytes]:
    return {str(file.relative_to(out)): file.read_bytes() for file in sorted(out.rglob("*")) if file.is_file()}


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    threads = Path(f"/proc/{process.pid}/task")
    try:
        return [int(pid) for thread in threads.iterdir() for pid in (thread / "children").read_text().split()]
    except OSError:
        return []  # a thread has just ended


def test_a_bad_job_is_a_line_and_an_exit_code(tmp_path: Path) -> None:
    (tmp_path / "broken.glb").write_bytes(b"glTF, but not really")
    file = write_jobs(tmp_path / "jobs.jsonl", {**FAST, "name": "good"}, {**FAST, "scene": "missing.obj"}, "{]",
                      {**FAST, "scene": "broken.glb"}, {**FAST, "cameras": ["nowhere"]}, {**FAST, "sizes": [1, 1]},
                      {**FAST, "lighting": "[/no markup]"},
                      {**FAST, "size": [200, 150], "name": "large"},
                      {**FAST, "cameras": [CLOSE, CLOSE], "name": "two"})
    process = start(file, tmp_path / "out", preexec=limit_files)
    table, _ = process.communicate()
    assert process.returncode == 1
    assert sorted(contents(tmp_path / "out")) == [
        "good/000.exr", "good/000.png", "good/stills.json", "two/000.exr", "two/000.png", "two/001.exr", "two/001.png",
        "two/stills.json"]
    errors = "".join(table.split())  # which are folded, and long paths with them
    for words in ("no such scene file", "valid JSON", "broken.glb", "nowhere", "sizes", "[/no markup]", "enough space"):
        assert words.replace(" ", "") in errors


def test_what_is_done_is_left_alone(tmp_path: Path) -> None:
    file, out = write_jobs(tmp_path / "jobs.jsonl", {**FAST, "name": "a"}, {**FAST, "name": "b"}), tmp_path / "out"
    assert start(file, out).wait() == 0
    before = {f: f.stat().st_mtime_ns for f in out.rglob("*")}
    write_jobs(file, {**FAST, "name": "a"}, {**FAST, "name": "b", "exposure": 2.0})
    process = start(file, out)
    process.communicate()
    changed = {f.parent.name for f in out.rglob("*.*") if f.stat().st_mtime_ns != before[f]}
    assert process.returncode == 0 and changed == {"b"}


def test_an_undone_change_is_drawn_again_if_its_pictures_were_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                                   ) -> None:
    (tmp_path / "dying_worker.py").write_text("")
    old, new = (Job("a", str(BOX), size=(24, 18), model="none", exposure=exposure) for exposure in (1.0, 2.0))
    TaskDrawer().draw(Task(old), tmp_path)
    with monkeypatch.context() as patch:
        patch.setenv("PYTHONPATH", str(tmp_path))
        patch.setattr(worker_process, "WORKER", "dying_worker")
        assert "workers died" in run_batch([new], tmp_path, print, workers=1)[0].error
    assert not Task(old).is_done(tmp_path)


def test_a_scene_that_changes_is_drawn_anew_by_the_same_worker(tmp_path: Path) -> None:
    scene, drawer = tmp_path / "box.obj", TaskDrawer()
    tasks = [Task(Job(name, str(scene), size=(24, 18), model="none", formats=("exr",))) for name in ("a", "b")]
    scene.write_text("v -1 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    drawer.draw(tasks[0], tmp_path)
    scene.write_text("v -1 0 0\nv 1 0 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n")
    drawer.draw(tasks[1], tmp_path)
    drawer.close()
    assert not tasks[0].is_done(tmp_path) and tasks[1].is_done(tmp_path)
    assert (tmp_path / "a" / "000.exr").read_bytes() != (tmp_path / "b" / "000.exr").read_bytes()


def test_an_interrupted_batch_ends_soon(tmp_path: Path) -> None:
    file = write_jobs(tmp_path / "jobs.jsonl", *({**FAST, "size": [24 + index, 18]} for index in range(30)))
    process = start(file, tmp_path / "out", "--workers", "1", preexec=heed_interrupts)
    while not list((tmp_path / "out").glob("*/stills.json")):
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    process.communicate()
    assert process.returncode == 130
    assert len(list((tmp_path / "out").glob("*/stills.json"))) < 15


@contextmanager
def on_cores(file: Path, out: Path) -> Iterator[tuple[subprocess.Popen[str], Callable[[], list[int]]]]:
    """A batch on this machine's cores, and what tells the numbers of its workers."""
    process = start(file, out)
    yield process, lambda: workers_of(process)


@contextmanager
def on_cluster(file: Path, out: Path) -> Iterator[tuple[subprocess.Popen[str], Callable[[], list[int]]]]:
    """A batch on a Dask cluster."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
                                  ) as cluster:
        yield (start(file, out, "--scheduler", cluster.scheduler_address),
               lambda: [nanny.pid for nanny in cluster.workers.values() if nanny.pid])


@pytest.mark.parametrize("begin", [on_cores, on_cluster])
@pytest.mark.parametrize(("count", "kills"), [(6, 1), pytest.param(200, 10, marks=pytest.mark.long)])
def test_killed_workers_lose_nothing(tmp_path: Path, count: int, kills: int, begin: Callable[..., object]) -> None:
    cameras = [{**CLOSE, "eye": [0.01 * index, 1, 3]} for index in range(count)]
    file = write_jobs(tmp_path / "jobs.jsonl", *({**FAST, "cameras": [camera]} for camera in cameras))
    out, rng, records = tmp_path / "disturbed", random.Random(0), {}
    moments = [rng.uniform(0, 0.9) * count for _ in range(kills)]
    with begin(file, out) as (process, workers):
        while process.poll() is None:
            for record in out.glob("*/stills.json"):
                records.setdefault(record, record.stat().st_mtime_ns)
            if moments and len(records) >= min(moments) and (alive := workers()):
                os.kill(rng.choice(alive), signal.SIGKILL)
                moments.remove(min(moments))
            time.sleep(0.02)
        assert process.returncode == 0 and not moments
    assert all(record.stat().st_mtime_ns == first for record, first in records.items())  # none was drawn again
    assert start(file, tmp_path / "undisturbed").wait() == 0
    assert contents(out) == contents(tmp_path / "undisturbed")


DEADLY_WORKER = """
import json, os, signal, sys
for line in sys.stdin:
    if json.loads(line)["task"]["job"]["name"] == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    print('""', flush=True)
"""


@pytest.mark.parametrize("where", ["cores", "cluster"])
def test_a_job_that_kills_its_workers_is_given_up_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
                                                        ) -> None:
    (tmp_path / "deadly_worker.py").write_text(DEADLY_WORKER)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(worker_process, "WORKER", "deadly_worker")
    jobs: list[Job | BadLine] = [Job(name, str(BOX)) for name in ("a", "deadly", "b", "c")]
    if where == "cores":
        outcomes = run_batch(jobs, tmp_path, print, workers=2)
    else:
        distributed = pytest.importorskip("distributed")
        with distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
                                      ) as cluster:
            outcomes = run_batch(jobs, tmp_path, print, scheduler=cluster.scheduler_address)
    assert {outcome.name: outcome.drawn for outcome in outcomes} == {"a": 1, "deadly": 0, "b": 1, "c": 1}
    assert outcomes[1].error == "deadly: workers died with it (expected enough memory for its scene and size)"


def test_a_missing_scheduler_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("app.io.dask_client.CONNECT_SECONDS", 1)
    with pytest.raises(DeviceError, match="can't reach the scheduler"):
        run_batch([Job("a", str(BOX))], tmp_path, print, scheduler="tcp://127.0.0.1:1")


def test_a_task_that_is_done_is_not_drawn_again(tmp_path: Path) -> None:
    task, drawer = Task(Job("a", str(BOX), size=(24, 18), model="none")), TaskDrawer()
    drawer.draw(task, tmp_path)
    before = {f: f.stat().st_mtime_ns for f in tmp_path.rglob("*.*")}
    drawer.draw(task, tmp_path)
    drawer.close()
    assert {f: f.stat().st_mtime_ns for f in tmp_path.rglob("*.*")} == before


def test_a_killed_batch_continues(tmp_path: Path) -> None:
    file = write_jobs(tmp_path / "jobs.jsonl", *({**FAST, "exposure": 1 + index} for index in range(6)))
    out = tmp_path / "out"
    process = start(file, out)
    while not list(out.glob("*/stills.json")):
        time.sleep(0.05)
    process.kill()
    process.communicate()
    first = {f: f.stat().st_mtime_ns for f in out.glob("*/stills.json")}
    assert start(file, out).wait() == 0
    assert len(list(out.glob("*/stills.json"))) == 6
    assert all(f.stat().st_mtime_ns == when for f, when in first.items())


def test_long_videos_are_cut_without_visible_seams(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch_jobs, "CHUNK", 20)
    job = Job("v", str(BOX), size=(48, 36), model="none", frames=30, formats=("exr",))
    assert [(t.first, t.last) for t in tasks_of(job)] == [(0, 20), (20, 30)]
    drawer = TaskDrawer()
    for task in tasks_of(job):
        drawer.draw(task, tmp_path)
    cut = read_exr(tmp_path / "v" / "000" / "0020.exr")[""]
    drawer.draw(Task(job, 0, 0, 30), tmp_path)
    drawer.close()
    whole = read_exr(tmp_path / "v" / "000" / "0020.exr")[""]
    before = read_exr(tmp_path / "v" / "000" / "0019.exr")[""]
    assert np.abs(cut - whole).mean() < 0.01 * whole.mean()
    assert np.abs(cut - before).mean() < 0.01 * whole.mean()


def test_flow_continues_across_seams(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch_jobs, "CHUNK", 2)
    scene = {"cameras": {"c": {"keys": [{**CLOSE, "time": 0}, {"eye": [5, 1, 3], "target": [5, 1, 0], "time": 1}]}}}
    (tmp_path / "box.json").write_text(json.dumps(scene))
    (tmp_path / "box.obj").write_text("v -1 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n")
    job = Job("v", str(tmp_path / "box.obj"), cameras=("c",), size=(48, 36), model="none", frames=4, outputs=("flow",),
              formats=("exr",))
    drawer = TaskDrawer()
    for task in tasks_of(job):
        drawer.draw(task, tmp_path)
    drawer.close()
    for frame in range(4):
        assert np.abs(read_exr(tmp_path / "v" / "000" / f"{frame:04d}.exr")["flow"]).max() > 0.1


@pytest.mark.parametrize("spec", [{"scene": "a\0"}, {"scene": "\ud800.glb"}, {"scene": "loop/a.glb"},
                                  {"scene": "a.glb", "model": "m" * 300}])
def test_a_bad_name_of_a_file_is_a_bad_line(tmp_path: Path, spec: dict[str, str]) -> None:
    (tmp_path / "loop").symlink_to("loop")
    bad, good = read_jobs(write_jobs(tmp_path / "jobs.jsonl", spec, FAST))
    assert isinstance(bad, BadLine) and "expected paths of files" in bad.error and isinstance(good, Job)


def test_two_networks_beside_the_jobs_are_found_and_a_change_of_either_is_seen(tmp_path: Path) -> None:
    for name in ("a.onnx", "b.onnx"):
        (tmp_path / name).write_bytes(b"1")
    job, = read_jobs(write_jobs(tmp_path / "jobs.jsonl", {"scene": "a.glb", "model": "a.onnx+b.onnx"}))
    assert isinstance(job, Job) and job.model == f"{tmp_path / 'a.onnx'}+{tmp_path / 'b.onnx'}"
    before = Task(job).key()
    (tmp_path / "b.onnx").write_bytes(b"12")
    assert Task(job).key() != before


def test_a_file_without_jobs_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="there is no job in the file"):
        read_jobs(write_jobs(tmp_path / "jobs.jsonl", "", " "))


def test_lines_end_only_where_json_lines_do(tmp_path: Path) -> None:
    (tmp_path / "jobs.jsonl").write_text('{"scene": "a\u2028b.glb"}\r\n{"scene": "c.glb"}\n', "utf-8")
    assert [job.name for job in read_jobs(tmp_path / "jobs.jsonl")] == ["0000", "0001"]


def test_lines_are_jobs_with_names_and_files_beside_them(tmp_path: Path) -> None:
    file = write_jobs(tmp_path / "jobs.jsonl", {"scene": "a.glb"}, {"scene": "b.glb", "name": "b"},
                      {"scene": "c.glb", "name": "b"}, {"scene": "d.glb", "name": "../d"},
                      {"scene": "e.glb", "cameras": [7]})
    first, second, third, fourth, fifth = read_jobs(file)
    assert first == Job("0000", str(tmp_path / "a.glb")) and second.name == "b"
    assert isinstance(third, BadLine) and "taken" in third.error
    assert isinstance(fourth, BadLine) and f"{file}: [4]" in fourth.error
    assert isinstance(fifth, BadLine) and "expected a string or an object" in fifth.error
