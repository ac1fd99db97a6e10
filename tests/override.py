"""Replaces what passes write, to see what later passes make of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from app.gl.pool import Pool
from app.graph import BoundPass
from app.renderer import Renderer
from app.scene import Camera

Image = NDArray[Any]
Value = Image | float | Callable[[Image], Image]

_VALUES: WeakKeyDictionary[Renderer, dict[str, Value]] = WeakKeyDictionary()


def override(renderer: Renderer, resource: str, value: Value | None) -> None:
    """Replace ``resource`` after its pass ran, in every frame from now on; None undoes it.

    Parameters
    ----------
    value : ndarray, float or callable
        A constant for all texels and components, an image [H, W, C] with its top row first, or a function that makes
        such an image from the one that the pass wrote. Tensors are [C, h, w] or [C, 6, n, n].
    """
    if renderer not in _VALUES:
        values = _VALUES[renderer] = {}
        renderer.after_pass.insert(0, lambda bound, pool: _replace(values, bound, pool))
    _VALUES[renderer].pop(resource, None)
    if value is not None:
        _VALUES[renderer][resource] = value


def is_overridden(renderer: Renderer, resource: str) -> bool:
    return resource in _VALUES.get(renderer, {})


def draw_replaced(renderer: Renderer, cameras: Sequence[Camera], *values: Mapping[str, Value]) -> None:
    """Draw one frame for each of ``values``, which replaces these resources in it; cameras follow one another."""
    for camera, replaced in zip(cameras, values, strict=True):
        for resource, value in replaced.items():
            override(renderer, resource, value)
        renderer.advance(camera)
        for resource in replaced:
            override(renderer, resource, None)


def _replace(values: dict[str, Value], bound: BoundPass, pool: Pool) -> None:
    for name in set(bound.writes) & set(values):
        value = values[name]
        pool.write(name, np.asarray(value(pool.read(name)) if callable(value) else value, np.float32))
