"""glTF assets against the path tracer: direct light, and final pictures of what light passes.

Assets of opaque materials are compared by their direct light under a point and a spot light. What is seen through
glass is direct light of no single surface, so those with blended or transmissive materials are compared by all of their
light, on a ground in the studio.
"""

import csv
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.arrays import F32, F64
from app.errors import AfterglowError, SettingsError
from app.evaluation.denoise import denoise
from app.evaluation.metrics import exposure_of, psnr, tone_map
from app.evaluation.tables import to_csv
from app.io.atomic_files import write_text
from app.load import auto_camera, load_scene
from app.load.studio import STUDIO
from app.math3d import look_rotation
from app.network.selection import DEFAULT_MODEL, find_model
from app.renderer import Renderer
from app.scene import Camera, Light, PointLight, SpotLight
from app.settings import SETTLE_FRAMES, Settings
from export.reference.path_tracer import MAX_BOUNCES, PathTracer
from export.reference.still import Still
from export.reference.trace import TracedMeans
from export.validation.pictures import write_shown

SUFFIXES = (".glb", ".gltf")
LIGHTS = {"point": (0.4, 0.6), "spot": (-0.5, 0.4)}  # from the eye, to the right and up, per distance of the target
SPOT_DEG = 12.0, 18.0
TABLE = "assets.csv"
COLUMNS = (*LIGHTS, STUDIO, "noise")
DIFFERENCE = 4.0  # factor of the third picture
HALF_NOISE = 20 * math.log10(2)  # dB by which the mean of two pictures has less noise than their difference

Row = dict[str, object]


@dataclass(frozen=True, eq=False)
class LitAsset:
    """One asset under a light of known kind, or with all of its light in the studio."""

    name: str
    light: str
    still: Still

    @property
    def is_final(self) -> bool:
        return self.light == STUDIO


def find_assets(folder: Path, only: Sequence[str]) -> list[Path]:
    """The glTF files in ``folder`` and its folders; of those of which ``only`` names the stems, if it names any."""
    files = [file for file in sorted(folder.rglob("*")) if file.suffix in SUFFIXES]
    return [file for file in files if not only or file.stem in only]


def lit_assets(file: Path, size: tuple[int, int]) -> Iterator[LitAsset]:
    """An asset without emission, seen by the automatic camera, under each light; one with glass in the studio."""
    scene = load_scene(file)
    camera = auto_camera(scene)
    if any(m.is_see_through for m in scene.materials):
        yield LitAsset(file.stem, STUDIO, Still(load_scene(file, lighting=STUDIO, ground=True), camera, size))
        return
    scene = replace(scene, environment=None, approximate_lights={}, approximated_materials=(), materials=tuple(
        replace(m, emission=(0.0, 0.0, 0.0), is_light_proxy=False) for m in scene.materials))
    for name in LIGHTS:
        lit = scene.with_lights(_light(name, camera))
        yield LitAsset(file.stem, name, Still(lit, camera, size))


def compare_assets(files: Sequence[Path], size: tuple[int, int], spp: int, out: Path,
                   progress: Callable[[str], object]) -> list[Row]:
    """PSNR of each asset under each light, on the pixels that show something; writes the pictures side by side.

    Each picture has the renderer's on the left, the path tracer's in the middle, and their difference. A row's
    ``noise`` is the least PSNR that the noise of the path tracer's pictures alone would give, from independent halves.

    Rows are written to ``TABLE`` in ``out`` as they are measured. One of the same size and paths that is there already
    is not measured again.
    """
    rows = _read_rows(out / TABLE)
    key = {"size": f"{size[0]}x{size[1]}", "spp": str(spp)}
    for number, file in enumerate(files):
        known = rows.get(file.stem, {})
        if known.get("error") or key.items() - known.items():
            progress(f"{number + 1} of {len(files)}: {file.stem}")
            rows[file.stem] = {"asset": file.stem, **key, **_compare(file, size, spp, out)}
            write_text(out / TABLE, to_csv(rows.values()))
    return [rows[file.stem] for file in files]


