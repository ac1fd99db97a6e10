"""Row "metrics themselves" of the table of hazards: no NaN hides in a mean, no black reference ends the program."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from app.errors import MetricError
from app.evaluation.metrics import flip, psnr, rel_mse, ssim

ROOT = Path(__file__).parents[2]
METRICS = [psnr, ssim, rel_mse, flip]
Metric = Callable[[NDArray[np.float32], NDArray[np.float32]], float]


def noise(seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(0.2, 1.0, (23, 31, 3)).astype(np.float32)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("metric", METRICS)
def test_one_value_that_is_not_finite_is_refused(metric: Metric, value: float) -> None:
    sound, broken = noise(0), noise(1)
    assert np.isfinite(metric(broken, sound))
    broken[11, 7, 1] = value
    for pair in ((broken, sound), (sound, broken)):
        with pytest.raises(MetricError, match="1 texels are not finite"):
            metric(*pair)


def test_a_black_reference_gives_numbers_and_the_program_lives_on() -> None:
    """In a process of its own, which flip-evaluator would end with automatic exposures."""
    program = """
import numpy as np
from app.evaluation.metrics import flip, psnr, rel_mse, ssim
black = np.zeros((23, 31, 3), np.float32)
lit = black.copy(); lit[3, 4] = 1.0
print(*(metric(image, black) for metric in (psnr, ssim, rel_mse, flip) for image in (black, lit)))
"""
    run = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    best, worse = np.array(run.stdout.split(), float).reshape(4, 2).T
    np.testing.assert_array_equal(best, [np.inf, 1.0, 0.0, 0.0])
    assert np.isfinite(worse).all()
    assert worse[0] < 40 and worse[1] < 1 and worse[2] > 0 and worse[3] > 0
