"""Draws cases and makes the result their goldens."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from app.errors import OutputError
from app.golden.case import Case
from app.golden.store import read_origin, refuse_strangers, write_case
from app.io.atomic_files import prepare_folders, replacing_folder


def update(cases: Sequence[Case], folder: Path, known: Iterable[str], looked: bool = False) -> list[Path]:
    """Draw ``cases`` and write their goldens, all or none; those of other ``known`` cases stay.

    Parameters
    ----------
    looked : bool
        Overwrite goldens of another renderer too, since somebody compared the pictures.

    Raises
    ------
    OutputError
        When ``folder`` holds other things than goldens or, unless ``looked``, goldens of another renderer, or when
        it can't be written.
    """
    folder = folder.resolve()  # or it would be lost while the current folder is replaced
    refuse_strangers(folder)
    if not looked:
        _refuse_foreign(cases, folder)
    prepare_folders(folder.parent)
    drawn = {case.name: (case.origin(), case.draw(folder / case.name)) for case in cases}
    with replacing_folder(folder) as fresh:
        for name in (n for n in known if n not in drawn and (folder / n).is_dir()):
            shutil.copytree(folder / name, fresh / name)
        for name, (origin, pictures) in drawn.items():
            write_case(fresh / name, origin, pictures)
    return sorted(folder.rglob("*.exr"))


def _refuse_foreign(cases: Iterable[Case], folder: Path) -> None:
    for case in cases:
        golden = read_origin(folder / case.name)
        if golden not in (None, case.origin()):
            raise OutputError(f"the goldens of {case.name!r} come from {golden}", folder,
                              f"expected {case.origin()}; once you looked at what differs, add --i-looked")
