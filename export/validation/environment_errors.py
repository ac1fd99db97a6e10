"""Judges what shades an environment: the light that comes straight from it, against the path tracer's."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.evaluation import metrics
from app.evaluation.denoise import denoise, denoiser_version
from app.io.image import read_exr, write_exr
from app.network.contract import Model, find_model
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.key import scene_key
from export.dataset.scenes.environments import under_sky
from export.reference import environment_tracer
from export.reference.environment_tracer import EnvironmentTracer, mean_shaded
from export.reference.still import Still
from export.validation.views import View, views

F32 = NDArray[np.float32]

OPEN = ("sponza", "breakfast-room", "stanford", "cornell-box", "courtyard-2", "blocks-day-0")  # that a sky shines into
EVERY = 2      # view of theirs
SEED = 2       # first number of every seed: neither the dataset's nor that of the validation list
ALL = "mean"   # of all views, in place of a scene's name
NONE = "none"  # no light of the environment at all
LIT = 0.2      # least share of the surfaces that get a hundredth of what comes from everywhere
MADE_BY = [Path(environment_tracer.__file__).with_name(name) for name in ("environment_tracer.py", "path_tracer.py", "mitsuba_scene.py")]
METRICS: dict[str, Callable[..., float]] = {"psnr": metrics.psnr, "ssim": metrics.ssim, "flip": metrics.flip}


@dataclass(frozen=True, eq=False)
class EnvironmentReference:
    """Light straight from the environment, through pixels' centres.

    Attributes
    ----------
    final : ndarray, float32, shape (H, W, 3)
        albedo × diffuse light + highlights by Fresnel's law, W/(sr m²).
    diffuse, specular : ndarray, float32, shape (H, W, 3)
        Demodulated; see ``EnvironmentSamples``.
    seen : ndarray of bool, shape (H, W)
        False: nothing but the sky.
    """

    final: F32
    diffuse: F32
    specular: F32
    seen: NDArray[np.bool_]


def environment_views(scenes: Path) -> list[View]:
    """Every other validation view of scenes that are open, each under a random environment of its own."""
    found = []
    for number, view in enumerate(views(scenes, OPEN)[::EVERY]):
        rng = np.random.default_rng([SEED, number])
        found.append(replace(view, still=replace(view.still, scene=under_sky(rng, view.still.scene))))
    return found


def environment_reference(still: Still, spp: int, folder: Path) -> EnvironmentReference:
    """Traced and denoised, kept in ``folder``."""
    made_by = hashlib.sha256(b"".join(file.read_bytes() for file in MADE_BY)).hexdigest()
    key = scene_key(still.scene, still.camera, still.size, still.time, spp, denoiser_version(), made_by)
    path = folder / f"{key}.exr"
    names = ("diffuse", "specular", "highlight", "albedo")
    if not path.exists():
        w, h = still.size
        x, y = np.meshgrid((np.arange(w) + 0.5) / w, (np.arange(h) + 0.5) / h)
        means = mean_shaded(EnvironmentTracer(still.scene, still.time), still, np.stack([x.ravel(), y.ravel()], axis=1), spp, 0)
        layers = {name: getattr(means, name).reshape(h, w, 3) for name in names}
        layers |= {name: denoise(layers[name], means.normal.reshape(h, w, 3)) for name in names[:3]}
        layers["depth"] = means.depth.reshape(h, w, 1)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_exr(path, layers)
    layers = read_exr(path)
    final = layers["albedo"] * layers["diffuse"] + layers["highlight"]
    return EnvironmentReference(final, layers["diffuse"], layers["specular"], layers["depth"][..., 0] > 0)


def is_lit(reference: EnvironmentReference, still: Still) -> bool:
    """Whether enough of the view gets light from the sky for its shading to be judged."""
    assert still.scene.environment is not None
    everywhere = float(still.scene.environment.radiance.mean())
    lit = reference.diffuse.max(axis=-1)[reference.seen] > 0.01 * everywhere
    return bool(reference.seen.any() and lit.mean() >= LIT)


def judge(found: Sequence[View], models: Sequence[str], spp: int, folder: Path,
          progress: Callable[[str], object]) -> list[dict[str, Any]]:
    """Errors of the final picture where surfaces are, one row for each model and lit view."""
    rows: list[dict[str, Any]] = []
    for number, view in enumerate(found):
        progress(f"{number + 1} of {len(found)}: {view.name}")
        reference = environment_reference(view.still, spp, folder)
        if not is_lit(reference, view.still):
            continue
        for name in models:
            made = drawn(view.still, None if name == NONE else find_model(name))
            errors = {metric: f(made, reference.final, reference.seen) for metric, f in METRICS.items()}
            rows.append({"view": view.name, "scene": view.scene, "model": Path(name).stem, **errors})
    return rows


def drawn(still: Still, model: Model | None) -> F32:
    """Light straight from the environment as the renderer has it, one frame through pixels' centres."""
    settings = Settings(still.size, ("direct", "specular"), taa=False, provider="cpu")
    with Renderer(still.scene, settings, model) as renderer:
        images = renderer.render(still.camera, still.time)
    return np.asarray(images["direct"] + images["specular"])


def by_scene(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over the views of each scene, and over all (scene ``mean``)."""
    found = []
    for scene in (*dict.fromkeys(row["scene"] for row in rows), ALL):
        for model in dict.fromkeys(row["model"] for row in rows):
            part = [row for row in rows if row["model"] == model and scene in (row["scene"], ALL)]
            found.append({"scene": scene, "views": len(part), "model": model,
                          **{name: float(np.mean([row[name] for row in part])) for name in METRICS}})
    return found
