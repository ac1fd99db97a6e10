// Accumulates what shadow rays found over frames: each texel follows its surface by motion and adds its samples to those
// of its history.
#include "lowres_history.glsl"

uniform sampler2D shadow_visible_now;     // rgb: mean irradiance of the samples that reach their light, a: samples
uniform sampler2D shadow_unshadowed_now;  // rgb: mean irradiance of all samples, a: mean square of the visible share of one
uniform sampler2D shadow_visible_prev;
uniform sampler2D shadow_unshadowed_prev;   // a: mean square of the visible share of one sample
uniform float max_samples;  // of history
#ifdef HAS_SHADOW_SPECULAR_NOW
uniform sampler2D shadow_specular_now;    // r: mean luminance of the rectangles that specular rays reach, g: of all of them,
                                          // b: its mean square, a: number of these rays
uniform sampler2D shadow_specular_prev;
uniform float max_specular_samples;     // of history, which follows surfaces and not what they mirror
#endif

layout(location = 0) out vec4 out_shadow_visible;
layout(location = 1) out vec4 out_shadow_unshadowed;
#ifdef HAS_SHADOW_SPECULAR_NOW
layout(location = 2) out vec4 out_shadow_specular;
#endif

struct Sums {
    vec4 visible;
    vec4 unshadowed;
    vec4 specular;
    float weight;
};

void add(ivec2 low, float closeness, inout Sums sums)
{
    vec4 visible = texelFetch(shadow_visible_prev, low, 0), unshadowed = texelFetch(shadow_unshadowed_prev, low, 0);
    vec4 specular = vec4(0.0);
#ifdef HAS_SHADOW_SPECULAR_NOW
    specular = texelFetch(shadow_specular_prev, low, 0);
#endif
    bool healthy = closeness > 0.0 && is_finite(dot(visible + unshadowed + specular, vec4(1.0))) && visible.a >= 1.0;
    sums.visible += healthy ? max(visible, 0.0) * closeness : vec4(0.0);
    sums.unshadowed += healthy ? max(unshadowed, 0.0) * closeness : vec4(0.0);
    sums.specular += healthy ? max(specular, 0.0) * vec4(vec3(specular.a), 1.0) * closeness : vec4(0.0);
    sums.weight += healthy ? closeness : 0.0;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
    vec4 visible_now = texelFetch(shadow_visible_now, low, 0), unshadowed_now = texelFetch(shadow_unshadowed_now, low, 0);
    bool healthy_now = is_finite(dot(visible_now + unshadowed_now, vec4(1.0))) && visible_now.a >= 1.0;
    visible_now = healthy_now ? max(visible_now, 0.0) : vec4(0.0);
    unshadowed_now = healthy_now ? max(unshadowed_now, 0.0) : vec4(0.0);
    Reprojection r = reproject(low);
    Sums old = Sums(vec4(0.0), vec4(0.0), vec4(0.0), 0.0);
    add(r.base, r.weights.x, old);
    add(r.base + ivec2(1, 0), r.weights.y, old);
    add(r.base + ivec2(0, 1), r.weights.z, old);
    add(r.base + ivec2(1, 1), r.weights.w, old);
    bool keep = old.weight > MIN_SHARE;
    float weight = max(old.weight, 1e-6);
    vec3 visible_before = old.visible.rgb / weight;
    vec4 unshadowed_before = old.unshadowed / weight;
    // Samples, fewer where few texels agree.
    float before = keep ? min(old.visible.a, max(max_samples - visible_now.a, 0.0)) : 0.0, samples = before + visible_now.a;
    float share = visible_now.a / max(samples, 1e-6);
    out_shadow_visible = vec4(mix(visible_before, visible_now.rgb, share), samples);
    out_shadow_unshadowed = mix(unshadowed_before, unshadowed_now, share);
#ifdef HAS_SHADOW_SPECULAR_NOW
    vec4 now = texelFetch(shadow_specular_now, low, 0);
    now = is_finite(dot(now, vec4(1.0))) ? max(now, 0.0) : vec4(0.0);
    float rays = keep ? min(old.specular.a, max(max_specular_samples - now.a, 0.0)) : 0.0;
    vec3 light = old.specular.rgb / max(old.specular.a, 1e-6) * rays + now.rgb * now.a;
    out_shadow_specular = vec4(light / max(rays + now.a, 1e-6), rays + now.a);
#endif
}
