// Joint bilateral upsampling (Kopf et al. 2007) from a low-resolution grid, guided by full-resolution normals and by the
// distance from the receiver's plane (Xin et al. 2021, section 5.3).
#include "camera.glsl"
#include "nearest_texel.glsl"

const float PLANE_SIGMA = 0.02;  // of the receiver's depth_scale
const float SHOWN = 0.1;         // weight of the texels around above which they show the receiver's surface
const float MIN_WEIGHT = 1e-5;   // so that the most similar texel counts where none is on the same surface

struct BilateralReceiver {
    vec3 normal;  // relative space
    vec3 slope;   // (x, y, 1) of an image position times this, times depth, is the distance along the normal; if
                  // ORTHOGRAPHIC, (x, y, depth) times this is
    float here;   // that distance of the receiver itself
    float inverse_sigma;
};

// Image position in [-1, 1] without jitter.
vec2 image_position(vec2 pixel)
{
    return pixel * (2.0 * image.zw) - (1.0 + lens.zw);
}

// What column and row of a texel contribute to its distance along the normal: per unit of depth, unless ORTHOGRAPHIC.
vec2 along_normal(ivec2 texel, BilateralReceiver r)
{
    return r.slope.xy * image_position(vec2(texel) + 0.5);
}

// The same of a low-resolution texel.
vec2 along_normal(ivec2 low, vec2 ratio, BilateralReceiver r)
{
    return along_normal(nearest_texel(low, ratio), r);
}

BilateralReceiver bilateral_receiver(vec2 pixel, vec3 normal, float depth)
{
    vec3 slope = mat3(view_from_relative) * normal * vec3(lens.xy, -1.0);
#ifdef ORTHOGRAPHIC
    float here = dot(slope, vec3(image_position(pixel), depth));
#else
    float here = dot(slope, vec3(image_position(pixel), 1.0)) * depth;
#endif
    return BilateralReceiver(normal, slope, here, 1.0 / (PLANE_SIGMA * depth_scale(depth)));
}

// How much a low-resolution texel's surface (normal, depth) is the receiver's; along: sum of along_normal's parts.
float similarity(vec4 surface, float along, BilateralReceiver r)
{
#ifdef ORTHOGRAPHIC
    float plane = (along + r.slope.z * surface.a - r.here) * r.inverse_sigma;
#else
    float plane = ((along + r.slope.z) * surface.a - r.here) * r.inverse_sigma;
#endif
    float facing = max(dot(r.normal, surface.xyz), 0.0);
    facing *= facing;
    facing *= facing;
    return (facing * facing + MIN_WEIGHT) / (1.0 + plane * plane);
}

// The four low-resolution texels around the receiver, from its lower left to its upper right one: x, y of the first and
// the last, what their columns and rows contribute along the normal, and bilinear weights.
struct Around {
    ivec2 low;
    ivec2 high;
    vec2 along_low;
    vec2 along_high;
    vec2 f;
};

Around texels_around(vec2 pixel, ivec2 size, vec2 ratio, BilateralReceiver r)
{
    vec2 at = pixel / ratio - 0.5;
    ivec2 base = ivec2(floor(at)), low = clamp(base, ivec2(0), size - 1), high = clamp(base + 1, ivec2(0), size - 1);
    return Around(low, high, along_normal(low, ratio, r), along_normal(high, ratio, r), fract(at));
}
