"""Files that appear whole: written beside their place, then renamed into it."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from app.errors import OutputError


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside ``path`` and rename it to ``path`` when the block succeeds.

    Raises
    ------
    OutputError
        When the block or the renaming fails with an ``OSError``; nothing is left behind.
    """
    temporary = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"can't write the file ({error.strerror or error})", path,
                          "expected a writable place with room for it") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def replacing_folder(folder: Path) -> Iterator[Path]:
    """Give a new, empty folder beside ``folder`` and let it take the place of ``folder`` when the block succeeds.

    Where ``folder`` is a symbolic link, what it points to is replaced.

    Raises
    ------
    OutputError
        When the block or the renaming fails with an ``OSError``; ``folder`` is then as it was before, or what it held
        lies where the message says.
    """
    folder = folder.resolve()
    fresh, old = (folder.with_name(f".{os.getpid()}-{kind}-{folder.name}") for kind in ("new", "old"))
    try:
        fresh.mkdir(parents=True)
        yield fresh
        _take_place(fresh, folder, old)
    except OSError as error:
        rescued = "" if folder.exists() or not old.exists() else f"; what it held is in {old}"
        raise OutputError(f"can't write the folder ({error.strerror or error})", folder,
                          f"expected a writable place with room for it{rescued}") from error
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _take_place(fresh: Path, folder: Path, old: Path) -> None:
    """Rename ``fresh`` to ``folder``; what was there is ``old`` meanwhile, and comes back when that fails."""
    try:
        if folder.exists():
            folder.rename(old)
        fresh.rename(folder)
    except BaseException:
        if old.exists() and not folder.exists():
            old.rename(folder)
        raise
    shutil.rmtree(old, ignore_errors=True)


def write_text(path: Path, text: str) -> None:
    """Write ``text`` as UTF-8 in one step."""
    with replacing(path) as temporary:
        temporary.write_text(text, "utf-8")


def prepare_folders(*folders: Path) -> None:
    """Make ``folders`` and check that files can be written in them; when one fails, none is made.

    Raises
    ------
    OutputError
        When one can't be made or does not take a file.
    """
    made: list[Path] = []
    for folder in folders:
        probe = folder / f".{os.getpid()}-probe"
        try:
            for missing in reversed([f for f in (folder, *folder.parents) if not f.exists()]):
                missing.mkdir()
                made.append(missing)
            probe.touch()
            probe.unlink()
        except OSError as error:
            for new in reversed(made):
                new.rmdir()
            raise OutputError(f"can't write in the folder ({error.strerror or error})", folder,
                              "expected a folder that can be made and written in") from error
