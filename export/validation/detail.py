"""Detail at the size that people draw: errors of models on ``detail_views``, of what PSNR hides too."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from app.arrays import F32
from app.evaluation.configurations import Configuration
from app.evaluation.metrics import exposure_of, flip, psnr
from app.evaluation.reference import MIN_ALBEDO
from app.renderer import Renderer
from app.settings import SETTLE_FRAMES, Settings
from export.reference.still import Still
from export.validation.detail_metrics import DetailMetrics
from export.validation.detail_references import DetailReference, detail_reference
from export.validation.detail_views import KEPT_ASIDE
from export.validation.errors import Progress, Row, find_configurations
from export.validation.pictures import write_picture
from export.validation.views import View

# Keys of a row: of the diffuse picture, which is the reference's direct light plus reflected indirect light; then of
# indirect light alone, see ``DetailMetrics``.
ERRORS = {"psnr": ".2f", "flip": ".3f", "edge gradient": ".3f", "texel variation": ".3f"}
REFERENCE = "reference"  # in place of a model: its own halves against each other


def measure_errors(views: Iterable[View], models: Sequence[str], spp: int, references: Path | None, provider: str,
                   out: Path, progress: Progress) -> list[Row]:
    """Errors of every model on every view after a rest; writes each picture, and the reference.

    Parameters
    ----------
    models : sequence of str
        Texts for ``app.network.selection.find_models``.

    Raises
    ------
    AfterglowError
        When a model, the path tracer or the device is not available.
    """
    rows: list[Row] = []
    for view in views:
        progress(view.name)
        judge = _Judge(detail_reference(view, spp, references))
        about = {"view": view.name, "kept aside": view.name in KEPT_ASIDE}
        write_picture(out / f"{view.name}-{REFERENCE}.png", judge.picture, judge.exposure)
        rows.append({**about, "model": REFERENCE, "psnr": judge.own_psnr})
        for configuration in find_configurations(models, view.still.size):
            indirect = _settled(view.still, configuration, provider)
            write_picture(out / f"{view.name}-{configuration.label}.png", judge.lit_by(indirect), judge.exposure)
            rows.append({**about, "model": configuration.label, **judge.errors(indirect)})
    return rows


def means_of(rows: Sequence[Row]) -> list[Row]:
    """Means of ``ERRORS`` for each model, over the views for development and over those kept aside."""
    means = []
    for model in dict.fromkeys(row["model"] for row in rows):
        for kept, name in ((False, "mean, development"), (True, "mean, kept aside")):
            if chosen := [row for row in rows if row["model"] == model and row["kept aside"] == kept]:
                means.append({"view": name, "kept aside": kept, "model": model,
                              **{key: float(np.mean([row[key] for row in chosen])) for key in ERRORS
                                 if key in chosen[0]}})
    return means


class _Judge:
    """Compares indirect light / albedo, shape (H, W, 3), with a reference.

    Attributes
    ----------
    picture : ndarray, float32, shape (H, W, 3)
        The reference's diffuse picture, the mean of its halves.
    exposure : float
        Of all pictures.
    own_psnr : float
        Noise of ``picture`` in dB: each half is as far from the mean as the mean is, in expectation, from what it
        estimates. The denoiser's bias is common to both halves and not in it.
    """

    def __init__(self, reference: DetailReference) -> None:
        self._direct, self._albedo = reference.direct.mean(axis=0), reference.albedo.mean(axis=0)
        self.picture, half = self.lit_by(reference.indirect.mean(axis=0)), self.lit_by(reference.indirect[0])
        self.exposure, self.own_psnr = exposure_of(self.picture), psnr(half, self.picture)
        depth = reference.depth[0, ..., 0]
        counted = (depth > 0) & (self._albedo.max(axis=-1) >= MIN_ALBEDO)
        first, second = reference.indirect
        self._detail = DetailMetrics(first, second, reference.normal[0], depth, counted)

    def lit_by(self, indirect: F32) -> F32:
        """The diffuse picture, radiance."""
        return np.asarray(self._direct + self._albedo * indirect, np.float32)

    def errors(self, indirect: F32) -> dict[str, float]:
        """See ``ERRORS``."""
        picture = self.lit_by(indirect)
        return {"psnr": psnr(picture, self.picture), "flip": flip(picture, self.picture),
                "edge gradient": self._detail.edge_gradient(indirect),
                "texel variation": self._detail.texel_variation(indirect)}


def _settled(still: Still, configuration: Configuration, provider: str) -> F32:
    """Indirect light / albedo after a rest, through the pixels' centres, since only finished pictures are jittered."""
    settings = Settings(still.size, ("indirect",), provider=provider)
    with Renderer(still.scene, settings, configuration.models) as renderer:
        for _ in range(SETTLE_FRAMES - 1):
            renderer.advance(still.camera)
        return renderer.render(still.camera)["indirect"]
