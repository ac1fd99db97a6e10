"""The validation list: enough views, none of them in a dataset, of the scenes that it was made with."""

from __future__ import annotations

import importlib.util
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

if importlib.util.find_spec("mitsuba") is None:
    pytest.skip("the extra 'export' is not installed", allow_module_level=True)

from app.errors import SceneError
from app.load import load_scene
from export.dataset.held_out import read_list
from export.dataset.plan import TRAINING
from export.dataset.scene_key import scene_key
from export.validation.scenes.sources import EMISSIVE_SOURCES
from export.validation.views import VALIDATION, generated, views


def test_there_are_enough_views_of_enough_scenes() -> None:
    listed = read_list()["views"]
    count = Counter(view["scene"] for view in listed)
    assert len(listed) >= 48 and len(count) >= 8
    assert len({view["name"] for view in listed}) == len(listed)
    lightings = Counter(view["lighting"] for view in listed if "lighting" in view)
    assert {"sun", "lamp", "emissive", "spot"} <= set(lightings)


def test_generated_scenes_are_those_of_the_list() -> None:
    scenes = {view["scene"]: view for view in read_list()["views"] if "seed" in view}
    assert {view["source"] for view in scenes.values()} == {"room", "courtyard", "blocks-day", *EMISSIVE_SOURCES}
    for view in scenes.values():
        assert scene_key(generated(view["source"], view["seed"], view.get("arguments")).scene) == view["key"]
    assert VALIDATION != TRAINING


def test_views_share_a_scene_for_each_lighting(scenes: Path) -> None:
    listed = views(scenes)
    assert [view.name for view in listed] == [view["name"] for view in read_list()["views"]]
    generated_emissive = {view["scene"] for view in read_list()["views"] if view.get("source") in EMISSIVE_SOURCES}
    cornell = [view for view in listed if view.scene == "cornell-box"]
    assert len({id(view.still.scene) for view in cornell}) == len({view.still.scene.lighting for view in cornell}) == 2
    box = load_scene(scenes / "cornell-box" / "CornellBox-Original.obj")
    assert all(np.array_equal(view.still.scene.bounds, box.bounds) for view in cornell)
    assert {(view.still.size, view.still.scene.lighting == "emissive" or view.scene in generated_emissive)
            for view in listed} == {((256, 192), False), ((384, 288), True)}


def test_views_are_chosen_by_scene_and_lighting(scenes: Path) -> None:
    boxes = views(scenes, ["cornell-box", "chandelier-0"], ["emissive"])
    assert Counter(view.scene for view in boxes) == {"cornell-box": 3, "chandelier-0": 3}
    assert views(scenes, ["cornell-box"], ["sun"]) == []


def test_every_emissive_lighting_and_source_has_three_cameras() -> None:
    listed = [view for view in read_list()["views"] if view.get("lighting") == "emissive"]
    cameras = {scene: {json.dumps(view["camera"]) for view in listed if view["scene"] == scene}
               for scene in {view["scene"] for view in listed}}
    assert {"country-kitchen", "contemporary-bathroom", "cornell-box", "stanford"} <= set(cameras)
    assert all(len(different) >= 3 for different in cameras.values())
    assert all("arguments" in view and "seed" in view for view in listed if view["scene"] not in read_list()["files"])


def test_strong_emitters_of_generated_scenes_are_analytic_lights(scenes: Path) -> None:
    for view in {view.scene: view for view in views(scenes, lightings=["emissive"])}.values():
        assert view.still.scene.lights and any(m.emits for m in view.still.scene.materials)


def test_a_missing_scene_file_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no such scene file"):
        views(tmp_path)
