"""Tone maps agree with their published curves, and exposure follows the picture slowly."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from app.errors import SettingsError
from app.golden import scenes
from app.io.image import srgb_encode, to_8bit
from app.io.tone_maps import automatic_exposure, tone_map
from app.passes.auto_exposure import ADAPTATION
from app.renderer import Renderer
from app.scene import Scene
from app.settings import TONE_MAPS, Settings

pytestmark = pytest.mark.gl
SIZE = (64, 48)
MAX_MEAN_ERROR = 0.01  # of 255 levels: a few values are rounded to the other side
OCIO = "sRGB - Display/ACES 2.0 - SDR 100 nits (Rec.709)"
rng = np.random.default_rng(0)
RADIANCE = np.concatenate([
    2.0 ** rng.uniform(-14, 7, (40, 64, 1)) * rng.uniform(0, 1, (40, 64, 3)),  # all colours and 21 stops
    np.repeat(2.0 ** np.linspace(-14, 7, 64)[None, :, None], 3, axis=2).repeat(7, axis=0),  # greys
    np.zeros((1, 64, 3))]).astype(np.float16).astype(np.float32)


def shown(tonemap: str, radiance: np.ndarray = RADIANCE, exposure: float = 1.0, auto_exposure: bool = False
          ) -> np.ndarray:
    """What the pass makes of given radiance."""
    settings = Settings(SIZE, taa=False, tonemap=tonemap, exposure=exposure, auto_exposure=auto_exposure)
    with Renderer(scenes.spotlights(), settings) as renderer:
        renderer.after_pass.append(lambda bound, pool: bound.name == "composite" and pool.write("lit", np.concatenate(
            [radiance, np.ones((*SIZE[::-1], 1))], axis=2)))
        return renderer.render(scenes.spotlights().cameras["main"].at(0.0))["display"]


def pbr_neutral(c: np.ndarray) -> np.ndarray:
    """The code of the specification, texel by texel."""
    out = np.empty_like(c)
    start, desaturation = 0.8 - 0.04, 0.15
    for index in np.ndindex(c.shape[:2]):
        x = min(c[index])
        value = c[index] - (x - 6.25 * x * x if x < 0.08 else 0.04)
        peak = max(value)
        if peak >= start:
            d = 1.0 - start
            new_peak = 1.0 - d * d / (peak + d - start)
            g = 1.0 - 1.0 / (desaturation * (peak - new_peak) + 1.0)
            value = value * new_peak / peak * (1 - g) + new_peak * g
        out[index] = value
    return srgb_encode(out)


@pytest.mark.parametrize("name", [*TONE_MAPS, OCIO])
def test_the_processor_shows_the_same(name: str) -> None:
    assert np.abs(shown(name).astype(int) - tone_map(RADIANCE, 1.0, name)).max() <= 1


def agx(c: np.ndarray) -> np.ndarray:
    """Sobotka's equations for the curve, between Wrensch's inset and its numerical inverse."""
    inset = np.array([[0.842479062253094, 0.0784335999999992, 0.0792237451477643],
                      [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
                      [0.0423756549057051, 0.0784336, 0.879142973793104]])
    x_pivot, y_pivot, slope = 10.0 / 16.5, 0.5, 2.0

    def scale(x: float, y: float, power: float) -> float:
        return ((slope * x) ** -power * ((slope * x / y) ** power - 1.0)) ** (-1.0 / power)

    x = (np.log2(np.maximum(c @ inset.T, 1e-10)) - np.log2(0.18) + 10.0) / 16.5
    x = np.clip(x, 0.0, 1.0)
    toe = x < x_pivot
    s = np.where(toe, -scale(x_pivot, y_pivot, 3.0), scale(1 - x_pivot, 1 - y_pivot, 3.25))
    power = np.where(toe, 3.0, 3.25)
    term = slope * (x - x_pivot) / s
    curve = s * term / (1 + term ** power) ** (1 / power) + y_pivot
    return np.clip(curve @ np.linalg.inv(inset).T, 0.0, 1.0)


def aces(c: np.ndarray) -> np.ndarray:
    v = c @ np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]).T
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    return srgb_encode(v @ np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605],
                                     [-0.00327, -0.07276, 1.07602]]).T)


@pytest.mark.parametrize(("name", "curve"), [("srgb", srgb_encode), ("agx", agx), ("pbr-neutral", pbr_neutral),
                                             ("aces", aces)])
@pytest.mark.parametrize("exposure", [1.0, 2.5])
def test_curves_are_the_published_ones(name: str, curve: object, exposure: float) -> None:
    expected = to_8bit(curve(RADIANCE.astype(np.float64) * exposure))
    errors = np.abs(shown(name, exposure=exposure).astype(int) - expected)
    assert errors.max() <= 1
    assert errors.mean() < MAX_MEAN_ERROR


def test_agx_is_near_its_published_polynomial() -> None:
    """Wrensch's polynomial of the curve, an independent source."""
    grey = 2.0 ** np.linspace(-12.4, 4.0, 100)[:, None, None] * np.ones((1, 1, 3))
    x = (np.log2(grey[:, 0, 0]) + 12.47393) / (4.026069 + 12.47393)
    polynomial = np.polyval([15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232], x)
    assert np.abs(agx(grey)[:, 0, 0] - polynomial).max() < 0.012


