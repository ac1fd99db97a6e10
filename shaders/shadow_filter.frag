// Averages what shadow rays found over 3x3 texels, a distance apart, that show one surface and differ by no more than
// their noise. Shadowed and unshadowed light are averaged alike, and only their ratio is used (Heitz, Hill and McGuire 2018,
// "Combining Analytic Direct Illumination and Stochastic Shadows"). Two passes, at distances 1 and 3, average 9x9 texels.
#include "numbers.glsl"
#include "grid.glsl"
#include "nearest_texel.glsl"

const float NOISE_SIGMAS = 3.0;      // of the difference of two texels, by which noise may part them
const float PLANE_TOLERANCE = 0.01;  // of the receiver's depth_scale
const float MIN_COSINE = 0.9;        // between normals

uniform sampler2D shadow_visible;     // rgb: mean irradiance of the samples that reach their light, a: samples
uniform sampler2D shadow_unshadowed;  // rgb: mean irradiance of all samples
uniform sampler2D lowres_gbuffer;
uniform vec2 ratio;   // full-resolution texels per low-resolution texel
uniform int spacing;  // texels

#ifdef WRITE_SHADOW_RATIO
layout(location = WRITE_SHADOW_RATIO) out vec4 out_shadow_ratio;  // a: 0 where no unshadowed light arrives
#else
layout(location = 0) out vec4 out_visible;
layout(location = 1) out vec4 out_unshadowed;
#endif

struct Texel {
    vec4 visible;
    vec4 unshadowed;
    vec4 surface;  // normal, depth
    vec3 p;        // relative space
    float share;   // of the light that is visible
    float variance;  // of that share
};

Texel texel_at(ivec2 low)
{
    Texel t;
    t.visible = texelFetch(shadow_visible, low, 0);
    t.unshadowed = texelFetch(shadow_unshadowed, low, 0);
    t.surface = texelFetch(lowres_gbuffer, low, 0);
    t.p = surface_point(vec2(nearest_texel(low, ratio)) + 0.5, t.surface.a);
    t.share = dot(t.visible.rgb, vec3(1.0)) / max(dot(t.unshadowed.rgb, vec3(1.0)), 1e-30);
    // By Laplace's rule of succession, so that a few samples that agree don't count as certain.
    float share = (t.share * t.visible.a + 1.0) / (t.visible.a + 2.0);
    t.variance = share * (1.0 - share) / max(t.visible.a, 1.0);
    return t;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy), last = textureSize(lowres_gbuffer, 0) - 1;
    Texel here = texel_at(low);
    vec4 visible = vec4(0.0), unshadowed = vec4(0.0);
    for (int i = 0; i < 9; ++i) {
        ivec2 at = low + spacing * (ivec2(i % 3, i / 3) - 1);
        Texel t = texel_at(clamp(at, ivec2(0), last));
        float away = dot(here.surface.xyz, t.p - here.p), differs = t.share - here.share;
        bool alike = t.surface.a > 0.0 && abs(away) <= PLANE_TOLERANCE * depth_scale(here.surface.a)
            && dot(here.surface.xyz, t.surface.xyz) >= MIN_COSINE
            && (differs * differs <= NOISE_SIGMAS * NOISE_SIGMAS * (here.variance + t.variance)
                || dot(here.unshadowed.rgb, vec3(1.0)) <= 0.0)
            && at == clamp(at, ivec2(0), last) && is_finite(t.share);
        visible += alike ? vec4(t.visible.rgb, 1.0) * t.visible.a : vec4(0.0);
        unshadowed += alike ? vec4(t.unshadowed.rgb, 1.0) * t.visible.a : vec4(0.0);
    }
    visible.rgb /= max(visible.a, 1e-30);
    unshadowed.rgb /= max(unshadowed.a, 1e-30);
#ifdef WRITE_SHADOW_RATIO
    vec3 share = clamp(visible.rgb / max(unshadowed.rgb, 1e-30), 0.0, 1.0);
    float all_light = max(max(unshadowed.r, unshadowed.g), unshadowed.b);
    out_shadow_ratio = vec4(unshadowed.r > 0.0 ? share.r : 1.0, unshadowed.g > 0.0 ? share.g : 1.0,
                            unshadowed.b > 0.0 ? share.b : 1.0, all_light > 0.0 ? 1.0 : 0.0);
#else
    out_visible = visible;
    out_unshadowed = unshadowed;
#endif
}
