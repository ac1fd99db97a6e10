"""The page of a failed check needs no other file, and shows what broke first on top."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

from app.golden import Finding, Report, page
from app.golden.comparison import Distance
from app.golden.page import difference_map, picture
from app.golden.tolerance import Tolerance

LIMITS = Tolerance(0.01, 0.001, 0.01)
GOLDEN = np.full((6, 8, 4), 0.25, np.float32)
CURRENT = GOLDEN + np.where(np.arange(8) < 4, 0.0, 0.5).astype(np.float32)[:, None]


def finding(case: str, stage: str, resource: str, verdict: str = "differs") -> Finding:
    if verdict == "same":
        return Finding(case, stage, resource, verdict, LIMITS)
    return Finding(case, stage, resource, verdict, LIMITS, Distance(0.4, 0.5), 3, GOLDEN, CURRENT)


def decoded(uri: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.removeprefix("data:image/png;base64,")))))


REPORT = Report([finding("a", "gbuffer", "normal", "same"), finding("a", "direct", "direct"),
                 finding("a", "taa", "taa"), finding("b", "gbuffer", "depth"), finding("b", "direct", "direct")],
                ["llvmpipe <1>"], {"b": "Voodoo 2"})


def test_the_first_broken_stages_come_first() -> None:
    titles = re.findall(r"<h2>(.*?)</h2>", page(REPORT))
    assert titles[:4] == ["direct · direct · a", "gbuffer · depth · b", "taa · taa · a", "direct · direct · b"]


def test_it_is_self_contained_and_says_everything() -> None:
    text = page(REPORT)
    assert not re.findall(r'(?:src|href)="(?!data:)', text)
    assert text.count("<figure>") == 3 * 4
    assert "<h1>direct of a broke first</h1>" in text
    assert "llvmpipe &lt;1&gt;" in text
    assert "b: the goldens come from Voodoo 2, so the wider tolerance applies" in text
    assert text.count("<tr") == 1 + len(REPORT.findings)
    assert text.count("class=broken") == 4
    assert "largest difference 0.4, 50.00% of the texels off (0.10% allowed)" in text


def test_missing_and_orphan_goldens_are_named() -> None:
    orphan = Finding("a", "", "left.exr", "orphan")
    missing = Finding("a", "taa", "taa", "missing", LIMITS, current=CURRENT)
    text = page(Report([missing, orphan], ["llvmpipe"], {}))
    assert re.findall(r"<h2>(.*?)</h2>", text)[:2] == ["taa · taa · a", "left.exr · a"]
    assert text.count("<figure>") == 1


def test_pictures_of_golden_and_current_share_one_exposure() -> None:
    golden, current = (decoded(picture(image, GOLDEN, "direct")) for image in (GOLDEN, CURRENT / 4))
    assert golden.shape == (6, 8, 3)
    assert (golden == 255).all()
    assert (current[:, :4] < 140).all()


def test_signed_values_lie_around_grey() -> None:
    normals = np.zeros((2, 2, 3), np.float32)
    normals[0], normals[1] = 1.0, -1.0
    assert decoded(picture(normals, normals, "normal"))[:, 0, 0].tolist() == [255, 0]


@pytest.mark.parametrize("resource", ["normal", "direct"])
def test_the_difference_map_is_black_where_nothing_changed(resource: str) -> None:
    if resource == "direct":
        pytest.importorskip("flip_evaluator")
    uri, name = difference_map(finding("a", "direct", resource))
    shown = decoded(uri)
    assert name == {"normal": "difference", "direct": "FLIP"}[resource]
    assert shown[:, 7].max() == 255
    assert resource == "direct" or shown[:, :4].max() == 0
