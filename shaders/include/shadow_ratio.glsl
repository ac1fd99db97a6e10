// The share of traced light that reaches a receiver, from the grid that shadow rays were traced on.
#include "numbers.glsl"
#include "joint_bilateral.glsl"
#ifdef FAST_PATH
#include "quad_taps.glsl"
#endif

uniform sampler2D shadow_ratio;  // rgb: share, a: 1 plus that of specular light, 0 where no unshadowed light arrives
#ifdef HAS_SHADOW_GBUFFER
uniform sampler2D shadow_gbuffer;  // normal, depth
uniform vec2 shadow_grid_ratio;    // full-resolution texels per texel of shadow_ratio

#ifdef WIDE_SHADOW_RATIO
const int WIDE_TAPS = 16;
const float WIDE_RADIUS = 12.0;  // texels of shadow_ratio

// For receivers that no ray was traced from: the mean around, since the share at the receiver's own texel is that of
// what is behind it, whose outline would show. Where nothing is behind, all light counts as visible.
vec3 traced_visibility(vec3 n, float depth, bool is_reached)
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

// The shares of diffuse and of specular light at one low-resolution texel, weighted by how much of the receiver's surface it
// shows.
vec4 shadow_tap(ivec2 low, BilateralReceiver r, out float specular)
{
    low = clamp(low, ivec2(0), textureSize(shadow_gbuffer, 0) - 1);
    vec2 along = along_normal(low, shadow_grid_ratio, r);
    vec4 surface = texelFetch(shadow_gbuffer, low, 0), share = texelFetch(shadow_ratio, low, 0);
    float weight = surface.a > 0.0 && share.a > 0.0 ? similarity(surface, along.x + along.y, r) : 0.0;
    specular = weight > 0.0 ? (share.a - 1.0) * weight : 0.0;
    return vec4(share.rgb, 1.0) * weight;
}

vec3 share_of(vec4 sum)
{
    return clamp(sanitize_radiance(sum.rgb / sum.a), 0.0, 1.0);
}

#ifdef FAST_PATH
// Interpolates the four texels around a quad that shows one plane, where these show it too and know.
vec3 traced_visibility(vec3 n, float depth, bool is_reached, out float specular, out bool is_known)
{
    BilateralReceiver r = bilateral_receiver(gl_FragCoord.xy, n, depth);
    QuadTap t = quad_tap(textureSize(shadow_gbuffer, 0), shadow_grid_ratio);
    float tap;
    vec4 sum = interpolate_taps(shadow_tap(t.low, r, tap), t.closeness);
    specular = clamp(interpolate_taps(vec4(tap), t.closeness).x / sum.a, 0.0, 1.0);
    is_known = t.is_inside && shows_plane_of_quad(r) && sum.a > 0.0;
    return share_of(sum);
}
#else
// Interpolates four texels. Where none of them shows a surface that gets light, as at a wire before the sky, those around
// them may. The share of specular light is known where specular rays are traced.
vec3 traced_visibility(vec3 n, float depth, bool is_reached, out float specular)
{
    BilateralReceiver r = bilateral_receiver(gl_FragCoord.xy, n, depth);
    vec2 at = gl_FragCoord.xy / shadow_grid_ratio - 0.5, base = floor(at), f = at - base;
    vec4 sum = vec4(0.0);
    float specular_sum = 0.0;
    int i = 0, most = is_reached ? TAPS_AROUND : 1;
    do {
        int wider = max(i - 4, 0);
        vec2 corner = i < 4 ? vec2(i & 1, i >> 1) : vec2(wider & 3, wider >> 2) - 1.0;
        vec2 closeness = i < 4 ? mix(1.0 - f, f, corner) : vec2(1.0);
        float weight = closeness.x * closeness.y, tap;
        sum += shadow_tap(ivec2(base + corner), r, tap) * weight;
        specular_sum += tap * weight;
    } while (++i < min(most, 4) || (i < most && (i > 4 || sum.a <= 0.0)));
    specular = sum.a > 0.0 ? clamp(specular_sum / sum.a, 0.0, 1.0) : 1.0;
    return sum.a > 0.0 ? share_of(sum) : vec3(1.0);
}

vec3 traced_visibility(vec3 n, float depth, bool is_reached)
{
    float specular;
    return traced_visibility(n, depth, is_reached, specular);
}
#endif
#endif
#else
// The grid is that of the receivers.
vec3 traced_visibility(vec3 n, float depth, bool is_reached)
{
    return clamp(sanitize_radiance(texelFetch(shadow_ratio, ivec2(gl_FragCoord.xy), 0).rgb), 0.0, 1.0);
}
#endif
