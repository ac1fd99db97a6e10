"""The fit of the specular albedo: against quadrature, in the shader as in Python, and never more than arrives."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from app.paths import shader_dir
from app.specular_albedo import ALBEDO, FRESNEL, MIN_ALPHA, MIN_COSINE, lobe_albedo, lobe_fresnel, specular_albedo
from tests.gl.closed_forms import ggx_albedo, ggx_compensation

# Hardly any of them is a cell of the fit.
ROUGHNESSES = (0.0, 0.11, 0.23, 0.37, 0.53, 0.71, 0.89, 1.0)
COSINES = (0.003, 0.02, 0.07, 0.15, 0.31, 0.52, 0.77, 0.96, 1.0)


@pytest.fixture(scope="module")
def fit() -> ModuleType:
    file = Path(__file__).parents[2] / "scripts" / "fit_specular_albedo.py"
    spec = importlib.util.spec_from_file_location("fit_specular_albedo", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fit_specular_albedo"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("roughness", ROUGHNESSES)
@pytest.mark.parametrize("n_v", COSINES)
def test_the_fit_is_near_quadrature(fit: ModuleType, roughness: float, n_v: float) -> None:
    albedo, fresnel = fit.lobe_albedo(n_v, roughness, 400)
    alpha = max(roughness**2, MIN_ALPHA)
    assert lobe_albedo(alpha, n_v) == pytest.approx(albedo, rel=0.009)
    assert albedo * lobe_fresnel(roughness, alpha, n_v) == pytest.approx(albedo * fresnel, abs=0.008)


@pytest.mark.parametrize("roughness", [0.4, 0.7, 1.0])
def test_the_quadrature_is_that_over_half_vectors(fit: ModuleType, roughness: float) -> None:
    """Two independent ones: over visible microfacets, and over all."""
    for n_v in (0.1, 0.5, 1.0):
        albedo, fresnel = fit.lobe_albedo(n_v, roughness, 400)
        assert albedo == pytest.approx(ggx_albedo(roughness**2, n_v), rel=2e-3)
        assert albedo * fresnel == pytest.approx(ggx_albedo(roughness**2, n_v, schlick=True), abs=1e-3)


def test_the_shader_has_the_same_constants() -> None:
    source = (shader_dir() / "include" / "specular_albedo.glsl").read_text("utf-8")
    for name, rows in (("ALBEDO", ALBEDO), ("FRESNEL", FRESNEL)):
        found = re.findall(rf"const vec4 {name}_\d = vec4\((.+?)\);", source)
        np.testing.assert_array_equal([[float(x) for x in row.split(",")] for row in found], rows)
    assert float(re.findall(r"MIN_ALBEDO_COSINE = (\S+);", source)[0]) == MIN_COSINE


def grid() -> tuple[np.ndarray, np.ndarray]:
    roughness, n_v = np.meshgrid(np.linspace(0, 1, 101), np.linspace(0, 1, 201))
    return roughness.reshape(-1, 1).astype(np.float32), n_v.reshape(-1, 1).astype(np.float32)


@pytest.mark.parametrize("f0", [0.0, 0.04, 0.5, 0.97, 1.0])
def test_no_more_is_reflected_than_arrives(f0: float) -> None:
    """Of any roughness and angle; a perfect reflector returns all of it, F0 = 0 nothing."""
    roughness, n_v = grid()
    reflected = specular_albedo(np.full((len(n_v), 3), f0, np.float32), roughness, n_v)
    assert reflected.min() >= 0 and reflected.max() <= 1 + 1e-6
    if f0 in (0.0, 1.0):
        np.testing.assert_allclose(reflected, f0, atol=1e-6)


def test_multiple_scattering_adds_what_it_should() -> None:
    """A rough half-mirror, at an angle."""
    f0, roughness, n_v = (np.full((1, width), value, np.float32) for width, value in ((3, 0.5), (1, 0.9), (1, 0.6)))
    found = specular_albedo(f0, roughness, n_v)
    once = 0.5 * ggx_albedo(0.81, 0.6) + 0.5 * ggx_albedo(0.81, 0.6, schlick=True)
    np.testing.assert_allclose(found, once * ggx_compensation(0.5, 0.81, 0.6), rtol=0.01)
    assert found.min() > 1.2 * once
