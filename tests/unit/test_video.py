"""Videos: decoded frames agree with the encoded ones, and files appear whole or not at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from app.errors import AfterglowError, OutputError, SettingsError
from app.io.video import CODECS, RATE, check_video, open_video

SIZE = (64, 48)
FRAMES = 12
COLOURS = np.array([[200, 40, 40], [40, 200, 40], [40, 40, 200], [230, 230, 60], [128] * 3, [20] * 3], np.uint8)


def picture(index: int) -> np.ndarray:
    """Six stripes of colour, and a white bar that moves."""
    frame = np.repeat(COLOURS, -(-SIZE[0] // 6), axis=0)[None, :SIZE[0]].repeat(SIZE[1], axis=0).copy()
    frame[4 * index % SIZE[1]:][:4] = 255
    return frame


def decode(path: Path) -> tuple[np.ndarray, float]:
    """All frames, [N, H, W, 3], and their rate."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24", src_colorspace="itu709") if path.suffix != ".gif"
                  else frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        return np.stack(frames), float(stream.average_rate)


@pytest.mark.parametrize("kind", CODECS)
def test_decoded_frames_agree_with_the_encoded_ones(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"video.{kind}"
    with open_video(path, SIZE) as write:
        for index in range(FRAMES):
            write(picture(index))
        assert not path.exists()
    frames, rate = decode(path)
    assert frames.shape == (FRAMES, SIZE[1], SIZE[0], 3)
    assert rate == pytest.approx(RATE, rel=0.12)  # GIF counts hundredths of a second
    for index, frame in enumerate(frames):
        assert np.abs(frame.astype(float) - picture(index)).mean() < 8
        assert np.median(np.abs(frame.astype(float) - picture(index))) <= 3
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("kind", CODECS)
def test_the_same_frames_give_the_same_bytes(kind: str, tmp_path: Path) -> None:
    files = [tmp_path / name / f"video.{kind}" for name in "ab"]
    for file in files:
        file.parent.mkdir()
        with open_video(file, SIZE) as write:
            for index in range(FRAMES):
                write(picture(index))
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize("kind", CODECS)
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interrupted_video_leaves_nothing(kind: str, error: type[BaseException], tmp_path: Path) -> None:
    path = tmp_path / f"video.{kind}"
    path.write_text("before")
    with pytest.raises(error), open_video(path, SIZE) as write:
        write(picture(0))
        raise error
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.read_text() == "before"


def test_a_missing_folder_is_a_user_error(tmp_path: Path) -> None:
    path = tmp_path / "none" / "video.mp4"
    with pytest.raises(OutputError, match=r"video\.mp4: can't write"), open_video(path, SIZE) as write:
        write(picture(0))


def test_odd_sides_are_refused_before_anything_is_drawn() -> None:
    with pytest.raises(SettingsError, match="size: mp4 does not support 63x48"):
        check_video(["mp4"], (63, 48))
    check_video(["webm", "gif"], (63, 47))


def test_other_formats_support_odd_sides(tmp_path: Path) -> None:
    for kind in ("webm", "gif"):
        with open_video(tmp_path / f"video.{kind}", (63, 47)) as write:
            write(picture(0)[:47, :63])
        assert decode(tmp_path / f"video.{kind}")[0].shape == (1, 47, 63, 3)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(AfterglowError, match=r"pip install 'afterglow\[video\]'"):
        check_video(["mp4"], SIZE)


def test_a_missing_encoder_is_named_before_anything_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CODECS, "mp4", replace(CODECS["mp4"], name="libnone"))
    with pytest.raises(AfterglowError, match=r"mp4: .*no encoder libnone \(expected"):
        check_video(["mp4"], SIZE)
