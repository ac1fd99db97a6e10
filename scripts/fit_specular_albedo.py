"""Fit the constants of ``shaders/include/specular_albedo.glsl``: GGX's directional albedo and its mean Fresnel term.

Without a Fresnel term, the lobe of ``shaders/include/ggx_lobe.glsl`` reflects the share E of light from everywhere; the
mean of Schlick's (1 - v·h)⁵ over what it reflects is F. With t = n·v / (n·v + α), roughness r and α = r²,

    E ≈ 1 - t · Σ e_ij tⁱ αʲ,    i ≤ 4, j ≤ 3
    F ≈ (1 - n·v)⁵ / (1 + 4 α)² · Σ f_ij tⁱ rʲ,    i ≤ 2, j ≤ 3

t, because where both n·v and α are small, E and F depend on their ratio. Both fits minimise the largest error, relative
for E and times E for F. The script prints the constants, as GLSL, and the largest errors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

MIN_ALPHA = 2e-3  # as in shaders/include/ggx_lobe.glsl
MIN_COSINE = 1e-3  # of the viewing angle, as in shaders/include/ggx.glsl
ROUGHNESSES, ANGLES = 26, 36
ROUNDS = 150  # of reweighting
DIGITS = 4


def lobe_albedo(n_v: float, roughness: float, side: int = 160) -> tuple[float, float]:
    """E and F by quadrature over ``side``² visible microfacets (Heitz 2018, "Sampling the GGX Distribution of Visible
    Normals"), in which the integrand is the share of them that light leaves: masking-shadowing over masking.
    """
    alpha = max(roughness**2, MIN_ALPHA)
    view = np.array([np.sqrt(1 - n_v**2), 0.0, n_v])
    stretched = view * [alpha, alpha, 1]
    stretched /= np.linalg.norm(stretched)
    across = np.array([0.0, 1.0, 0.0])
    even = (np.arange(side) + 0.5) / side
    radius, phi = (x.ravel() for x in np.meshgrid(np.sqrt(even), 2 * np.pi * even, indexing="ij"))
    a, share = radius * np.cos(phi), (1 + stretched[2]) / 2
    b = (1 - share) * np.sqrt(1 - a**2) + share * radius * np.sin(phi)
    up = np.sqrt(np.maximum(1 - a**2 - b**2, 0))
    half = a[:, None] * across + b[:, None] * np.cross(stretched, across) + up[:, None] * stretched
    half *= [alpha, alpha, 1]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    v_h = half @ view
    n_l = np.maximum(2 * v_h * half[:, 2] - n_v, 0)

    def widen(cosine: F64 | float) -> F64:
        return np.sqrt(alpha**2 + (1 - alpha**2) * np.square(cosine))

    leaves = n_l * (n_v + widen(n_v)) / np.maximum(n_l * widen(n_v) + n_v * widen(n_l), 1e-300)
    albedo = leaves.mean()
    return float(albedo), float((leaves * np.clip(1 - v_h, 0, 1)**5).mean() / albedo)


def fit_minimax(columns: F64, values: F64, scale: F64) -> F64:
    """Coefficients with the least largest |columns · c - values| · scale, by iteratively reweighted least squares."""
    weight, least = np.ones_like(values), np.inf
    best: F64 = np.zeros(columns.shape[1])
    for _ in range(ROUNDS):
        root = np.sqrt(weight) * scale
        found = np.asarray(np.linalg.lstsq(columns * root[:, None], values * root)[0], np.float64)
        error = np.abs(columns @ found - values) * scale
        if error.max() < least:
            least, best = error.max(), found
        weight = weight * np.sqrt(error / error.max() + 0.05)
        weight = weight / weight.mean()
    return best


def columns_of(t: F64, y: F64, degree: int) -> F64:
    """Products tⁱ yʲ, shape (N, (degree + 1) · 4)."""
    return np.stack([t**i * y**j for i in range(degree + 1) for j in range(4)], 1)


def fit() -> tuple[F64, F64, float, float]:
    """Constants e of shape (5, 4) and f of shape (3, 4), rounded, and the largest errors of E (relative) and of E F."""
    angles = np.concatenate([[MIN_COSINE, 3e-3], np.linspace(0.08, 1, ANGLES)**2])
    cells = [(n_v, roughness) for roughness in np.linspace(0, 1, ROUGHNESSES) for n_v in angles]
    n_v, roughness = np.array(cells).T
    albedo, fresnel = np.array([lobe_albedo(*cell) for cell in cells]).T
    alpha = np.maximum(roughness**2, MIN_ALPHA)
    t = n_v / (n_v + alpha)
    e_columns = columns_of(t, alpha, 4) * t[:, None]
    e = np.round(fit_minimax(e_columns, 1 - albedo, 1 / albedo), DIGITS)
    f_columns = columns_of(t, roughness, 2) * ((1 - n_v)**5 / (1 + 4 * alpha)**2)[:, None]
    f = np.round(fit_minimax(f_columns, fresnel, albedo), DIGITS)
    return (e.reshape(5, 4), f.reshape(3, 4), float(np.abs((1 - e_columns @ e) / albedo - 1).max()),
            float(np.abs((f_columns @ f - fresnel) * albedo).max()))


def main() -> None:
    e, f, albedo_error, fresnel_error = fit()
    for name, rows in (("ALBEDO", e), ("FRESNEL", f)):
        for i, row in enumerate(rows):
            print(f"const vec4 {name}_{i} = vec4({', '.join(f'{x:.{DIGITS}f}' for x in row)});")
    print(f"// largest errors: {albedo_error:.4f} of E, {fresnel_error:.4f} of E F")


if __name__ == "__main__":
    main()
