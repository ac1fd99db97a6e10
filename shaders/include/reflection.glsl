// What all passes of reflections agree on.
#include "ray_share.glsl"

// Whether two points show one surface:
const float PLANE_TOLERANCE = 0.01;    // of depth_scale, of one from the other's plane
const float SAME_NORMAL = 0.9;         // cosine
const float ROUGHNESS_SIGMA = 0.1;     // of the weight by the difference of their roughness

// Whether a surface reflects mostly by its specular lobe, so that the light it sends to the eye says little about others.
bool is_metallic(vec3 albedo, vec3 f0)
{
    return max(max(f0.r, f0.g), f0.b) > max(max(albedo.r, albedo.g), albedo.b);
}

// Texels of a grid of that ratio that a lobe of slope alpha spreads over: its width at the end of a ray, seen from as far as its
// image is. reach: the ray's length over the depth where it starts.
float lobe_texels(float reach, float roughness, float depth, vec2 ratio)
{
    float texels = reach / (1.0 + reach) * roughness * roughness * image.y / (2.0 * lens.y * ratio.y);
#ifdef ORTHOGRAPHIC
    texels *= depth;
#endif
    return texels;
}
