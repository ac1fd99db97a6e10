"""Draws the catalogue, keeps what every pass wrote, and compares it with what was kept.

A golden folder holds, for each case, ``CASE/RESOURCE.exr`` in half floats with a layer ``frameN`` for each frame
kept, and ``CASE/origin.json``, which names the renderer that drew them.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.atomic import replacing_folder, write_text
from app.channels import HALF_MAX
from app.contract import find_model
from app.errors import OutputError, SceneError
from app.golden.scenes import FRAME_SECONDS, Case
from app.graph import Buf
from app.image import read_exr, write_exr
from app.renderer import Renderer
from app.settings import Settings

ORIGIN = "origin.json"
OUTPUTS = ("final", "position")  # what makes every pass run
MOST_TEXELS = 2**16              # of a golden; shadow atlases and tensors are thinned to it

F32 = NDArray[np.float32]
Prepare = Callable[[Renderer], None]


@dataclass(frozen=True)
class Tolerance:
    """How far a stage may be from its golden.

    Attributes
    ----------
    difference : float
        A texel is off when one of its components differs by more than this times 1 + |golden|.
    share : float
        Largest share of the texels that may be off.
    """

    difference: float
    share: float


SAME_RENDERER = Tolerance(2e-3, 5e-4)    # another CPU may round otherwise
OTHER_RENDERER = Tolerance(2e-2, 2e-2)   # another driver also rasterises edges and filters textures otherwise


@dataclass(frozen=True)
class Picture:
    """What pass ``stage`` wrote into ``resource``, thinned, by frame; [H, W, 1 to 4], in the order of the plan."""

    stage: str
    resource: str
    frames: dict[int, F32]


@dataclass(frozen=True)
class Finding:
    """The judgement on one golden.

    Attributes
    ----------
    stage : str
        The pass that wrote it; empty for a file that no pass writes.
    verdict : str
        ``same``, ``close``, ``differs``, ``missing``, ``orphan``, or ``unsteady`` when two runs were not bit-identical.
    difference : float
        Largest difference, relative to 1 + |golden|.
    share : float
        Share of the texels that are off.
    """

    case: str
    stage: str
    resource: str
    verdict: str
    difference: float = 0.0
    share: float = 0.0

    @property
    def ok(self) -> bool:
        return self.verdict in ("same", "close")


@dataclass(frozen=True)
class Report:
    """All findings of one check, those of each case in the order of its passes.

    Attributes
    ----------
    renderer : str
        GL renderer and version that drew now.
    foreign : dict of str to str
        Cases whose goldens come from another renderer, with its name: the wider tolerance holds for them.
    """

    findings: list[Finding]
    renderer: str
    foreign: dict[str, str]

    @property
    def broken(self) -> list[Finding]:
        return [f for f in self.findings if not f.ok]


def draw(case: Case, prepare: Prepare | None = None) -> tuple[str, list[Picture]]:
    """Draw a case in a renderer of its own.

    Parameters
    ----------
    prepare : callable, optional
        Called with the renderer before the first frame.

    Returns
    -------
    tuple
        GL renderer and version, and the pictures of all resources.
    """
    path = case.scene.cameras[case.scene.default_camera]
    settings = Settings(size=case.size, outputs=OUTPUTS, provider="cpu")
    with Renderer(case.scene, settings, find_model(case.model) if case.model else None) as renderer:
        if prepare is not None:
            prepare(renderer)
        pictures = [Picture(p.name, w, {}) for p in renderer.plan.passes for w in p.writes]
        for frame in range(1, case.frames + 1):
            time = (frame - 1) * FRAME_SECONDS
            renderer.advance(path.at(time), time)
            if frame in case.kept:
                for picture in pictures:
                    picture.frames[frame] = _seen(renderer, picture.resource)
        return f"{renderer.device['gl_renderer']}, OpenGL {renderer.device['gl_version']}", pictures


def check(cases: Iterable[Case], folder: Path, prepare: Prepare | None = None,
          progress: Callable[[str], None] = lambda _: None) -> Report:
    """Draw each case twice, demand the same bits, and compare with the goldens in ``folder``.

    Parameters
    ----------
    prepare : callable, optional
        Called with each renderer before its first frame.
    progress : callable, optional
        Called with the name of each case before it is drawn.

    Raises
    ------
    SceneError
        When a golden can't be read.
    """
    findings: list[Finding] = []
    foreign: dict[str, str] = {}
    renderer = ""
    for case in cases:
        progress(case.name)
        renderer, pictures = draw(case, prepare)
        again = draw(case, prepare)[1]
        origin = _origin(folder / case.name / ORIGIN)
        if origin not in (None, renderer):
            foreign[case.name] = str(origin)
        tolerance = OTHER_RENDERER if case.name in foreign else SAME_RENDERER
        findings += [_judge(case, picture, other, folder, tolerance)
                     for picture, other in zip(pictures, again, strict=True)]
        known = {ORIGIN, *(f"{p.resource}.exr" for p in pictures)}
        if origin is None:
            findings.append(Finding(case.name, "", ORIGIN, "missing"))
        findings += [Finding(case.name, "", name, "orphan") for name in _names(folder / case.name) if name not in known]
    return Report(findings, renderer, foreign)


def orphan_cases(folder: Path, known: Iterable[str]) -> list[Finding]:
    """What lies in ``folder`` and belongs to no case of the catalogue."""
    return [Finding(name, "", name, "orphan") for name in _names(folder) if name not in set(known)]


def update(cases: Sequence[Case], folder: Path, known: Iterable[str]) -> list[Path]:
    """Draw ``cases`` and write their goldens, all or none; those of other ``known`` cases stay.

    Raises
    ------
    OutputError
        When ``folder`` holds other things than goldens, or can't be written.
    """
    for file in (f for f in folder.rglob("*") if not f.is_dir()):
        if file.parent.parent != folder or not (file.suffix == ".exr" or file.name == ORIGIN):
            raise OutputError(f"{file.relative_to(folder)} is no golden image", folder,
                              "expected a folder of goldens alone, or a new one")
    if folder.exists() and not folder.is_dir():
        raise OutputError("this is no folder", folder, "expected a folder of goldens, or a new one")
    drawn = {case.name: draw(case) for case in cases}
    with replacing_folder(folder) as fresh:
        for name in (n for n in known if n not in drawn and (folder / n).is_dir()):
            shutil.copytree(folder / name, fresh / name)
        for name, (renderer, pictures) in drawn.items():
            (fresh / name).mkdir()
            for p in pictures:
                write_exr(fresh / name / f"{p.resource}.exr", {_layer(n): _half(x) for n, x in p.frames.items()})
            write_text(fresh / name / ORIGIN, json.dumps({"renderer": renderer}, indent=2) + "\n")
    return sorted(folder.rglob("*.exr"))


def _judge(case: Case, picture: Picture, again: Picture, folder: Path, tolerance: Tolerance) -> Finding:
    def finding(verdict: str, difference: float = 0.0, share: float = 0.0) -> Finding:
        return Finding(case.name, picture.stage, picture.resource, verdict, difference, share)

    if any(not np.array_equal(now, again.frames[n], equal_nan=True) for n, now in picture.frames.items()):
        return finding("unsteady", *_compare(picture.frames, again.frames, 0.0))
    path = folder / case.name / f"{picture.resource}.exr"
    if not path.exists():
        return finding("missing")
    stored = read_exr(path)
    golden = {n: stored[_layer(n)] for n in picture.frames if _layer(n) in stored}
    if len(golden) < len(picture.frames):
        return finding("missing")
    if len(golden) < len(stored):
        return finding("orphan")
    difference, share = _compare({n: _half(x).astype(np.float32) for n, x in picture.frames.items()}, golden,
                                 tolerance.difference)
    if difference == 0.0:
        return finding("same")
    return finding("close" if share <= tolerance.share else "differs", difference, share)


def _compare(now: dict[int, F32], golden: dict[int, F32], limit: float) -> tuple[float, float]:
    """Largest difference, and largest share of texels beyond ``limit``; what is not a number in both is equal."""
    worst = share = 0.0
    for n, a in now.items():
        b = golden[n]
        if a.shape != b.shape:
            return math.inf, 1.0
        with np.errstate(invalid="ignore"):
            off = np.abs(a - b) / (1 + np.abs(b))
        off = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.nan_to_num(off, nan=math.inf)).max(axis=2)
        worst, share = max(worst, float(off.max())), max(share, float((off > limit).mean()))
    return worst, share


def _seen(renderer: Renderer, resource: str) -> F32:
    """A resource as [H, W, 1 to 4], every n-th texel of it; a tensor's planes lie one below the other."""
    image = np.asarray(renderer.resource(resource), np.float32)
    if isinstance(renderer.plan.resources[resource], Buf):
        image = image.reshape(-1, image.shape[-1], 1)
    step = max(1, math.ceil(math.sqrt(image.shape[0] * image.shape[1] / MOST_TEXELS)))
    return np.ascontiguousarray(image[::step, ::step])


def _half(pixels: F32) -> NDArray[np.float16]:
    return np.clip(pixels, -HALF_MAX, HALF_MAX).astype(np.float16)


def _layer(frame: int) -> str:
    return f"frame{frame}"


def _origin(path: Path) -> str | None:
    """The renderer that drew a case's goldens; None without that file."""
    try:
        return str(json.loads(path.read_text("utf-8"))["renderer"])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SceneError(f"can't read the origin of the goldens ({error})", path,
                         'expected {"renderer": …}; golden update writes it') from None


def _names(folder: Path) -> Iterator[str]:
    if folder.is_dir():
        yield from sorted(file.name for file in folder.iterdir())
