"""Multi-head attention whose weights depend on geometry alone."""

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

MAX_KEYS = 1024
SKY_LOGIT = -1e4  # of keys in the sky: no weight


class Attention(nn.Module):
    """Attention between all texels, with queries and keys from geometry and values from shading.

    The softmax is computed in single precision. Beyond ``max_keys`` texels, k×k of them are pooled to one key and one
    value, so memory grows linearly with the number of texels.
    """

    def __init__(self, geometry: int, shading: int, heads: int, max_keys: int) -> None:
        super().__init__()
        if heads < 1 or geometry % heads or shading % heads or max_keys < 1:
            raise ValueError(f"{heads} heads for {geometry} and {shading} channels, at most {max_keys} keys")
        self.heads, self.max_keys = heads, max_keys
        self.query, self.key = (nn.Conv2d(geometry, geometry, 1, bias=False) for _ in range(2))
        self.value = nn.Conv2d(shading, shading, 1, bias=False)

    def weights(self, geometry: Tensor, surface: Tensor) -> Tensor:
        """Weight of each key for each texel, shape (B, heads, texels, keys); ``geometry`` is [B, C, h, w]."""
        geometry, surface = geometry.float(), surface.float()
        queries = self._split(functional.conv2d(geometry, self.query.weight.float()))
        keys = self._split(self._pool(functional.conv2d(geometry, self.key.weight.float()), surface))
        logits = queries.transpose(2, 3) @ keys / queries.shape[2] ** 0.5
        mask = self._pool(surface, surface).flatten(2).unsqueeze(1)
        return torch.softmax(logits + (1 - mask) * SKY_LOGIT, dim=-1)

    def forward(self, x: Tensor, weights: Tensor, surface: Tensor) -> Tensor:
        """The weighted values for ``x`` [B, runs, C, h, w], of the same shape; all runs in one product."""
        shape, runs = x.shape, int(x.shape[1])
        values = self._split(self._pool(self.value(x.flatten(0, 1)), surface.repeat_interleave(runs, 0)))
        values = torch.unflatten(values, 0, (-1, runs)).transpose(1, 2).flatten(2, 3)
        output = values.float() @ weights.transpose(2, 3)
        output = torch.unflatten(output, 2, (runs, -1)).transpose(1, 2)
        return output.reshape(shape).to(x.dtype)

    def _split(self, x: Tensor) -> Tensor:
        """Heads as an axis: (B, heads, C / heads, texels)."""
        return torch.unflatten(x.flatten(2), 1, (self.heads, -1))

    def _pool(self, x: Tensor, surface: Tensor) -> Tensor:
        """Means over the surfaces within each k×k texels."""
        h, w = x.shape[2:]
        k = torch.as_tensor(h * w / self.max_keys).sqrt().ceil().long()
        down, across = _groups(h, k).to(x), _groups(w, k).to(x)
        total = down @ (x * surface) @ across.t()
        return total / (down @ surface @ across.t()).clamp(min=1)


def _groups(count: Any, k: Tensor) -> Tensor:
    """Membership of ``count`` consecutive texels in groups of k, bool, shape (groups, count)."""
    group = torch.arange(count).div(k, rounding_mode="floor")
    return group == torch.arange((count + k - 1).div(k, rounding_mode="floor")).unsqueeze(1)
