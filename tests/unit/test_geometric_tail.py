"""The tail of a geometric series against the sum of its terms."""

from __future__ import annotations

import numpy as np
import pytest

from app.network.channels import ALL_BOUNCES

torch = pytest.importorskip("torch", reason="networks are torch modules")
from export.models.network import geometric_tail  # noqa: E402

RATIOS = torch.tensor([0.0, 1e-6, 0.1, 0.5, 0.9, 0.95], dtype=torch.float64)


@pytest.mark.parametrize("count", [-3, 0, 1, 2, 7, 63])
def test_a_partial_tail_is_the_sum_of_its_terms(count: int) -> None:
    terms = [3.0 * RATIOS**k for k in range(1, count + 1)]
    tail = geometric_tail(torch.tensor(3.0), RATIOS, torch.tensor(float(count)))
    np.testing.assert_allclose(tail, sum(terms, torch.zeros_like(RATIOS)), rtol=1e-13)


@pytest.mark.parametrize("kind", [torch.float32, torch.float16], ids=str)
def test_the_infinite_tail_is_exact(kind: torch.dtype) -> None:
    last, ratio = torch.linspace(0.1, 3, 6, dtype=kind), RATIOS.to(kind)
    tail = geometric_tail(last, ratio, torch.tensor(ALL_BOUNCES, dtype=kind))
    assert torch.equal(tail, last * ratio / (1 - ratio))
    assert tail[-1] > 10
