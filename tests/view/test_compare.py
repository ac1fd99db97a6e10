"""The comparison page: one file with the images, error maps and numbers of each model."""

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
from app.network.selection import UNSHADOWED
from app.paths import data_dir

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SIZE = (64, 48)


def read_images(page: str) -> dict[str, dict[str, np.ndarray]]:
    """Decode the images of a page by label and kind."""
    data = json.loads(re.search(r"const pictures = (\{.*\});", page)[1])
    (scene,) = data.values()
    return {label: {kind: np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))))
                    for kind, uri in kinds.items()} for label, kinds in scene.items()}


def compare(out: Path, *args: str) -> str:
    done = CliRunner().invoke(cli, ["compare", "--size", "64x48", "--out", str(out), *args])
    assert done.exit_code == 0, done.output
    return out.read_text("utf-8")


def test_without_a_reference_models_are_compared_with_the_last_one(tmp_path: Path) -> None:
    page = compare(tmp_path / "page.html", "--models", "none,ssgi")
    images = read_images(page)
    assert list(images) == ["none", "ssgi"]
    assert images["ssgi"]["picture"].shape == (48, 64, 3)
    assert images["ssgi"]["picture"].mean() > images["none"]["picture"].mean() + 2
    assert images["none"]["flip"].std() > 3 * images["ssgi"]["flip"].std()
    assert 'data-reference="ssgi"' in page and "against ssgi" in page
    assert not re.search(r"(src|href)=[\"']?(?!data:)\w", page)  # no external resources
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]


def test_two_models_render_together(tmp_path: Path) -> None:
    models = ["none", UNSHADOWED, f"gather+{UNSHADOWED}"]
    page = compare(tmp_path / "page.html", str(data_dir() / "patio.obj"), "--models", ",".join(models))
    images = read_images(page)
    assert list(images) == models
    none, direct, both = (kinds["picture"].astype(float) for kinds in images.values())
    assert direct.mean() > none.mean() + 20  # all of them show the sky itself
    assert both.mean() > direct.mean() + 2 and (both >= direct - 8).mean() > 0.98


def test_against_a_reference_every_layer_has_its_errors(tmp_path: Path) -> None:
    flat = {name: np.full((48, 64, 3), 0.5, np.float32) for name in ("", "direct", "indirect", "albedo")}
    (tmp_path / "reference").mkdir()
    write_exr(tmp_path / "reference" / "reference.exr", {**flat, "depth": np.ones((48, 64, 1), np.float32)})
    (tmp_path / "reference" / "reference.json").write_text('{"spp": 7, "notices": ["a notice"]}')
    page = compare(tmp_path / "page.html", "--models", "reference,none", "--reference", str(tmp_path / "reference"))
    assert list(read_images(page)) == ["none", "reference"]
    assert "reference of 7 samples per pixel; a notice" in page
    for layer in ("final", "direct", "indirect"):
        assert f"<th colspan=4>{layer}" in page


@pytest.mark.parametrize(("args", "expected"), [
    (["--models", "reference"], "nothing to compare"), (["--models", "ember"], "nothing to compare"),
    (["--models", "none,missing"], "missing"), (["--size", "8x8"], "at least 11"), (["--camera", "nobody"], "nobody"),
    (["--out", "."], "is a folder"), (["--models", "none,reference", "--reference", "nowhere"], "nowhere"),
])
def test_user_errors_are_one_line(args: list[str], expected: str, tmp_path: Path,
                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, ["compare", "--size", "64x48", *args])
    assert done.exit_code == 2
    line, = [x for x in done.stderr.splitlines() if x.startswith("error: ")]
    assert expected in line
    assert not list(tmp_path.glob("**/*.html"))
