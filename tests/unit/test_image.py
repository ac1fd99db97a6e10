"""EXR and PNG files, the sRGB transfer function, and atomic writes."""

from __future__ import annotations

import itertools
import stat
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from app.errors import OutputError, SceneError
from app.io.atomic_files import prepare_folders, replace_file, replace_folder, write_text
from app.io.image import read_exr, read_png, srgb_decode, srgb_encode, to_8bit, write_exr, write_png

RNG = np.random.default_rng(7)


def layers() -> dict[str, np.ndarray]:
    return {
        "": RNG.random((5, 7, 3)).astype(np.float16),
        "normal": RNG.normal(size=(5, 7, 3)).astype(np.float16),
        "depth": RNG.random((5, 7, 1), dtype=np.float32) * 1e5,
        "motion": RNG.normal(size=(5, 7, 2)).astype(np.float32),
    }


def test_exr_round_trip(tmp_path: Path) -> None:
    written = layers()
    write_exr(tmp_path / "a.exr", written)
    layers_read = read_exr(tmp_path / "a.exr")
    assert layers_read.keys() == written.keys()
    for name, values in written.items():
        np.testing.assert_array_equal(layers_read[name], values.astype(np.float32))


def test_exr_channel_names_and_types(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", layers())
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    types = dict(zip(spec.channelnames, map(str, spec.channelformats), strict=True))
    assert types == {
        "R": "half", "G": "half", "B": "half", "normal.R": "half", "normal.G": "half", "normal.B": "half",
        "depth.R": "float", "motion.R": "float", "motion.G": "float"}


def test_exr_has_its_top_row_first(tmp_path: Path) -> None:
    image = np.zeros((3, 2, 3), np.float32)
    image[0] = 1
    write_exr(tmp_path / "a.exr", {"": image})
    write_png(tmp_path / "a.png", to_8bit(image))
    assert read_exr(tmp_path / "a.exr")[""][0].min() == 1
    assert read_png(tmp_path / "a.png")[0].min() == 255


def test_same_pixels_give_the_same_bytes(tmp_path: Path) -> None:
    written = layers()
    display = to_8bit(written[""].astype(np.float32))
    for name in ("a", "b"):
        write_exr(tmp_path / f"{name}.exr", written)
        write_png(tmp_path / f"{name}.png", display)
        time.sleep(1.1)
    for kind in ("exr", "png"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


def test_png_round_trip(tmp_path: Path) -> None:
    display = RNG.integers(0, 256, (6, 4, 3), dtype=np.uint8)
    write_png(tmp_path / "a.png", display)
    np.testing.assert_array_equal(read_png(tmp_path / "a.png"), display)


def test_srgb_transfer() -> None:
    x = np.array([-1.0, 0.0, 0.0031308, 0.18, 0.5, 1.0, 9.0])
    np.testing.assert_allclose(srgb_encode(x), [0, 0, 0.040450, 0.461356, 0.735357, 1, 1], atol=2e-6)
    for dtype in (np.float32, np.float64):
        linear = srgb_decode(srgb_encode(x).astype(dtype))
        np.testing.assert_allclose(linear, np.clip(x, 0, 1), atol=1e-6)
        assert linear.dtype == dtype


@pytest.mark.parametrize("write", [
    lambda path: write_exr(path, layers()),
    lambda path: write_png(path, np.zeros((2, 2, 3), np.uint8)),
    lambda path: write_text(path, "x"),
])
def test_a_missing_folder_is_an_output_error(tmp_path: Path, write) -> None:
    with pytest.raises(OutputError, match=r"nowhere.*: can't write .* \(expected"):
        write(tmp_path / "nowhere" / "a.exr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [None, b"", b"no image at all"])
def test_errors_name_the_unreadable_image(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "a.exr"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SceneError, match=r"a\.exr"):
        read_exr(path)


def test_errors_name_the_truncated_image(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"": RNG.random((64, 64, 3)).astype(np.float32)})
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(SceneError, match=r"a\.exr"):
        read_exr(path)


def test_a_failure_keeps_the_old_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), replace_file(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert path.read_text() == "old"


def test_a_folder_in_the_way_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(OutputError, match="can't write the file"):
        write_text(tmp_path / "a.txt", "x")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_files_get_default_permissions(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    write_text(tmp_path / "a.txt", "x")
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_prepare_folders_creates_empty_folders(tmp_path: Path) -> None:
    prepare_folders(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_when_one_folder_fails_none_is_created(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="file"):
        prepare_folders(tmp_path / "a" / "b", tmp_path / "file" / "c")
    assert [f.name for f in tmp_path.iterdir()] == ["file"]


def test_a_file_in_place_of_a_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    for folder in (tmp_path / "a", tmp_path / "a" / "b"):
        with pytest.raises(OutputError, match="expected a folder"):
            prepare_folders(folder)


def test_a_folder_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "folder"
    with replace_folder(folder) as new:
        write_text(new / "first", "1")
    with pytest.raises(KeyboardInterrupt), replace_folder(folder) as new:
        write_text(new / "second", "2")
        raise KeyboardInterrupt
    assert [f.name for f in folder.iterdir()] == ["first"]
    with replace_folder(folder) as new:
        write_text(new / "third", "3")
    assert [f.name for f in folder.iterdir()] == ["third"]
    assert [f.name for f in folder.parent.iterdir()] == ["folder"]


def fail_in_rename(monkeypatch: pytest.MonkeyPatch, error: BaseException, *calls: int, after: bool = False) -> None:
    """Make these calls of ``Path.rename``, counted from 1, raise ``error``, ``after`` or instead of renaming."""
    real, count = Path.rename, itertools.count(1)

    def rename(self: Path, target: Path) -> Path:
        failing = next(count) in calls
        if failing and not after:
            raise error
        real(self, target)
        if failing:
            raise error
        return target

    monkeypatch.setattr(Path, "rename", rename)


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("call", [1, 2])
@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError("full")], ids=["interrupted", "failed"])
def test_a_folder_survives_a_failure_in_each_rename(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                    error: BaseException, call: int, after: bool) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    write_text(folder / "old", "1")
    fail_in_rename(monkeypatch, error, call, after=after)
    with pytest.raises((KeyboardInterrupt, OutputError)), replace_folder(folder) as new:
        write_text(new / "new", "2")
    replaced = call == 2 and after
    assert [f.name for f in folder.iterdir()] == ["new" if replaced else "old"]
    assert [f.name for f in tmp_path.iterdir() if not f.name.startswith(".")] == ["folder"]


def test_when_the_old_folder_cannot_be_restored_it_is_kept_and_named(tmp_path: Path,
                                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    write_text(folder / "old", "1")
    fail_in_rename(monkeypatch, OSError("full"), 2, 3)
    with pytest.raises(OutputError) as caught, replace_folder(folder) as new:
        write_text(new / "new", "2")
    (rescued,) = tmp_path.iterdir()
    assert [f.name for f in rescued.iterdir()] == ["old"]
    assert str(rescued) in str(caught.value)


def test_a_link_to_a_folder_stays_a_link(tmp_path: Path) -> None:
    folder, link = tmp_path / "folder", tmp_path / "elsewhere" / "link"
    folder.mkdir()
    link.parent.mkdir()
    link.symlink_to(folder)
    with replace_folder(link) as new:
        write_text(new / "new", "2")
    assert link.is_symlink() and [f.name for f in folder.iterdir()] == ["new"]
    assert sorted(f.name for f in tmp_path.iterdir()) == ["elsewhere", "folder"]
    assert [f.name for f in link.parent.iterdir()] == ["link"]


def test_the_current_folder_can_be_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    monkeypatch.chdir(folder)
    with replace_folder(Path()) as new:
        write_text(new / "new", "2")
    assert [f.name for f in folder.iterdir()] == ["new"]
