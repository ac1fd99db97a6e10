"""The validation list: enough views, none of them in a dataset, of the scenes that it was made with."""

from __future__ import annotations

import importlib.util
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
from export.validation.views import VALIDATION, generated, views


def test_there_are_enough_views_of_enough_scenes() -> None:
    listed = read_list()["views"]
    count = Counter(view["scene"] for view in listed)
    assert len(listed) >= 48 and len(count) >= 8
    assert len({view["name"] for view in listed}) == len(listed)
    lightings = Counter(view["lighting"] for view in listed if "lighting" in view)
    assert {"sun", "lamp", "emissive", "spot"} <= set(lightings)


def test_generated_scenes_are_those_of_the_list() -> None:
    keys = {(view["source"], view["seed"]): view["key"] for view in read_list()["views"] if "seed" in view}
    assert {source for source, _ in keys} == {"room", "courtyard", "blocks-day"}
    for (source, seed), key in keys.items():
        assert scene_key(generated(source, seed).scene) == key
    assert VALIDATION != TRAINING


def test_views_share_a_scene_for_each_lighting(scenes: Path) -> None:
    listed = views(scenes)
    assert [view.name for view in listed] == [view["name"] for view in read_list()["views"]]
    cornell = [view for view in listed if view.scene == "cornell-box"]
    assert len({id(view.still.scene) for view in cornell}) == len({view.still.scene.lighting for view in cornell}) == 2
    box = load_scene(scenes / "cornell-box" / "CornellBox-Original.obj")
    assert all(np.array_equal(view.still.scene.bounds, box.bounds) for view in cornell)
    assert all(view.still.size == (256, 192) for view in listed)


def test_a_missing_scene_file_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no such scene file"):
        views(tmp_path)
