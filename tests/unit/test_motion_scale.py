"""The size of frames in motion follows the frame rate."""

from __future__ import annotations

import pytest

from app.view.motion_scale import SCALES, MotionScale


def draw(motion_scale: MotionScale, full_size_seconds: float, frames: int = 40) -> list[float]:
    """The scales of frames whose time is proportional to their number of pixels."""
    scales = []
    for _ in range(frames):
        scales.append(motion_scale.scale)
        motion_scale.measure(full_size_seconds * motion_scale.scale**2)
    return scales


@pytest.mark.parametrize(("seconds", "expected"), [(0.05, 1.0), (0.12, 0.75), (0.3, 0.5), (5.0, 0.5)])
def test_it_settles_at_the_largest_size_that_is_fast_enough(seconds: float, expected: float) -> None:
    scales = draw(MotionScale(10), seconds)
    assert set(scales[20:]) == {expected}
    assert scales == sorted(scales, reverse=True)


def test_it_grows_again_when_frames_become_faster() -> None:
    motion_scale = MotionScale(10)
    assert draw(motion_scale, 1.0)[-1] == SCALES[-1]
    assert draw(motion_scale, 0.01)[-1] == 1.0


def test_one_slow_frame_changes_nothing() -> None:
    motion_scale = MotionScale(10)
    draw(motion_scale, 0.05)
    motion_scale.measure(3.0)
    assert draw(motion_scale, 0.05) == [1.0] * 40


def test_without_a_target_all_frames_have_full_size() -> None:
    assert set(draw(MotionScale(0), 100.0)) == {1.0}
