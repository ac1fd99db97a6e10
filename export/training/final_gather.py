"""Trains the network that cleans gathered light, on frames with the light of single rays.

In each step a random number of consecutive rays of each texel is the input, fewer where a surface has just come into
view, and the mean of the rays of another sequence the target. Errors of the target don't matter on the mean: it is as
often too bright as too dark, whatever the input's error is (Lehtinen et al. 2018, "Noise2Noise: Learning Image
Restoration without Clean Data").
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor

from export.dataset.gathered_frames import GatheredFrame
from export.models.final_gather import FinalGather
from export.models.gather_cleaners import CLEANERS

BATCH, CROP = 2, 64             # frames of a step, and texels along the edge of what is taken of each
LEARNING_RATE, MIN_LEARNING_RATE = 2.5e-3, 3e-5
WARM_UP = 10                    # steps
EMA = 0.985
HIDDEN_PROBABILITY = 0.4        # that a part of the frame has fewer rays
EXPOSURE_STOPS = SIZE_STOPS = 1.0  # light and lengths are scaled by 2 to a power of at most this magnitude
MIN_LIGHT = 0.1                 # of the frame's mean, that errors are relative to at least
MAX_SQUARE = 50.0               # of a relative error
MIN_NOISE = 0.01                # square of the relative error of targets, below which frames count alike

Report = Callable[[int, float, float], object]  # completed steps, seconds, mean loss since the last report


def train(frames: Sequence[GatheredFrame], seconds: float, seed: int, report: Report, report_steps: int = 50,
          name: str = "final-gather") -> FinalGather:
    """Train the network ``name`` of ``CLEANERS`` for a time; returns it with the moving average of its weights."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    network = CLEANERS[name]()
    average = copy.deepcopy(network)
    optimizer = torch.optim.Adam(network.parameters(), LEARNING_RATE, betas=(0.9, 0.99))
    weights = torch.tensor([MIN_NOISE / (MIN_NOISE + noise_of(frame)) for frame in frames])
    start, step, losses = time.perf_counter(), 0, []
    while (passed := time.perf_counter() - start) < seconds:
        for group in optimizer.param_groups:
            fall = 0.5 * (1 + math.cos(math.pi * passed / seconds))
            group["lr"] = MIN_LEARNING_RATE + LEARNING_RATE * fall * min(1.0, (step + 1) / WARM_UP)
        chosen = rng.integers(len(frames), size=BATCH)
        examples = [make_example(frames[index], rng) for index in chosen]
        screen, target = (torch.stack(parts) for parts in zip(*examples, strict=True))
        loss = relative_error(network(screen), target, screen[:, 8:11], weights[chosen])
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        step += 1
        decay = min(EMA, (1 + step) / (10 + step))
        with torch.no_grad():
            for mean, weight in zip(average.parameters(), network.parameters(), strict=True):
                mean.lerp_(weight, 1 - decay)
        losses.append(float(loss.detach()))
        if step % report_steps == 0:
            report(step, time.perf_counter() - start, float(np.mean(losses[-report_steps:])))
    return average.eval()


def noise_of(frame: GatheredFrame) -> float:
    """Mean square of the relative error of a frame's target."""
    light = frame.target.astype(np.float32).mean(axis=-1)
    mean = light.mean(axis=-1)
    variance = light.var(axis=-1) / light.shape[-1]
    surface = np.abs(frame.normal).sum(axis=0) > 0
    return float(np.minimum(variance / (mean + MIN_LIGHT) ** 2, MAX_SQUARE)[surface].mean())


def relative_error(output: Tensor, target: Tensor, normal: Tensor, weights: Tensor) -> Tensor:
    """Mean square of errors relative to the output, on surfaces; without bias for noisy targets.

    Parameters
    ----------
    output, target, normal : Tensor, shape (B, 3, h, w)
    weights : Tensor, shape (B,)
        Of the frames: the fewer, the noisier their targets are, which teach little else than noise.
    """
    surface = (normal.abs().sum(1, keepdim=True) > 0).to(output)
    scale = output.detach().mean(1, keepdim=True) + MIN_LIGHT
    square = (((output - target) / scale).square() * surface).clamp(max=MAX_SQUARE)
    return (square.mean(dim=(1, 2, 3)) * weights).mean()


def make_example(frame: GatheredFrame, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """A network's input and its target, shapes (14, h, w) and (3, h, w), from a random part of a frame."""
    height, width, rays = frame.distance.shape
    top, left = (4 * int(rng.integers((n - CROP) // 4 + 1)) for n in (height, width))
    part = np.s_[top:top + CROP, left:left + CROP]
    count = min(int(2 ** rng.uniform(0, math.log2(rays) + 1)), rays)
    first = int(rng.integers(rays - count + 1))
    inputs = slice(first, first + count)
    counts = _random_counts(count, rng)
    known = counts > 0  # nothing is interpolated where no ray has started yet
    used = (np.arange(count) < counts[..., None]).astype(np.float32)
    some = np.maximum(counts, 1)
    gathered = np.einsum("hwkc,hwk->chw", frame.light[part][:, :, inputs].astype(np.float32), used) / some
    nearness = (frame.distance[part][:, :, inputs].astype(np.float32) * used).sum(axis=2) / some
    target = np.moveaxis(frame.target[part].astype(np.float32).mean(axis=2), -1, 0)
    colors, exposure = rng.permutation(3), 2 ** rng.uniform(-EXPOSURE_STOPS, EXPOSURE_STOPS)
    interpolated, normal, position = (x[(slice(None), *part)] for x in (frame.interpolated, frame.normal,
                                                                        frame.position))
    size = 2 ** rng.uniform(-SIZE_STOPS, SIZE_STOPS)
    screen = np.concatenate([gathered[colors] * exposure, counts[None], nearness[None],
                             interpolated[colors] * exposure * known, normal, position * size])
    target = target[colors] * exposure
    if rng.random() < 0.5:  # mirrored
        screen, target = screen[..., ::-1].copy(), target[..., ::-1].copy()
        screen[[8, 11]] *= -1
    return torch.from_numpy(screen.astype(np.float32)), torch.from_numpy(target.astype(np.float32))


def _random_counts(count: int, rng: np.random.Generator) -> np.ndarray:
    """Rays of each texel, shape (h, w): often fewer in a band, as of a surface that was hidden until lately.

    There, one texel of 2×2 gets a ray in each frame, in turn.
    """
    counts = np.full((CROP, CROP), count)
    if rng.random() < HIDDEN_PROBABILITY:
        y, x = np.mgrid[:CROP, :CROP]
        angle, (a, b) = rng.uniform(0, 2 * math.pi), rng.uniform(0, CROP, 2)
        across = math.cos(angle) * (x - a) + math.sin(angle) * (y - b)
        turn = rng.permutation(4)[2 * (y % 2) + x % 2]
        hidden = (across > 0) & (across < rng.uniform(3, CROP))
        frames = int(2 ** rng.uniform(0, 5))  # since it has been seen
        counts = np.where(hidden, np.minimum((frames + turn) // 4, count), counts)
    return counts
