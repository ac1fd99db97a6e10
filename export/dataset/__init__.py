"""Datasets of pairs of neighbouring frames with path-traced targets, generated from a seed."""

from export.dataset.dataset import Dataset
from export.dataset.plan import Pair
from export.dataset.target import Target

__all__ = ["Dataset", "Pair", "Target"]
