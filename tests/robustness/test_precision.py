"""Half against single precision in the arithmetic of the bundled networks, a small version of docs/accuracy.md."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

torch = pytest.importorskip("torch")

from app.network.selection import find_model  # noqa: E402
from app.network.session import Network  # noqa: E402
from export.__main__ import cli  # noqa: E402
from export.models import UNTRAINED  # noqa: E402
from export.onnx.precision import (  # noqa: E402
    HALF,
    LIGHT_ONLY,
    SIZE,
    Rounding,
    as_markdown,
    measure,
)
from export.onnx.sample_inputs import rendered_inputs, sample_inputs  # noqa: E402
from tests.robustness.scenes import lit_corner  # noqa: E402

NAMES = ("ember", "gather", "radiosity")


def test_rounding_is_that_of_half_precision() -> None:
    """Every operation agrees with torch in half precision, and overflows are counted.

    The expected roots are computed in single precision: torch's own roots with AVX-512 differ by up to one unit of
    single precision, which changes how ties between two halves are rounded.
    """
    x, y = (torch.from_numpy(np.random.default_rng(i).uniform(-300, 300, 1000).astype(np.float32)) for i in (0, 1))
    mode = Rounding(active=True)
    with mode:
        a, b = mode.round(x), mode.round(y)
        product = (a * b).abs()
        results = [a + b, a / b, a.abs().sqrt(), product, product * a.abs()]
    h, k = x.half(), y.half()
    expected = [h + k, h / k, h.float().abs().sqrt().half(), (h * k).abs(), (h * k).abs() * h.abs()]
    for result, reference in zip(results, expected, strict=True):
        np.testing.assert_array_equal(result.numpy(), reference.float().numpy())
    overflown = sum(int(e.isinf().sum()) for e in expected)
    before = int((h * k).isinf().sum())  # infinite already before the last product, so counted once
    assert mode.overflows == overflown - before > 0


def test_nothing_is_rounded_while_it_is_inactive() -> None:
    module = UNTRAINED["gather"]().eval()
    inputs = [torch.from_numpy(x) for x in dict(sample_inputs(module.contract))["room"].values()]
    with torch.no_grad():
        plain = module(*inputs)
        with Rounding(active=False):
            assert torch.equal(module(*inputs), plain)


@pytest.mark.gl
@pytest.mark.usefixtures("egl")
@pytest.mark.parametrize("name", NAMES)
def test_light_may_be_half_but_geometry_must_not(name: str) -> None:
    """On rendered inputs, the error is below 0.2 % with geometry in single precision, and large without."""
    ((_, inputs),) = rendered_inputs(UNTRAINED[name]().contract, {"corner": lit_corner()}, SIZE)
    if name == "ember":  # whose pixels are independent
        inputs["screen"] = np.ascontiguousarray(inputs["screen"][..., ::4, ::4])
    single, mixed, half = (measure(name, UNTRAINED[name]().eval(), "corner", inputs, v) for v in ("", LIGHT_ONLY, HALF))
    print("\n" + as_markdown([mixed, half]))
    assert single.mean == 0 and single.overflows == 0 and single.not_finite == 0
    assert mixed.mean is not None and 1e-5 < mixed.mean < 2e-3
    assert mixed.p99 is not None and mixed.p99 < 2e-2
    assert mixed.overflows == 0 and mixed.not_finite == 0
    assert half.not_finite > 0.5 or (half.wrong is not None and half.wrong > 0.2)


@pytest.mark.gl
@pytest.mark.usefixtures("egl")
def test_rendered_inputs_are_those_of_the_renderer() -> None:
    """Single precision agrees with the network pass up to the frame's exposure."""
    ((_, inputs),) = rendered_inputs(UNTRAINED["radiosity"]().contract, {"corner": lit_corner()}, SIZE)
    with torch.no_grad():
        output = UNTRAINED["radiosity"]().eval()(*(torch.from_numpy(x) for x in inputs.values())).numpy()[0]
    height, width = output.shape[1:]
    run = Network(find_model("radiosity"), (width, height), "cpu").run({t: x[0] for t, x in inputs.items()})
    np.testing.assert_allclose(run["indirect.rgb"], output, atol=2e-3 * output.max())


@pytest.mark.parametrize("name", NAMES)
def test_extreme_inputs_stay_finite_with_geometry_in_single(name: str) -> None:
    """Black, invalid and negative values; only light at the end of the range overflows."""
    module = UNTRAINED[name]().eval()
    inputs = dict(sample_inputs(module.contract))
    for label in ("0.0", "some 0.0", "nan", "some nan", "-inf", "-100.0", "some -100.0"):
        row = measure(name, module, label, inputs[label], LIGHT_ONLY)
        assert row.overflows == 0 and row.not_finite == 0, label
        assert row.mean is None or row.mean < 5e-3, label
    for label in ("inf", "1000000.0"):
        assert measure(name, module, label, inputs[label], LIGHT_ONLY).overflows > 0, label


@pytest.mark.long
@pytest.mark.gl
@pytest.mark.usefixtures("egl")
def test_the_command_writes_the_table(tmp_path: Path) -> None:
    run = CliRunner().invoke(cli, ["onnx", "precision", "gather", "--json", str(tmp_path / "rows.json")])
    assert run.exit_code == 0, run.output
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert run.stdout.count("\n| ") == len(rows) + 1
    assert {row["variant"] for row in rows} == {HALF, LIGHT_ONLY}
    assert {"cornell-box", "room", "outdoor"} <= {row["inputs"] for row in rows}
