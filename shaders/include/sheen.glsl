// Light that fibres scatter back (Estevez and Kulla 2017, "Production Friendly Microfacet Sheen BRDF").
#include "numbers.glsl"

const float MIN_SHEEN_ROUGHNESS = 0.1;

float sheen_lambda(float c, float alpha)
{
    float x = c < 0.5 ? c : 1.0 - c, share = (1.0 - alpha) * (1.0 - alpha);
    float a = mix(21.5473, 25.3245, share), b = mix(3.82987, 3.32435, share), e = mix(0.19823, 0.16801, share);
    float slope = mix(-1.97760, -1.27393, share), rest = mix(-4.32054, -4.85967, share);
    float middle = a / (1.0 + b * pow(0.5, e)) + slope * 0.5 + rest, at_x = a / (1.0 + b * pow(x, e)) + slope * x + rest;
    return exp(c < 0.5 ? at_x : 2.0 * middle - at_x);
}

// The lobe for light from direction l, seen from direction v, without its colour.
float sheen_lobe(vec3 n, vec3 l, vec3 v, float roughness)
{
    float alpha = max(roughness, MIN_SHEEN_ROUGHNESS);
    alpha *= alpha;
    float n_l = clamp(dot(n, l), 1e-3, 1.0), n_v = clamp(dot(n, v), 1e-3, 1.0), n_h = dot(n, normalize(l + v));
    float distribution = (2.0 + 1.0 / alpha) * pow(max(1.0 - n_h * n_h, 0.0), 0.5 / alpha) / (2.0 * PI);
    return distribution / ((1.0 + sheen_lambda(n_l, alpha) + sheen_lambda(n_v, alpha)) * 4.0 * n_l * n_v);
}

// Share of light from everywhere that the lobe sends to a viewer at cosine n_v, a fit within 0.04.
float sheen_albedo(float n_v, float roughness)
{
    float s = sqrt(n_v), q = 1.0 / (max(roughness, MIN_SHEEN_ROUGHNESS) + 0.2);
    vec3 powers = vec3(1.0, s, s * s);
    vec3 by_roughness = vec3(0.885, -3.384, 1.885) + q * (vec3(-1.295, 3.503, -3.101) + q * vec3(0.419, -1.015, -0.025));
    return min(exp(dot(powers, by_roughness)), 1.0);
}
