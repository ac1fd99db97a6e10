"""The rest of a geometric series, whole or up to a number of members."""

from __future__ import annotations

from torch import Tensor


def rest(newest: Tensor, ratio: Tensor, count: Tensor) -> Tensor:
    """What the next ``count`` members of a geometric series add: newest · (ratio + ratio² + … + ratio^count).

    Parameters
    ----------
    newest : Tensor
        The last member that was added.
    ratio : Tensor
        Of a member to the one before, in [0, 1).
    count : Tensor
        None at 0 and below. Where ratio^count vanishes the series is whole, to the bit.
    """
    return newest * ratio / (1 - ratio) * (1 - ratio ** count.clamp(min=0))