def test_views_of_opencolorio_are_its_own() -> None:
    linear = oiio.ImageBuf(np.ascontiguousarray(RADIANCE * np.float32(2)))
    expected = oiio.ImageBufAlgo.ociodisplay(linear, *OCIO.split("/"), fromspace="lin_rec709_scene").get_pixels()
    assert np.abs(shown(OCIO, exposure=2.0).astype(int) - to_8bit(expected)).max() <= 1
    assert np.abs(shown(OCIO).astype(int) - shown("srgb")).max() > 20


def test_an_unknown_tone_map_is_refused() -> None:
    with pytest.raises(SettingsError, match="tonemap: unknown tone map or view 'agxx'"):
        shown("agxx")


@pytest.mark.parametrize("dim", [1.0, 3e-3])  # times the light of most columns, beside which the others are lamps
def test_automatic_exposure_brings_what_is_lit_to_middle_grey(dim: float) -> None:
    columns = 2.0 ** rng.uniform(-6, 4, (1, 64, 1)) * rng.uniform(0.1, 1, (1, 64, 3)) * (0.2, 0.3, 1.0)  # bluish
    columns[:, ::8] = 0.0
    columns[:, np.arange(64) % 8 > 2] *= dim
    radiance = columns.repeat(48, axis=0).astype(np.float16).astype(np.float32)
    expected = tone_map(radiance, automatic_exposure(radiance), "srgb")
    assert np.abs(shown("srgb", radiance, auto_exposure=True).astype(int) - expected).max() <= 1


def brightness(scene: Scene, factor: float, frames: int, renderer: Renderer) -> float:
    camera = scene.cameras[scene.default_camera].at(0.0)
    renderer.relight(tuple(scene.with_radiance_scale(factor).lights))
    for _ in range(frames - 1):
        renderer.advance(camera)
    return float(renderer.render(camera)["display"].mean())


def test_exposure_follows_the_light_slowly() -> None:
    scene = scenes.spotlights()
    with Renderer(scene, Settings(SIZE, taa=False, auto_exposure=True)) as renderer:
        first = brightness(scene, 1.0, 1, renderer)
        steady = [brightness(scene, 1.0, 1, renderer) for _ in range(3)]
        at_once, later = brightness(scene, 0.25, 1, renderer), brightness(scene, 0.25, 150, renderer)
    assert steady == [first] * 3
    assert at_once < 0.75 * first
    assert later == pytest.approx(first, rel=0.02)
    assert 0.05 < ADAPTATION < 0.1


def test_automatic_exposure_does_not_depend_on_the_scale_of_radiance() -> None:
    pictures = []
    for scale in (1.0, 1e6):
        scene = scenes.spotlights().with_radiance_scale(scale)
        with Renderer(scene, Settings(SIZE, taa=False, auto_exposure=True)) as renderer:
            pictures.append(renderer.render(scene.cameras["main"].at(0.0))["display"].astype(int))
    assert np.abs(pictures[0] - pictures[1]).max() <= 2


def test_views_take_the_automatic_exposure() -> None:
    scene = scenes.spotlights()
    with Renderer(scene, Settings(SIZE, taa=False, auto_exposure=True, tonemap="sRGB - Display/Un-tone-mapped")) as r:
        through_ocio = r.render(scene.cameras["main"].at(0.0))["display"].astype(int)
    with Renderer(scene, Settings(SIZE, taa=False, auto_exposure=True)) as r:
        assert np.abs(through_ocio - r.render(scene.cameras["main"].at(0.0))["display"]).max() <= 1
