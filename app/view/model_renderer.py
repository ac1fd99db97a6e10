"""One model's image of the latest state, from a renderer that is reused until a setting requires a new one."""

from collections.abc import Callable
from typing import Any

from app.arrays import F32, Bytes
from app.errors import ModelError
from app.evaluation.configurations import expand
from app.frame import AOVS
from app.io.aov_preview import preview
from app.network.selection import Model
from app.renderer import Renderer
from app.settings import Settings
from app.view.edited_scene import EditedScene
from app.view.scene_file import bounces_for
from app.view.state import FINAL, State

MAX_TIMED_FRAMES = 60  # latest frames whose median times are reported
VIEWABLE_OUTPUTS = (FINAL, *(name for name in AOVS if name != FINAL))


class ModelRenderer:
    """Updates its renderer where possible and replaces it otherwise."""

    def __init__(self, edited_scene: EditedScene, provider: str) -> None:
        self._edited_scene, self._provider = edited_scene, provider
        self._renderer: Renderer | None = None
        self._renderer_key: object = None

    def draw(self, state: State, model: str, should_continue: Callable[[], bool], render_scale: float = 1.0) -> bool:
        """Draw a frame, or abandon it as soon as ``should_continue`` returns False; return whether it was drawn.

        Only final images with temporal anti-aliasing are drawn at a ``render_scale`` below 1.

        Raises
        ------
        AfterglowError
            When scene, model and device don't fit together.
        """
        scene = self._edited_scene.apply(state)
        key = (model, state.scale, state.precision, state.size, state.aov, state.taa, state.reflections,
               state.tonemap, state.auto_exposure, self._edited_scene.moved_objects)
        if self._renderer is None or key != self._renderer_key or not self._renderer.relight(scene.lights):
            self.close()
            settings = Settings(state.size, (state.aov,), taa=state.taa, reflections=state.reflections,
                                tonemap=state.tonemap, auto_exposure=state.auto_exposure,
                                bounces=bounces_for(state, model), scale=state.scale or None,
                                provider=self._provider, timing=True)
            self._renderer = Renderer(scene, settings, _model_files(state, model))
            self._renderer_key = key
        self._renderer.set_exposure(state.exposure)
        self._renderer.set_render_scale(render_scale if state.taa and state.aov == FINAL else 1.0)
        return self._renderer.advance(state.camera, state.time + self._edited_scene.time, should_continue)

    def read_display(self, state: State) -> Bytes:
        """Return the last frame, drawn of ``state``, as displayed; shape (H, W, 3), or (H, W, 4) with unused alpha."""
        assert self._renderer is not None
        if state.aov == FINAL:
            return self._renderer.read("display")
        return preview(state.aov, self._renderer.read(state.aov), state.exposure)

    def read_radiance(self) -> F32:
        """Return the final image of the last frame, linear radiance, shape (H, W, 3)."""
        assert self._renderer is not None
        return self._renderer.read(FINAL)

    def collect_stats(self) -> dict[str, Any]:
        """Return median pass times in ms over the latest frames, culled passes with reasons, and the device."""
        if self._renderer is None:
            return {}
        times = self._renderer.timing(MAX_TIMED_FRAMES)
        return {
            "passes": {name: p["cpu_ms"]["median"] for name, p in times["passes"].items()},
            "frame_ms": times["frame"]["cpu_ms"].get("median", 0.0), "culled": dict(self._renderer.plan.culled),
            "missing": list(self._renderer.missing), "device": self._renderer.device,
        }

    def close(self) -> None:
        """Release the renderer."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = self._renderer_key = None


def _model_files(state: State, model: str) -> list[Model]:
    """Resolve ``model`` in the state's precision, and the model that shades the environment."""
    configurations, absent = expand((model,), (state.size,), (), (state.precision,) if state.precision else ())
    if not configurations:
        raise ModelError("; ".join(absent), "precision", "expected one that the model has")
    if state.environment:
        configurations += expand((state.environment,), (state.size,))[0]
    return [configuration.file for configuration in configurations if configuration.file is not None]
