"""The rest of a geometric series against its members added one by one."""

from __future__ import annotations

import numpy as np
import pytest

from app.network.channels import ALL_BOUNCES

torch = pytest.importorskip("torch", reason="networks are made with torch")
from export.models.geometric_tail import rest  # noqa: E402

RATIOS = torch.tensor([0.0, 1e-6, 0.1, 0.5, 0.9, 0.95], dtype=torch.float64)


@pytest.mark.parametrize("count", [-3, 0, 1, 2, 7, 63])
def test_a_part_of_the_series_is_the_sum_of_its_members(count: int) -> None:
    members = [3.0 * RATIOS**k for k in range(1, count + 1)]
    found = rest(torch.tensor(3.0), RATIOS, torch.tensor(float(count)))
    np.testing.assert_allclose(found, sum(members, torch.zeros_like(RATIOS)), rtol=1e-13)


@pytest.mark.parametrize("kind", [torch.float32, torch.float16], ids=str)
def test_the_whole_series_is_whole_to_the_bit(kind: torch.dtype) -> None:
    newest, ratio = torch.linspace(0.1, 3, 6, dtype=kind), RATIOS.to(kind)
    found = rest(newest, ratio, torch.tensor(ALL_BOUNCES, dtype=kind))
    assert torch.equal(found, newest * ratio / (1 - ratio))
    assert found[-1] > 10
