// What all passes of reflections agree on.
#include "ray_share.glsl"

// Whether two points show one surface:
const float PLANE_TOLERANCE = 0.01;    // of depth_scale, of one from the other's plane
const float SAME_NORMAL = 0.9;         // cosine
const float ROUGHNESS_SIGMA = 0.1;     // of the weight by the difference of their roughness
// For the length of a ray: the screen does not show its end; nor that of one of a sharp image.
const float NOT_SHOWN = -1.0, SHARP_NOT_SHOWN = -2.0;
// Where images in a surface are sharp, and where blurred: by its roughness, and by the spread of its lobe in texels of a grid.
const float SHARP = 0.1, BLURRED = 0.25, NARROW = 1.5, WIDE = 3.0;
const float FAR_REACH = 1e4;           // reach of what is far away
// Spread of lobes in texels of a grid, of which single rays show points, and noise.
const float SHARP_SPREAD = 0.25, NOISY_SPREAD = 1.0;

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

// From 0 for a sharp image to 1 for a blurred one, of which few rays meet a window. reach and ratio as above.
float image_blur(float reach, float roughness, float depth, vec2 ratio)
{
    return max(smoothstep(SHARP, BLURRED, roughness), smoothstep(NARROW, WIDE, lobe_texels(reach, roughness, depth, ratio)));
}

// From 1 for a mirror to 0 where single rays of the lobe are noise in an image of the pixels' resolution, however far they go.
float image_sharpness(float roughness, float depth, vec2 ratio)
{
    return 1.0 - smoothstep(SHARP_SPREAD, NOISY_SPREAD, lobe_texels(FAR_REACH, roughness, depth, ratio));
}
