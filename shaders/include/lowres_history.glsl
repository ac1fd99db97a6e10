// Which low-resolution texels of the frame before show the surface that a low-resolution texel shows now.
#include "numbers.glsl"
#include "camera.glsl"
#include "nearest_texel.glsl"
#include "history.glsl"

const float MIN_SHARE = 0.05;  // of the texels around that must show the same surface

uniform sampler2D lowres_gbuffer;
uniform sampler2D motion;
uniform sampler2D lowres_gbuffer_prev;
uniform vec2 ratio;  // full-resolution texels per low-resolution texel
uniform bool history_valid;

// The four texels around the receiver's previous position, from the lower left to the upper right one.
struct Reprojection {
    ivec2 base;    // the lower left one
    vec4 weights;  // bilinear, 0 where the texel shows another surface
};

float history_weight(ivec2 low, vec2 away, vec3 normal, float previous, vec2 slope)
{
    vec4 surface = texelFetch(lowres_gbuffer_prev, low, 0);
    bool same = all(greaterThanEqual(low, ivec2(0))) && all(lessThan(low, textureSize(lowres_gbuffer_prev, 0)))
        && same_surface(1.0 / surface.a, previous * (1.0 + dot(slope * ratio, away)), slope,
                        surface.xyz, normal);
    return same ? (1.0 - abs(away.x)) * (1.0 - abs(away.y)) : 0.0;
}

Reprojection reproject(ivec2 low)
{
    ivec2 full = nearest_texel(low, ratio);
    vec4 surface = texelFetch(lowres_gbuffer, low, 0);
    vec3 moved = texelFetch(motion, full, 0).xyz;
    vec2 slope = plane_slope(surface.xyz, vec2(full) + 0.5, surface.a);
    float previous = 1.0 / (surface.a * moved.z);
    vec2 at = vec2(low) - moved.xy * vec2(1.0, -1.0) / ratio, f = fract(at);
    ivec2 base = ivec2(floor(at));
    vec4 weights = vec4(history_weight(base, -f, surface.xyz, previous, slope),
                        history_weight(base + ivec2(1, 0), vec2(1.0, 0.0) - f, surface.xyz, previous, slope),
                        history_weight(base + ivec2(0, 1), vec2(0.0, 1.0) - f, surface.xyz, previous, slope),
                        history_weight(base + ivec2(1, 1), vec2(1.0, 1.0) - f, surface.xyz, previous, slope));
    return Reprojection(base, history_valid ? weights : vec4(0.0));
}
