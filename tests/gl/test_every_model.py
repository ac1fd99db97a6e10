"""Every model on real scenes, alone and beside one that shades an environment: sane pictures that differ."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, cycle
from pathlib import Path

import numpy as np
import pytest

from app.load import load_scene
from app.network.contract_json import read_contract
from app.network.selection import HALF_SUFFIX, SSGI, UNSHADOWED, Model, bundled_models, shades_environment
from app.scene import Environment, Scene
from tests.coarse_shadows import coarse_shadow_maps
from tests.gl.scenes import Images, draw
from tests.gl.test_scenes import NAMES

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (96, 72)
NETWORKS = bundled_models()
SHADING: dict[str, Model] = {UNSHADOWED: UNSHADOWED} | {n: m for n, m in NETWORKS.items() if shades_environment(m)}
INDIRECT: dict[str, Model] = {SSGI: SSGI} | {n: m for n, m in NETWORKS.items() if n not in SHADING}
SKY = Environment(np.linspace([0.3, 0.5, 1.0], [0.4, 0.35, 0.3], 16, dtype=np.float32)[:, None])
OF_EACH_KIND = ("cornell-box", "sponza", "stanford", "gltf-cases")  # scenes; the others are drawn by test_scenes.py
MIN_LIGHT = 0.005    # mean of a picture that is not black
MIN_GAIN = 1.01      # of the picture's mean by any light that is added; objects in the open get little
MIN_CHANGE = 0.005  # of the mean; networks that clean the same rays differ by 0.009


@dataclass(frozen=True, eq=False)
class Stage:
    """One scene, loaded once, and its picture without a model."""

    scene: Scene
    bare: Images


@pytest.fixture(scope="module", params=[n if n in OF_EACH_KIND else pytest.param(n, marks=pytest.mark.long)
                                        for n in NAMES])
def stage(request: pytest.FixtureRequest, egl: None, scenes: Path) -> Stage:
    entries = json.loads((scenes / "scenes.json").read_text())
    scene = load_scene(scenes / next(e["file"] for e in entries if e["name"] == request.param))
    return Stage(scene, drawn(scene, ()))


def drawn(scene: Scene, models: Sequence[Model]) -> Images:
    """A frame that is finite, nowhere negative and not black."""
    with coarse_shadow_maps():
        images = draw(scene, SIZE, ("final", "direct", "indirect"), model=models)  # type: ignore[arg-type]
    for name, image in images.items():
        assert np.isfinite(image).all() and image.min() >= 0, (models, name)
    assert images["final"].mean() > MIN_LIGHT, models
    return images


def single(models: dict[str, Model]) -> dict[str, Model]:
    return {name: model for name, model in models.items() if not name.endswith(HALF_SUFFIX)}


def all_differ(found: dict[str, Images]) -> None:
    for (a, first), (b, second) in combinations(found.items(), 2):
        change = np.abs(first["indirect"] - second["indirect"]).mean()
        assert change > MIN_CHANGE * max(first["indirect"].mean(), second["indirect"].mean()), (a, b)


def test_each_model_gives_a_scene_indirect_light_of_its_own(stage: Stage) -> None:
    assert not stage.bare["indirect"].any()
    found = {name: drawn(stage.scene, (model,)) for name, model in single(INDIRECT).items()}
    for name, images in found.items():
        assert images["final"].mean() > MIN_GAIN * stage.bare["final"].mean(), name
        np.testing.assert_array_equal(images["direct"], stage.bare["direct"])
    all_differ(found)


@pytest.mark.parametrize("stage", OF_EACH_KIND, indirect=True)
def test_two_models_share_a_scene_with_an_environment(stage: Stage, small_ember: Path) -> None:
    """Each model for indirect light beside one that shades; ``ember`` with few surfels, since it was drawn in full."""
    scene = replace(stage.scene, environment=SKY)
    shading = cycle(single(SHADING).values())
    found = {name: drawn(scene, (small_ember if name == "ember" else model, next(shading)))
             for name, model in single(INDIRECT).items()}
    for name, images in found.items():
        assert images["direct"].mean() > MIN_GAIN * stage.bare["direct"].mean(), name
    all_differ(found)


@pytest.mark.parametrize("name", [n for n in NETWORKS if n.endswith(HALF_SUFFIX)])
def test_half_precision_shows_what_single_precision_does(name: str, scenes: Path) -> None:
    scene = replace(load_scene(scenes / "cornell-box" / "CornellBox-Original.obj"), environment=SKY)
    output = "direct" if shades_environment(NETWORKS[name]) else "indirect"
    half, whole = (drawn(scene, (NETWORKS[n],))[output] for n in (name, name.removesuffix(HALF_SUFFIX)))
    assert read_contract(NETWORKS[name]).dtype == "float16"
    np.testing.assert_allclose(half.mean(), whole.mean(), rtol=0.05)
