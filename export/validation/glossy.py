"""Views of glossy surfaces: the renderer's final picture, with and without reflections, against the full material.

The views are generated rooms, scene files with mirrors, steel and polished floors, and metal assets under environments.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from app.arrays import F32
from app.evaluation.denoise import denoiser_version
from app.evaluation.metrics import METRICS, exposure_of, psnr
from app.evaluation.reference import cache_folder, cache_reference
from app.evaluation.versions import exporter_version
from app.gl.pool import Pool
from app.graph import BoundPass
from app.load import auto_camera, load_scene
from app.network.selection import Model
from app.renderer import Renderer
from app.scene import CameraPath, Scene
from app.settings import SETTLE_FRAMES, Settings
from export.dataset.scene_key import scene_key
from export.dataset.scenes.environments import random_environment
from export.reference.path_tracer import MAX_BOUNCES
from export.reference.still import Still
from export.reference.trace import write_reference
from export.validation.errors import Progress, Row
from export.validation.pictures import write_picture
from export.validation.scenes.glossy import GLOSSY_SOURCES, ROUGHNESSES, SPHERE_ROWS, spheres_seen
from export.validation.views import View

SIZE, ROW_SIZE = (256, 192), (384, 128)  # of the pictures; of those of rows of spheres
# File and lighting of each view of a scene file; it is seen by the file's default camera.
FILES = {"bathroom": ("contemporary-bathroom/contemporary-bathroom.glb", "lamp"),
         "bathroom-emissive": ("contemporary-bathroom/contemporary-bathroom.glb", "emissive"),
         "kitchen": ("country-kitchen/country-kitchen.glb", "lamp"),
         "kitchen-emissive": ("country-kitchen/country-kitchen.glb", "emissive")}
ASSETS = ("MetalRoughSpheresNoTextures", "CompareMetallic", "ToyCar", "LowPolyGlassTable", "PortalFrame")
SEED = 5  # first number of the seeds of the assets' environments
# The parts of reflections that each row of a view has: none, what the screen or the environment shows, all.
VARIANTS = ("none", "screen", "full")
ERRORS = (*METRICS, "mean")  # of a row: those of ``METRICS``, and the picture's mean over the reference's


@dataclass(frozen=True, eq=False)
class Skipped:
    """A view that can't be drawn here, and why."""

    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class GlossyReference:
    """The mean of two independent path-traced and denoised pictures, float32, shape (H, W, 3).

    Attributes
    ----------
    own_psnr : float
        Its noise in dB: that of the halves' difference, which has four times the mean's variance. The denoiser's bias
        is common to both and not in it.
    """

    final: F32
    own_psnr: float


def glossy_views(scenes: Path, assets: Path, only: Collection[str] = ()) -> Iterator[View | Skipped]:
    """All views, or those that ``only`` names, one at a time; of missing files, why they are skipped."""
    files = {name: (scenes / file, partial(load_scene, scenes / file, lighting=lighting))
             for name, (file, lighting) in FILES.items()}
    for number, name in enumerate(ASSETS):
        path = next(iter(sorted(assets.glob(f"{name}/**/{name}.gl*"))), assets / name)
        files[name] = path, partial(_under_environment, path, number)
    loaders: dict[str, Callable[[], Scene]] = {**GLOSSY_SOURCES, **{name: load for name, (_, load) in files.items()}}
    for name, load in loaders.items():
        if only and name not in only:
            continue
        if name in files and not files[name][0].is_file():
            yield Skipped(name, f"no file {files[name][0]}")
            continue
        scene = load()
        still = Still(scene, scene.cameras[scene.default_camera].at(0.0), ROW_SIZE if name in SPHERE_ROWS else SIZE)
        yield View(name, name, still)


