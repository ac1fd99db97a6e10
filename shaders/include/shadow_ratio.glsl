// The share of traced light that reaches a receiver, from the grid that shadow rays were traced on.
#include "numbers.glsl"
#include "joint_bilateral.glsl"
#include "quad.glsl"

uniform sampler2D shadow_ratio;  // rgb: share, a: 0 where no unshadowed light arrives
#ifdef HAS_SHADOW_GBUFFER
uniform sampler2D shadow_gbuffer;  // normal, depth
uniform vec2 shadow_grid_ratio;    // full-resolution texels per texel of shadow_ratio

#ifdef WIDE_SHADOW_RATIO
const int WIDE_TAPS = 16;
const float WIDE_RADIUS = 12.0;  // texels of shadow_ratio

// For receivers that no ray was traced from: the mean around, since the share at the receiver's own texel is that of
// what is behind it, whose outline would show. Where nothing is behind, all light counts as visible.
vec3 traced_visibility(vec3 n, float depth, bool is_flat)
{
    vec3 sum = vec3(0.0);
    for (int i = 0; i < WIDE_TAPS; ++i) {
        float angle = 2.39996323 * float(i), radius = WIDE_RADIUS * sqrt((float(i) + 0.5) / float(WIDE_TAPS));
        vec2 at = gl_FragCoord.xy / shadow_grid_ratio + radius * vec2(cos(angle), sin(angle));
        ivec2 low = clamp(ivec2(floor(at)), ivec2(0), textureSize(shadow_gbuffer, 0) - 1);
        vec4 share = texelFetch(shadow_ratio, low, 0);
        bool is_known = texelFetch(shadow_gbuffer, low, 0).a > 0.0 && share.a > 0.0;
        sum += is_known ? clamp(sanitize_radiance(share.rgb), 0.0, 1.0) : vec3(1.0);
    }
    return sum / float(WIDE_TAPS);
}
#else
const int TAPS_AROUND = 20;  // the four texels around, and if none of them will do, the sixteen around these

// The share at one low-resolution texel, weighted by how much of the receiver's surface it shows.
vec4 shadow_tap(ivec2 low, BilateralReceiver r)
{
    low = clamp(low, ivec2(0), textureSize(shadow_gbuffer, 0) - 1);
    vec2 along = along_normal(low, shadow_grid_ratio, r);
    vec4 surface = texelFetch(shadow_gbuffer, low, 0), share = texelFetch(shadow_ratio, low, 0);
    float weight = surface.a > 0.0 && share.a > 0.0 ? similarity(surface, along.x + along.y, r) : 0.0;
    return vec4(share.rgb, 1.0) * weight;
}

// Interpolates four texels. Those of a quad that shows one surface and lies between the same four fetch one each.
vec3 traced_visibility(vec3 n, float depth, bool is_flat)
{
    BilateralReceiver r = bilateral_receiver(gl_FragCoord.xy, n, depth);
    vec2 at = gl_FragCoord.xy / shadow_grid_ratio - 0.5, base = floor(at), f = at - base;
    vec2 middle = floor(at + 0.5 * quad_side() / shadow_grid_ratio);
    bool is_shared = quad_all(is_flat && base == middle);
    int lane = int(quad_lane()), i = 0, least = is_shared ? 1 : 4, most = is_surface(depth) ? TAPS_AROUND : 1;
    vec4 sum = vec4(0.0), shared_tap = vec4(0.0);
    // Where none of them shows a surface that gets light, as at a wire before the sky, those around them may.
    do {
        int index = is_shared && i == 0 ? lane : i, wider = max(index - 4, 0);
        vec2 corner = index < 4 ? vec2(index & 1, index >> 1) : vec2(wider & 3, wider >> 2) - 1.0;
        vec2 closeness = index < 4 ? mix(1.0 - f, f, corner) : vec2(1.0);
        vec4 tap = shadow_tap(ivec2(base + corner), r);
        shared_tap = i == 0 ? tap : shared_tap;
        sum += tap * (closeness.x * closeness.y);
    } while (++i < least || (i < most && (i > 4 || sum.a <= 0.0)));
    vec2 own = mix(f, 1.0 - f, 0.5 + 0.5 * quad_side());  // closeness of the tap of the texel's own lane
    vec4 row = mix(quad_swap_x(shared_tap), shared_tap, own.x);
    row = mix(quad_swap_y(row), row, own.y);
    sum = is_shared && row.a > 0.0 ? row : sum;
    return sum.a > 0.0 ? clamp(sanitize_radiance(sum.rgb / sum.a), 0.0, 1.0) : vec3(1.0);
}
#endif
#else
// The grid is that of the receivers.
vec3 traced_visibility(vec3 n, float depth, bool is_flat)
{
    return clamp(sanitize_radiance(texelFetch(shadow_ratio, ivec2(gl_FragCoord.xy), 0).rgb), 0.0, 1.0);
}
#endif
