"""The committed table of specular lobes is what ``scripts/fit_ltc.py`` fits."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from app.paths import data_dir, shader_dir

SCRIPT = Path(__file__).parents[2] / "scripts" / "fit_ltc.py"


@pytest.fixture(scope="module")
def fit_ltc() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fit_ltc", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fit_ltc"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def texels() -> np.ndarray:
    return np.load(data_dir() / "ltc.npy")


@pytest.mark.parametrize("cell", [(4, 9), (9, 16), (14, 7), (6, 21)])  # of the last sweep, after which none changed
def test_the_fit_gives_the_committed_cell(fit_ltc: ModuleType, texels: np.ndarray, cell: tuple[int, int]) -> None:
    table = fit_ltc.unpack(texels)
    target = fit_ltc.mean_of_neighbours(table, cell)
    used = slice(15 if cell[1] > fit_ltc.LAST_TWO_LOBED else 10)
    for start in (table[cell], table[cell] + np.tile([0.1, 0.1, 0.1, 0.0, 0.0], 3)):
        np.testing.assert_allclose(fit_ltc.fit_cell(cell, start, target)[used], table[cell][used], atol=0.01)


@pytest.mark.parametrize("cell", [(3, 26), (10, 28), (17, 27)])
def test_the_refinement_gives_the_committed_cell(fit_ltc: ModuleType, texels: np.ndarray,
                                                 cell: tuple[int, int]) -> None:
    """Begun at other parameters, between neighbours that stay. Errors are small, also where it is interpolated."""
    committed = fit_ltc.without_logarithms(fit_ltc.unpack(texels))
    begun = committed.copy()
    begun[cell[0] * fit_ltc.ANGLES + cell[1]] *= 1.2
    refinement = fit_ltc.Refinement([cell])
    found = refinement.refine(begun)
    np.testing.assert_allclose(found, committed, rtol=0.01, atol=0.02)
    errors = refinement.errors(committed)
    assert np.abs(errors).max() < 0.065 and np.sqrt((errors**2).mean()) < 0.012  # the largest are of small panes


def test_a_third_lobe_is_only_where_the_shader_looks_for_it(fit_ltc: ModuleType, texels: np.ndarray) -> None:
    table = fit_ltc.unpack(texels)
    assert f"LAST_TWO_LOBED = {fit_ltc.LAST_TWO_LOBED};" in (shader_dir() / "include" / "ltc.glsl").read_text("utf-8")
    assert not table[:, :fit_ltc.LAST_TWO_LOBED + 1, 13:].any()
    assert table[:, fit_ltc.LAST_TWO_LOBED + 1:, 13:].any(axis=2).all()


@pytest.mark.parametrize("cell", [(0, 0), (7, 15), (19, 24)])
def test_the_lobe_has_the_directional_albedo_and_the_fresnel_term(fit_ltc: ModuleType, texels: np.ndarray,
                                                                  cell: tuple[int, int]) -> None:
    parameters, view = fit_ltc.unpack(texels)[cell], fit_ltc.view_of(cell)
    light, solid_angle = fit_ltc.sample_lights(view, 300)
    albedo = fit_ltc.evaluate_ggx(view, light) @ solid_angle
    assert fit_ltc.evaluate_lobe(view, parameters, light) @ solid_angle == pytest.approx(albedo, rel=0.003)
    scale, fresnel = fit_ltc.measure_lobe(view, parameters)
    assert scale == pytest.approx(1, abs=0.003)
    assert float(texels[cell][3, 3]) == pytest.approx(fresnel, rel=3e-3, abs=1e-6)