def glossy_reference(view: View, spp: int, folder: Path | None) -> GlossyReference:
    """The reference of a view, of ``spp`` paths a pixel, cached in ``folder`` or in the benchmark's cache."""
    halves = [_half(view, spp // 2, seed, folder or cache_folder()) for seed in (0, 1)]
    final = np.asarray((halves[0] + halves[1]) / 2, np.float32)
    # Each half is as far from the mean as the mean is, in expectation, from what it estimates.
    return GlossyReference(final, psnr(halves[0], final))


def measure_view(view: View, reference: GlossyReference, models: Sequence[Model], provider: str,
                 out: Path) -> list[Row]:
    """Errors of each of ``VARIANTS``; writes all pictures side by side, the reference last."""
    rows, pictures = [], []
    for variant in VARIANTS:
        picture = _draw(view.still, models, provider, variant)
        row: Row = {"view": view.name, "variant": variant, "own": reference.own_psnr}
        row |= {name: metric.measure(picture, reference.final, None) for name, metric in METRICS.items()}
        rows.append({**row, "mean": float(picture.mean() / reference.final.mean()),
                     **_sphere_ratios(view, picture, reference.final)})
        pictures.append(picture)
    side_by_side = np.concatenate([*pictures, reference.final], axis=1)
    write_picture(out / f"{view.name}.png", side_by_side, exposure_of(reference.final))
    return rows


def means_of(rows: Sequence[Row]) -> list[Row]:
    """Means of ``ERRORS`` over the views, for each of ``VARIANTS``."""
    return [{"view": "mean", "variant": variant,
             **{name: float(np.mean([row[name] for row in rows if row["variant"] == variant])) for name in ERRORS}}
            for variant in VARIANTS if rows]


def ratio_name(roughness: float) -> str:
    """Key of a row: the mean radiance of the sphere of that roughness over that of the reference."""
    return f"ratio {roughness:g}"


def _half(view: View, spp: int, seed: int, folder: Path) -> F32:
    still = view.still
    key = scene_key(still.scene, still.camera, still.size, still.time, spp, seed, denoiser_version(),
                    exporter_version(still.scene))

    def trace(temporary: Path) -> None:
        write_reference(temporary, still, spp, seed, MAX_BOUNCES, {"view": view.name}, lambda share: None,
                        denoised=True, emission_is_direct=False)

    return cache_reference(folder / f"{view.name}-{key}", trace).layers["final"]


def _sphere_ratios(view: View, picture: F32, final: F32) -> dict[str, float]:
    if view.name not in SPHERE_ROWS:
        return {}
    return {ratio_name(roughness): float(picture[shown].mean() / final[shown].mean())
            for roughness, shown in zip(ROUGHNESSES, spheres_seen(view.still), strict=True)}


def _under_environment(path: Path, number: int) -> Scene:
    """An asset on a ground under an environment of its own, seen by the automatic camera."""
    scene = load_scene(path, studio=False, ground=True)
    camera = auto_camera(load_scene(path, studio=False))
    return replace(scene, environment=random_environment(np.random.default_rng([SEED, number])),
                   cameras={"main": CameraPath.still(camera)}, default_camera="main")


def _draw(still: Still, models: Sequence[Model], provider: str, variant: str) -> F32:
    settings = Settings(still.size, provider=provider, reflections=variant != "none")
    with Renderer(still.scene, settings, models) as renderer:
        if variant == "screen":
            renderer.after_pass.append(partial(_forget_surfaces, 2 * still.scene.longest_edge))
        for _ in range(SETTLE_FRAMES - 1):
            renderer.advance(still.camera)
        return renderer.render(still.camera)["final"]


def _forget_surfaces(farthest: float, bound: BoundPass, pool: Pool) -> None:
    """Drop what traced rays have met nearer than ``farthest``, so that only the environment is left."""
    if bound.name == "reflection_rays":
        traced = pool.read("reflection_traced")
        pool.write("reflection_traced", np.where(traced[..., 3:] > farthest, traced, 0))


def measure_errors(views: Iterator[View | Skipped], models: Sequence[Model], spp: int, references: Path | None,
                   provider: str, out: Path, progress: Progress) -> list[Row]:
    """Rows of all views that can be drawn; ``progress`` is told of the others.

    Raises
    ------
    AfterglowError
        When a model, the path tracer or the device is not available.
    """
    rows: list[Row] = []
    for view in views:
        if isinstance(view, Skipped):
            progress(f"{view.name} skipped: {view.reason}")
            continue
        progress(view.name)
        rows += measure_view(view, glossy_reference(view, spp, references), models, provider, out)
    return rows
