"""``python -m export precision``: what half precision changes in networks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.atomic import write_text
from app.load import load_scene
from export.cli.options import known_networks


def precision(names: Annotated[list[str] | None, typer.Argument(help="Networks; all without any.")] = None,
              scene: Annotated[list[Path] | None, typer.Option(
                  help="Scene files to take real inputs from; the bundled scenes without any.")] = None,
              json: Annotated[Path | None, typer.Option(help="Write the rows as JSON too.", metavar="FILE")] = None,
              ) -> None:
    """Print a table of what half precision changes in networks, and where it overflows."""
    from export.precision import as_json, as_markdown, default_scenes, table

    rows = table(known_networks(names), {path.stem: load_scene(path) for path in scene} if scene else default_scenes())
    if json is not None:
        write_text(json, as_json(rows))
    print(as_markdown(rows))
