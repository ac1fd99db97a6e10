// The lobe of a rough surface's reflections.
#include "numbers.glsl"

const float MIN_ALPHA = 2e-3;  // for smaller ones q would be little but its rounding, 1e-7; for 0 the lobe is 0 / 0

// Trowbridge-Reitz distribution times height-correlated Smith visibility (Heitz 2014).
float ggx_lobe(float n_h, float n_v, float n_l, float alpha)
{
    float a2 = alpha * alpha;
    float q = n_h * n_h * (a2 - 1.0) + 1.0;
    float smith = n_l * sqrt(n_v * n_v * (1.0 - a2) + a2) + n_v * sqrt(n_l * n_l * (1.0 - a2) + a2);
    return a2 / (PI * q * q) * 0.5 / max(smith, 1e-6);
}
