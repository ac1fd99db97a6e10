"""Atomic writes: files and folders are written beside their destination and then renamed, so no reader sees a part."""

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from app.errors import OutputError


@contextlib.contextmanager
def replace_file(path: Path) -> Iterator[Path]:
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
        raise OutputError(f"can't write the file: {error.strerror or error}", path,
                          "expected a writable folder with enough space") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def replace_folder(folder: Path) -> Iterator[Path]:
    """Give a new, empty folder beside ``folder`` that takes its place when the block succeeds.

    If ``folder`` is a symbolic link, its target is replaced.

    Raises
    ------
    OutputError
        When the block or the renaming fails with an ``OSError``. The old content is then still in ``folder``, or in the
        folder that the message names.
    """
    folder = folder.resolve()
    new, old = (folder.with_name(f".{os.getpid()}-{kind}-{folder.name}") for kind in ("new", "old"))
    try:
        new.mkdir(parents=True)
        yield new
        _swap(new, folder, old)
    except OSError as error:
        rescued = "" if folder.exists() or not old.exists() else f"; its old content is in {old}"
        raise OutputError(f"can't write the folder: {error.strerror or error}", folder,
                          f"expected a writable folder with enough space{rescued}") from error
    finally:
        shutil.rmtree(new, ignore_errors=True)


def remove_temporary_files(folder: Path, process: int) -> None:
    """Remove what a process that was killed had begun to write in ``folder``, by its number."""
    for file in folder.rglob(f".{process}-*"):
        with contextlib.suppress(OSError):
            file.unlink()


def write_text(path: Path, text: str) -> None:
    """Write ``text`` as UTF-8, atomically."""
    with replace_file(path) as temporary:
        temporary.write_text(text, "utf-8")


def check_folders(*folders: Path) -> None:
    """Check that ``prepare_folders`` will succeed, which it raises an error like, and leave everything as it was."""
    _remove(prepare_folders(*folders))


def prepare_folders(*folders: Path) -> list[Path]:
    """Create ``folders`` where missing and check that they are writable; if one is not, none is created.

    Returns
    -------
    list of Path
        What was created, with the parents, in this order.

    Raises
    ------
    OutputError
        When a folder can't be created or written to.
    """
    created: list[Path] = []
    for folder in folders:
        probe = folder / f".{os.getpid()}-probe"
        try:
            for missing in reversed([f for f in (folder, *folder.parents) if not f.exists()]):
                missing.mkdir()
                created.append(missing)
            probe.touch()
            probe.unlink()
        except OSError as error:
            _remove(created)
            raise OutputError(f"is not a writable folder: {error.strerror or error}", folder,
                              "expected a folder that exists or can be created") from error
    return created


def _remove(created: list[Path]) -> None:
    for folder in reversed(created):
        folder.rmdir()


def _swap(new: Path, folder: Path, old: Path) -> None:
    """Rename ``folder`` to ``old`` and ``new`` to ``folder``; if that fails, rename ``old`` back."""
    try:
        if folder.exists():
            folder.rename(old)
        new.rename(folder)
    except BaseException:
        if old.exists() and not folder.exists():
            old.rename(folder)
        raise
    shutil.rmtree(old, ignore_errors=True)
