// Which surfaces reflect light by rays; app/raycast/onward_rays.py has the same constants for those that go on.
#include "specular_albedo.glsl"

const float FULL_RAY_ROUGHNESS = 0.4;  // perceptual; up to here reflections are traced,
const float MAX_RAY_ROUGHNESS = 0.6;   // from here on they are the diffuse light that arrives
// Specular albedo of a ray's end, between which more and more of what it mirrors is traced:
const float MIN_MIRRORED = 0.05, FULL_MIRRORED = 0.15;
const float SHARP_ROUGHNESS = 0.1, BROAD_ROUGHNESS = 0.3;    // perceptual, between which less and less of it is,
const float SHARP_HIGHLIGHT = 0.05, BROAD_HIGHLIGHT = 0.15;  // and of light of lamps

// Share of a surface's reflections that is traced. A roughness that is no number counts as 1.
float ray_share(float roughness)
{
    return is_finite(roughness) ? 1.0 - smoothstep(FULL_RAY_ROUGHNESS, MAX_RAY_ROUGHNESS, roughness) : 0.0;
}

// Share of what a surface reflects towards a viewer at cosine n_v that is no diffuse light in a mirror, since rays go on from it.
float onward_share(vec3 f0, float roughness, float n_v)
{
    vec3 mirrored = specular_albedo(f0, roughness, n_v);
    float sharpness = is_finite(roughness) ? 1.0 - smoothstep(SHARP_ROUGHNESS, BROAD_ROUGHNESS, roughness) : 0.0;
    return smoothstep(MIN_MIRRORED, FULL_MIRRORED, max(max(mirrored.r, mirrored.g), mirrored.b)) * sharpness;
}
