"""Pairs of neighbouring frames with path-traced targets, made from a seed and kept in a folder."""

from __future__ import annotations

from export.dataset.dataset import Dataset
from export.dataset.pair import Pair
from export.dataset.target import Target

__all__ = ["Dataset", "Pair", "Target"]
