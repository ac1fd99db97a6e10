// Accumulates what shadow rays found over frames: each texel follows its surface by motion and adds its samples to those
// of its history.
#include "lowres_history.glsl"

uniform sampler2D shadow_visible_now;     // rgb: mean irradiance of the samples that reach their light, a: samples
uniform sampler2D shadow_unshadowed_now;  // rgb: mean irradiance of all samples
uniform sampler2D shadow_visible_prev;
uniform sampler2D shadow_unshadowed_prev;
uniform float max_samples;  // of history
#ifdef HAS_SHADOW_SPECULAR_NOW
uniform sampler2D shadow_specular_now;  // mean luminance that specular rays would see of rectangles: that reaches them; all
uniform sampler2D shadow_specular_prev;
uniform float max_specular_samples;     // of history, which follows surfaces and not what they mirror
#endif

layout(location = 0) out vec4 out_shadow_visible;
layout(location = 1) out vec4 out_shadow_unshadowed;
#ifdef HAS_SHADOW_SPECULAR_NOW
layout(location = 2) out vec2 out_shadow_specular;

vec2 specular_before(ivec2 low, float closeness)
{
    vec2 old = texelFetch(shadow_specular_prev, low, 0).rg;
    return closeness > 0.0 && is_finite(old.x + old.y) ? max(old, 0.0) * closeness : vec2(0.0);
}
#endif

void add(ivec2 low, float closeness, inout vec4 visible, inout vec4 unshadowed, inout float weight)
{
    vec4 old_visible = texelFetch(shadow_visible_prev, low, 0), old_unshadowed = texelFetch(shadow_unshadowed_prev, low, 0);
    bool healthy = closeness > 0.0 && is_finite(dot(old_visible + old_unshadowed, vec4(1.0))) && old_visible.a >= 1.0;
    visible += healthy ? max(old_visible, 0.0) * closeness : vec4(0.0);
    unshadowed += healthy ? max(old_unshadowed, 0.0) * closeness : vec4(0.0);
    weight += healthy ? closeness : 0.0;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
    vec4 visible_now = texelFetch(shadow_visible_now, low, 0), unshadowed_now = texelFetch(shadow_unshadowed_now, low, 0);
    bool healthy_now = is_finite(dot(visible_now + unshadowed_now, vec4(1.0))) && visible_now.a >= 1.0;
    visible_now = healthy_now ? max(visible_now, 0.0) : vec4(0.0);
    unshadowed_now = healthy_now ? max(unshadowed_now, 0.0) : vec4(0.0);
    Reprojection r = reproject(low);
    vec4 visible = vec4(0.0), unshadowed = vec4(0.0);
    float weight = 0.0;
    add(r.base, r.weights.x, visible, unshadowed, weight);
    add(r.base + ivec2(1, 0), r.weights.y, visible, unshadowed, weight);
    add(r.base + ivec2(0, 1), r.weights.z, visible, unshadowed, weight);
    add(r.base + ivec2(1, 1), r.weights.w, visible, unshadowed, weight);
    bool keep = weight > MIN_SHARE;
    float before = keep ? min(visible.a, max(max_samples - visible_now.a, 0.0)) : 0.0;  // samples, fewer where few texels agree
    float samples = max(before + visible_now.a, 1.0);
    float share = visible_now.a / samples;
    weight = max(weight, 1e-6);
    out_shadow_visible = vec4(mix(visible.rgb / weight, visible_now.rgb, share), samples);
    out_shadow_unshadowed = vec4(mix(unshadowed.rgb / weight, unshadowed_now.rgb, share), samples);
#ifdef HAS_SHADOW_SPECULAR_NOW
    vec2 now = texelFetch(shadow_specular_now, low, 0).rg;
    vec2 old = specular_before(r.base, r.weights.x) + specular_before(r.base + ivec2(1, 0), r.weights.y)
        + specular_before(r.base + ivec2(0, 1), r.weights.z) + specular_before(r.base + ivec2(1, 1), r.weights.w);
    float specular_share = keep ? min(max(share, visible_now.a / max_specular_samples), 1.0) : 1.0;
    out_shadow_specular = mix(old / weight, healthy_now && is_finite(now.x + now.y) ? max(now, 0.0) : vec2(0.0), specular_share);
#endif
}
