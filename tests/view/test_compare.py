"""The comparison page: one file, with every picture, a map and the numbers of each model."""

from __future__ import annotations

import base64
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from app.cli import cli
from app.io.image import write_exr
from app.paths import data_dir

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SIZE = (64, 48)


def pictures_of(page: str) -> dict[str, dict[str, np.ndarray]]:
    """By label, decoded."""
    data = json.loads(re.search(r"const pictures = (\{.*\});", page)[1])
    (scene,) = data.values()
    return {label: {kind: np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))))
                    for kind, uri in kinds.items()} for label, kinds in scene.items()}


def compare(out: Path, *args: str) -> str:
    done = CliRunner().invoke(cli, ["compare", "--size", "64x48", "--out", str(out), *args])
    assert done.exit_code == 0, done.output
    return out.read_text("utf-8")


def test_without_a_reference_the_last_is_what_others_are_compared_with(tmp_path: Path) -> None:
    page = compare(tmp_path / "page.html", "--models", "none,ssgi")
    found = pictures_of(page)
    assert list(found) == ["none", "ssgi"]
    assert found["ssgi"]["picture"].shape == (48, 64, 3)
    assert found["ssgi"]["picture"].mean() > found["none"]["picture"].mean() + 2
    assert found["none"]["flip"].std() > 3 * found["ssgi"]["flip"].std()
    assert 'data-reference="ssgi"' in page and "against ssgi" in page
    assert not re.search(r"(src|href)=[\"']?(?!data:)\w", page)  # nothing from elsewhere
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]


def test_two_models_draw_together(tmp_path: Path) -> None:
    page = compare(tmp_path / "page.html", str(data_dir() / "patio.obj"), "--models", "none,coarse,gather+unshadowed_environment")
    found = pictures_of(page)
    assert list(found) == ["none", "unshadowed_environment", "gather+unshadowed_environment"]
    dark, straight, both = (images["picture"].astype(float) for images in found.values())
    assert straight.mean() > dark.mean() + 20  # the sky itself is in all of them
    assert both.mean() > straight.mean() + 2 and (both >= straight - 8).mean() > 0.98
    assert "under an environment the final picture alone" not in page, "without a reference nothing else is judged anyway"


def test_against_a_reference_every_layer_has_its_errors(tmp_path: Path) -> None:
    flat = {name: np.full((48, 64, 3), 0.5, np.float32) for name in ("", "direct", "indirect", "albedo")}
    (tmp_path / "reference").mkdir()
    write_exr(tmp_path / "reference" / "reference.exr", {**flat, "depth": np.ones((48, 64, 1), np.float32)})
    (tmp_path / "reference" / "reference.json").write_text('{"spp": 7, "notices": ["made up"]}')
    page = compare(tmp_path / "page.html", "--models", "reference,none", "--reference", str(tmp_path / "reference"))
    assert list(pictures_of(page)) == ["none", "reference"]
    assert "reference of 7 samples per pixel; made up" in page
    for layer in ("final", "direct", "indirect"):
        assert f"<th colspan=4>{layer}" in page


@pytest.mark.parametrize(("args", "said"), [
    (["--models", "reference"], "nothing to compare"), (["--models", "ember"], "nothing to compare"),
    (["--models", "none,missing"], "missing"), (["--size", "8x8"], "at least 11"), (["--camera", "nobody"], "nobody"),
    (["--out", "."], "is a folder"), (["--models", "none,reference", "--reference", "nowhere"], "nowhere"),
])
def test_user_errors_are_one_line(args: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, ["compare", "--size", "64x48", *args])
    assert done.exit_code == 2
    line, = [x for x in done.stderr.splitlines() if x.startswith("error: ")]
    assert said in line
    assert not list(tmp_path.glob("**/*.html"))
