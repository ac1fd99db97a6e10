"""Path-traced references of scene files."""

from pathlib import Path

from app.api.checked import check_count, check_path, check_size
from app.arrays import F32
from app.errors import SettingsError, did_you_mean
from app.evaluation.reference import TraceRequest, make_reference
from app.load import load_scene
from app.paths import data_dir
from app.settings import Settings


def path_trace(path: str | Path | None = None, size: tuple[int, int] = (1024, 768), *, camera: str | None = None,
               lighting: str | None = None, spp: int = 256) -> dict[str, F32]:
    """Path-trace a scene file, or get the result from the cache if the same was asked for before.

    Parameters
    ----------
    path : str or Path, optional
        The scene file; default is the embedded Cornell box.
    size : tuple of int
        Width and height in pixels.
    camera, lighting : str, optional
        Names in the scene.
    spp : int
        Samples per pixel; the result is denoised.

    Returns
    -------
    dict of str to ndarray, float32, shape (H, W, C)
        ``final``, ``direct``, ``indirect``, ``albedo`` and ``depth``, as a frame has them.

    Raises
    ------
    AfterglowError
        When the extra ``export`` is not installed, or the path tracer fails.
    """
    size, spp = Settings(check_size(size)).size, check_count(spp, "spp", 1)
    file = data_dir() / "cornell-box.obj" if path is None else check_path(path, "scene")
    scene = load_scene(file, lighting=lighting)
    name = camera or scene.default_camera
    if name not in scene.cameras:
        raise SettingsError(f"no camera {name!r}", "camera", did_you_mean(name, scene.cameras))
    request = TraceRequest(file, lighting, camera, size)
    return make_reference(request, scene, scene.cameras[name].at(0.0), spp).layers
