"""One model's picture of the newest state, by a renderer that is kept as long as it will do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import ModelError
from app.evaluation.configurations import expand
from app.frame import AOVS
from app.io.preview import preview
from app.network.contract import Model
from app.renderer import Renderer
from app.settings import Settings
from app.view.edited_scene import EditedScene
from app.view.scene_file import bounces_of
from app.view.state import FINAL, State

NEWEST = 60  # frames whose median time is told


class ModelRenderer:
    """A renderer, changed where it can be and made anew where it can't.

    Parameters
    ----------
    folder : Path
        Where copies of networks with another scale are written.
    """

    def __init__(self, stage: EditedScene, provider: str, folder: Path) -> None:
        self._edited, self._provider, self._folder = stage, provider, folder
        self._renderer: Renderer | None = None
        self._made_for: object = None

    def draw(self, state: State, model: str, wanted: Callable[[], bool]) -> bool:
        """Draw a frame, or give it up where it is no longer ``wanted``; whether it was drawn.

        Raises
        ------
        AfterglowError
            When scene, model and device don't fit together.
        """
        scene = self._edited.scene(state)
        needs = (model, state.scale, state.precision, state.size, state.aov, state.taa, self._edited.movable)
        if self._renderer is None or needs != self._made_for or not self._renderer.relight(scene.lights):
            self.close()
            settings = Settings(state.size, (state.aov,), taa=state.taa, bounces=bounces_of(state, model),
                                provider=self._provider, timing=True)
            self._renderer = Renderer(scene, settings, _files(state, model, self._folder))
            self._made_for = needs
        self._renderer.expose(state.exposure)
        return self._renderer.advance(state.camera, self._edited.time, wanted)

    def shown(self, state: State) -> NDArray[np.uint8]:
        """What the page sees of the newest frame, one of ``state``; [H, W, 3], or 4 of which the last says nothing."""
        assert self._renderer is not None
        if state.aov == FINAL:
            return self._renderer.read("display")
        return preview(state.aov, self._renderer.read(state.aov), state.exposure)

    def radiance(self) -> NDArray[np.float32]:
        """The finished picture of the newest frame, linear, [H, W, 3]."""
        assert self._renderer is not None
        return self._renderer.read(FINAL)

    def report(self) -> dict[str, Any]:
        """Median milliseconds of each pass over the newest frames, what was culled and why, and the device."""
        if self._renderer is None:
            return {}
        times = self._renderer.timing(NEWEST)
        return {
            "passes": {name: p["cpu_ms"]["median"] for name, p in times["passes"].items()},
            "frame_ms": times["frame"]["cpu_ms"].get("median", 0.0), "culled": dict(self._renderer.plan.culled),
            "missing": list(self._renderer.missing), "device": self._renderer.device,
        }

    def close(self) -> None:
        """Give the renderer back."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = self._made_for = None


def _files(state: State, model: str, folder: Path) -> list[Model]:
    """What ``Renderer`` takes for a model in the state's scale and precision, and for what shades the environment."""
    scales = (state.scale,) if state.scale else ()
    found, absent = expand((model,), (state.size,), scales, (state.precision,) if state.precision else (), folder)
    if not found:
        raise ModelError("; ".join(absent), "precision", "expected one that the model has")
    if state.environment:
        found += expand((state.environment,), (state.size,), scales, (), folder)[0]
    return [configuration.file for configuration in found if configuration.file is not None]


def shown_outputs() -> tuple[str, ...]:
    """What of a frame can be shown, the finished picture first."""
    return (FINAL, *(name for name in AOVS if name != FINAL))
