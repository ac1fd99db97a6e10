"""The jobs of a batch, one JSON object per line, and the tasks that workers draw."""

import hashlib
import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from app import __version__
from app.errors import AfterglowError, SceneError
from app.io.checked_json import at, check, parse
from app.load import parse_camera
from app.network.selection import DEFAULT_MODEL, SEPARATOR

SCHEMA = "batch.schema.json"
CHUNK = 60     # frames of a video that are drawn by one worker
LEAD_IN = 16   # frames drawn before those of a later chunk, so that its seam does not show


@dataclass(frozen=True)
class Job:
    """One line.

    Attributes
    ----------
    name : str
        Its folder.
    cameras : tuple
        Names, cameras as in a scene JSON, or None for the default one.
    frames : int
        1: a still of each camera; more: a video of each.
    """

    name: str
    scene: str
    cameras: tuple[Any, ...] = (None,)
    lighting: str | None = None
    model: str = DEFAULT_MODEL
    size: tuple[int, int] = (1024, 768)
    outputs: tuple[str, ...] = ("final",)
    formats: tuple[str, ...] = ("exr", "png")
    frames: int = 1
    time: float = 0.0
    exposure: float = 1.0
    tonemap: str = "srgb"

    @property
    def renderer_settings(self) -> tuple[Any, ...]:
        """What a renderer is made for: it can draw all jobs of which this is the same."""
        return self.scene, self.lighting, self.model, self.size, self.outputs, self.tonemap

    def files_digest(self) -> bytes:
        """A digest of the scene, its JSON file and the networks, as they are now."""
        digest = hashlib.sha256()
        scene = Path(self.scene)
        for file in (scene, scene.with_suffix(".json"), Path(self.model), *map(Path, self.model.split(SEPARATOR))):
            with suppress(OSError, ValueError):  # a name, or a file of which loading says what is wrong
                status = file.stat()
                digest.update(_digest_of(file, status.st_size, status.st_mtime_ns))
        return digest.digest()


@dataclass(frozen=True)
class BadLine:
    """A line that is no job."""

    name: str
    error: str


@dataclass(frozen=True)
class Task:
    """What one worker draws at a time: all stills of a job, or a chunk of a video by one of its cameras.

    Attributes
    ----------
    camera : int or None
        Index into the job's cameras; None for stills of all.
    first, last : int
        Numbers of its frames; ``last`` is excluded.
    """

    job: Job
    camera: int | None = None
    first: int = 0
    last: int = 1

    @property
    def record(self) -> str:
        """The file, relative to the output folder, that says that the task is done."""
        part = "stills" if self.camera is None else f"{self.camera:03d}-{self.first:04d}"
        return f"{self.job.name}/{part}.json"

    def key(self) -> str:
        """A digest of everything that its pictures depend on; changed files change it."""
        text = json.dumps([asdict(self), __version__], sort_keys=True)
        return hashlib.sha256(text.encode() + self.job.files_digest()).hexdigest()[:32]

    def is_done(self, out: Path) -> bool:
        """Whether its pictures are in the folder ``out``, drawn from the same files."""
        try:
            return bool(json.loads((out / self.record).read_text("utf-8"))["key"] == self.key())
        except (OSError, ValueError, KeyError, TypeError):
            return False


def read_jobs(path: Path) -> list[Job | BadLine]:
    """The jobs of a file; names of files in it are relative to its folder.

    Raises
    ------
    SceneError
        When the file can't be read or has no jobs.
    """
    try:
        lines = path.read_text("utf-8-sig").split("\n")
    except (OSError, ValueError) as error:
        raise SceneError("can't read the jobs", path, "expected a readable UTF-8 file of one JSON object per line"
                         ) from error
    jobs: list[Job | BadLine] = []
    names: set[str] = set()
    for number, line in enumerate(lines, 1):
        if line.strip():
            name = f"{len(jobs):04d}"
            try:
                job = _read_job(line, name, at(path, number), path.parent)
                if job.name in names:
                    raise SceneError(f"the name {job.name!r} is taken", at(path, number, "name"),
                                     "expected another name for each job")
                names.add(job.name)
                jobs.append(job)
            except AfterglowError as error:
                jobs.append(BadLine(f"line {number}", str(error)))
    if not jobs:
        raise SceneError("there is no job in the file", path, "expected one JSON object per line")
    return jobs


@cache
def _digest_of(file: Path, size: int, modified: int) -> bytes:
    """The digest of a file, which is read again when its size or its time has changed."""
    return hashlib.sha256(file.read_bytes()).digest()


def tasks_of(job: Job) -> Iterator[Task]:
    if job.frames == 1:
        yield Task(job)
        return
    for camera in range(len(job.cameras)):
        for first in range(0, job.frames, CHUNK):
            yield Task(job, camera, first, min(first + CHUNK, job.frames))


def _read_job(line: str, name: str, where: str, folder: Path) -> Job:
    try:
        spec = parse(line)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"not a JSON object ({str(error)[:60]})", where, "expected valid JSON") from None
    check(spec, where, "", SCHEMA)
    for index, camera in enumerate(spec.get("cameras", ())):
        if isinstance(camera, dict):
            parse_camera(camera, at(where, "cameras", index))
    try:
        scene = str((folder / spec["scene"]).resolve())
        model = _find_networks(spec.get("model", DEFAULT_MODEL), folder)
    except (OSError, ValueError, RuntimeError) as error:  # too long, no UTF-8, a loop of links
        raise SceneError(f"no name of a file ({str(error)[:60]})", where, "expected paths of files") from None
    lists = {key: tuple(spec[key]) for key in ("cameras", "outputs", "formats") if key in spec}
    size = {"size": tuple(map(int, spec["size"]))} if "size" in spec else {}
    frames = {"frames": int(spec["frames"])} if "frames" in spec else {}
    return Job(**{"name": name, **spec, **lists, **size, **frames, "model": model, "scene": scene})


def _find_networks(model: str, folder: Path) -> str:
    """``model`` with whole paths of those of its networks that are files in ``folder``."""
    names = [model] if (folder / model).is_file() else model.split(SEPARATOR)
    return SEPARATOR.join(str((folder / name).resolve()) if (folder / name).is_file() else name for name in names)
