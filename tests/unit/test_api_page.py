"""docs/api.md is what the docstrings say."""

from __future__ import annotations

import runpy
from pathlib import Path

import app.api

ROOT = Path(__file__).parents[2]


def test_the_page_is_that_of_the_docstrings() -> None:
    page = (ROOT / "docs" / "api.md").read_text()
    assert page == runpy.run_path(str(ROOT / "scripts" / "write_api_page.py"))["make_page"](), (
        "run python scripts/write_api_page.py")
    for name in app.api.__all__:
        assert f"## `{name}`" in page