def mean_of(rows: Sequence[Row], column: str) -> float | None:
    """Mean over the assets that have a finite PSNR; None without any."""
    values = [v for row in rows if isinstance(v := row.get(column), float) and math.isfinite(v)]
    return float(np.mean(values)) if values else None


def _read_rows(path: Path) -> dict[str, Row]:
    """The rows of a table by their assets; none where there is no table yet."""
    if not path.exists():
        return {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return {row["asset"]: {name: float(text) if name in COLUMNS else text for name, text in row.items() if text}
                    for row in csv.DictReader(file)}
    except (OSError, KeyError, ValueError, csv.Error) as error:
        raise SettingsError("is not a table of assets", path, "expected one of this command, or none") from error


def _compare(file: Path, size: tuple[int, int], spp: int, out: Path) -> Row:
    """The row of one asset, or why it has none."""
    row: Row = {}
    try:
        for lit in lit_assets(file, size):
            drawn, depth = _draw(lit)
            first, second = _trace_halves(lit, spp)
            traced = np.asarray((first + second) / 2, np.float32)
            shown = (depth[..., 0] > 0) | (traced.max(axis=-1) > 0) | (drawn.max(axis=-1) > 0)
            row[lit.light] = psnr(drawn, traced, shown)
            noise = psnr(first, second, shown) + HALF_NOISE
            row["noise"] = min(noise, float(str(row.get("noise", math.inf))))
            a, b = (tone_map(picture, exposure_of(traced[shown])) for picture in (drawn, traced))
            difference = np.clip(DIFFERENCE * np.abs(a - b), 0, 1)
            write_shown(out / f"{file.stem}-{lit.light}.png", np.concatenate([a, b, difference], axis=1))
    except AfterglowError as error:
        row["error"] = str(error)
    return row


def _light(name: str, camera: Camera) -> Light:
    """A light that gives the target an irradiance of π."""
    eye, target = (np.asarray(v, np.float64) for v in (camera.eye, camera.target))
    distance = float(np.linalg.norm(target - eye))
    right, up, _ = look_rotation(target - eye, np.asarray(camera.up, np.float64))
    sideways, upwards = LIGHTS[name]
    position: F64 = eye + distance * (sideways * right + upwards * up)
    x, y, z = position.tolist()
    strength = math.pi * float(((target - position) ** 2).sum())
    if name == "point":
        return PointLight((x, y, z), (strength,) * 3)
    dx, dy, dz = (target - position).tolist()
    return SpotLight((x, y, z), (dx, dy, dz), (strength,) * 3, *SPOT_DEG)


def _draw(lit: LitAsset) -> tuple[F32, F32]:
    """The renderer's picture, and its depth, which is 0 where only glass is seen."""
    still, model = lit.still, find_model(DEFAULT_MODEL) if lit.is_final else None
    with Renderer(still.scene, Settings(still.size, outputs=("final", "depth")), model) as renderer:
        for _ in range(SETTLE_FRAMES - 1):
            renderer.advance(still.camera)
        images = renderer.render(still.camera)
        return images["final"], images["depth"]


def _trace_halves(lit: LitAsset, spp: int) -> tuple[F32, F32]:
    """Two independent pictures of half of the paths each."""
    tracer = PathTracer(lit.still.scene, max_bounces=MAX_BOUNCES if lit.is_final else 0)
    return _trace(lit, tracer, spp // 2, 0), _trace(lit, tracer, spp // 2, 1)


def _trace(lit: LitAsset, tracer: PathTracer, spp: int, seed: int) -> F32:
    """A picture by the path tracer; denoised where there are bounces."""
    means = TracedMeans(tracer, lit.still, jitter=True)
    means.add(spp, seed)
    layers = means.means()
    if not lit.is_final:
        return layers["final"]
    emitted = layers["emitted"]  # the denoiser would blur it, although it has hardly any noise
    return denoise(layers["final"] - emitted, layers["normal"], layers["albedo"]) + emitted
