"""Draws cases and stores the result as their goldens."""

import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from app.errors import OutputError
from app.golden.case import Case
from app.golden.store import check_replaceable, read_origin, write_case
from app.io.atomic_files import prepare_folders, replace_folder


def update(cases: Sequence[Case], folder: Path, known: Iterable[str], overwrite_foreign: bool = False) -> list[Path]:
    """Draw ``cases`` and write their goldens, all or none; goldens of other ``known`` cases stay.

    Parameters
    ----------
    overwrite_foreign : bool
        Also overwrite goldens of another renderer.

    Raises
    ------
    OutputError
        When ``folder`` contains anything but goldens, or goldens of another renderer that are not to be overwritten,
        or when it can't be written.
    """
    folder = folder.resolve()  # remains valid while the current folder is replaced
    check_replaceable(folder)
    if not overwrite_foreign:
        _check_origins(cases, folder)
    prepare_folders(folder.parent)
    drawn = {case.name: (case.origin(), case.draw(folder / case.name)) for case in cases}
    with replace_folder(folder) as temporary:
        for name in (n for n in known if n not in drawn and (folder / n).is_dir()):
            shutil.copytree(folder / name, temporary / name)
        for name, (origin, pictures) in drawn.items():
            write_case(temporary / name, origin, pictures)
    return sorted(folder.rglob("*.exr"))


def _check_origins(cases: Iterable[Case], folder: Path) -> None:
    for case in cases:
        golden = read_origin(folder / case.name)
        if golden not in (None, case.origin()):
            raise OutputError(f"the goldens of {case.name!r} come from {golden}", folder,
                              f"expected {case.origin()}; compare the pictures, then add --i-looked")
