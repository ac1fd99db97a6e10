// The share of traced light that reaches a receiver, from the grid that shadow rays were traced on.
#include "numbers.glsl"
#include "joint_bilateral.glsl"

uniform sampler2D shadow_ratio;  // rgb: share, a: 0 where no unshadowed light arrives
#ifdef HAS_SHADOW_GBUFFER
uniform sampler2D shadow_gbuffer;  // normal, depth
uniform vec2 shadow_grid_ratio;    // full-resolution texels per texel of shadow_ratio

vec4 shadow_tap(ivec2 low, float along, float closeness, BilateralReceiver r)
{
    vec4 surface = texelFetch(shadow_gbuffer, low, 0), share = texelFetch(shadow_ratio, low, 0);
    float weight = surface.a > 0.0 && share.a > 0.0 ? closeness * similarity(surface, along, r) : 0.0;
    return vec4(share.rgb, 1.0) * weight;
}

vec3 traced_visibility(vec3 n, float depth)
{
    BilateralReceiver r = bilateral_receiver(n, depth);
    Around t = texels_around(textureSize(shadow_gbuffer, 0), shadow_grid_ratio, r);
    vec2 f = t.f, g = 1.0 - f;
    vec4 sum = shadow_tap(t.low, t.along_low.x + t.along_low.y, g.x * g.y, r)
        + shadow_tap(ivec2(t.high.x, t.low.y), t.along_high.x + t.along_low.y, f.x * g.y, r)
        + shadow_tap(ivec2(t.low.x, t.high.y), t.along_low.x + t.along_high.y, g.x * f.y, r)
        + shadow_tap(t.high, t.along_high.x + t.along_high.y, f.x * f.y, r);
    // Where none of them shows a surface that gets light, as at a wire before the sky, those around them may.
    int steps = sum.a > 0.0 ? 0 : 16;
    for (int i = 0; i < steps; ++i) {
        ivec2 low = clamp(t.low + ivec2(i % 4, i / 4) - 1, ivec2(0), textureSize(shadow_gbuffer, 0) - 1);
        vec2 along = along_normal(low, shadow_grid_ratio, r);
        sum += shadow_tap(low, along.x + along.y, 1.0, r);
    }
    return sum.a > 0.0 ? clamp(sanitize_radiance(sum.rgb / sum.a), 0.0, 1.0) : vec3(1.0);
}
#else
// The grid is that of the receivers.
vec3 traced_visibility(vec3 n, float depth)
{
    return clamp(sanitize_radiance(texelFetch(shadow_ratio, ivec2(gl_FragCoord.xy), 0).rgb), 0.0, 1.0);
}
#endif
