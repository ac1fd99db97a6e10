// Averages what shadow rays found over 3x3 texels, a distance apart, that show one surface and differ by no more than
// their noise. Shadowed and unshadowed light are averaged alike, and only their ratio is used (Heitz, Hill and McGuire 2018,
// "Combining Analytic Direct Illumination and Stochastic Shadows"). Two passes, at distances 1 and 3, average 9x9 texels.
#include "numbers.glsl"
#include "grid.glsl"
#include "nearest_texel.glsl"

const float NOISE_SIGMAS = 3.0;      // of the difference of two texels, by which noise may part them
const float PLANE_TOLERANCE = 0.01;  // of the receiver's depth_scale
const float MIN_COSINE = 0.9;        // between normals
const int FEW = 1;                   // texels around that agree with an outlier,
const float RARE = 3.0;              // which has this many times the share of all of them, or just more than they have
const int MANY = 5;                  // if so many show its surface
const float HEAVY = 1.1;             // times their unshadowed light, from which on a single sample has brought it
const float MOST = 3.0;              // times the unshadowed light that a sample brings with its full weight
const float GUIDED = 1.5;             // times the share is its mean square, from which on samples have several weights
const float PRIOR = 0.5;             // specular rays whose share is taken to be that of diffuse light

uniform sampler2D shadow_visible;     // rgb: mean irradiance of the samples that reach their light, a: samples
uniform sampler2D shadow_unshadowed;  // rgb: mean irradiance of all samples, a: mean square of the visible share of one sample
uniform sampler2D lowres_gbuffer;
#ifdef SPECULAR_RAYS
uniform sampler2D shadow_specular;    // r: mean luminance of the rectangles that specular rays reach, g: of all of them,
                                      // b: its mean square, a: number of these rays
#endif
uniform vec2 ratio;   // full-resolution texels per low-resolution texel
uniform int spacing;  // texels
uniform ivec2 shift;  // of the texels around, other ones in each frame: what one of them brings would show as a square

#ifdef WRITE_SHADOW_RATIO
layout(location = WRITE_SHADOW_RATIO) out vec4 out_shadow_ratio;  // a: 1 plus the share of specular light, 0 where no unshadowed light arrives
#else
layout(location = 0) out vec4 out_visible;
layout(location = 1) out vec4 out_unshadowed;
#ifdef SPECULAR_RAYS
layout(location = 2) out vec4 out_specular;
#endif
#endif

struct Texel {
    vec4 visible;
    vec4 unshadowed;
    vec4 surface;  // normal, depth
    vec3 p;        // relative space
    float share;   // of the light that is visible
    float variance;  // of that share
    float weight;    // samples; fewer where a guided one of little probability has brought much more than the unshadowed light
#ifdef SPECULAR_RAYS
    vec4 specular;
#endif
};

// Variance of a share of samples with a mean square, by Laplace's rule of succession, so that a few samples that agree don't
// count as certain.
float variance_of(float share, float square, float samples)
{
    share = (share * samples + 1.0) / (samples + 2.0);
    square = (square * samples + 1.0) / (samples + 2.0);
    return max(square - share * share, 0.0) / max(samples, 1.0);
}

// Whether two shares differ by no more than their noise.
bool agree(float share, float other, float variance)
{
    float differs = share - other;
    return differs * differs <= NOISE_SIGMAS * NOISE_SIGMAS * variance;
}

float ratio_of(vec3 visible, vec3 unshadowed)
{
    return luminance(visible) / max(luminance(unshadowed), 1e-30);
}

float share_of(vec3 visible, vec3 unshadowed)
{
    return min(ratio_of(visible, unshadowed), 1.0);
}

Texel texel_at(ivec2 low)
{
    Texel t;
    t.visible = texelFetch(shadow_visible, low, 0);
    t.unshadowed = texelFetch(shadow_unshadowed, low, 0);
    t.surface = texelFetch(lowres_gbuffer, low, 0);
    t.p = surface_point(vec2(nearest_texel(low, ratio)) + 0.5, t.surface.a);
    t.share = share_of(t.visible.rgb, t.unshadowed.rgb);
    t.variance = variance_of(t.share, t.unshadowed.a, t.visible.a);
    t.weight = t.visible.a / max(ratio_of(t.visible.rgb, t.unshadowed.rgb) / MOST, 1.0);
#ifdef SPECULAR_RAYS
    t.specular = texelFetch(shadow_specular, low, 0);
#endif
    return t;
}

#ifdef SPECULAR_RAYS
// Variance of the share of specular light. Rays of much light count for more than others, so that the share is that of fewer.
float specular_variance(vec4 specular, float share)
{
    float equal_rays = specular.a * min(specular.g * specular.g / max(specular.b, 1e-30), 1.0);
    return variance_of(share, share, equal_rays);
}

bool is_alike_specular(Texel here, Texel t)
{
    vec2 seen = vec2(here.specular.r, t.specular.r) / max(vec2(here.specular.g, t.specular.g), 1e-30);
    return is_finite(dot(t.specular, vec4(1.0))) && (here.specular.a <= 0.0 || agree(
        seen.x, seen.y, specular_variance(here.specular, seen.x) + specular_variance(t.specular, seen.y)));
}
#endif

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy), last = textureSize(lowres_gbuffer, 0) - 1;
    Texel here = texel_at(low);
    vec4 visible = vec4(0.0), unshadowed = vec4(0.0), all_visible = vec4(0.0), all_unshadowed = vec4(0.0);
    float square = 0.0, all_square = 0.0;
    int surface_count = -1, alike_count = -1;  // without the texel itself
#ifdef SPECULAR_RAYS
    vec4 specular = vec4(0.0);
#endif
    for (int i = 0; i < 9; ++i) {
        ivec2 at = i == 4 ? low : low + spacing * (ivec2(i % 3, i / 3) - 1) + shift;
        Texel t = texel_at(clamp(at, ivec2(0), last));
        float away = dot(here.surface.xyz, t.p - here.p);
        bool alike = t.surface.a > 0.0 && abs(away) <= PLANE_TOLERANCE * depth_scale(here.surface.a)
            && dot(here.surface.xyz, t.surface.xyz) >= MIN_COSINE
            && at == clamp(at, ivec2(0), last) && is_finite(t.share);
#ifdef SPECULAR_RAYS
        specular += alike && is_alike_specular(here, t) ? vec4(t.specular.rgb, 1.0) * t.specular.a : vec4(0.0);
#endif
        vec4 seen = vec4(t.visible.rgb, 1.0) * t.weight, sent = vec4(t.unshadowed.rgb, 1.0) * t.weight;
        all_visible += alike ? seen : vec4(0.0);
        all_unshadowed += alike ? sent : vec4(0.0);
        all_square += alike ? t.unshadowed.a * t.weight : 0.0;
        surface_count += alike ? 1 : 0;
        alike = alike && (agree(t.share, here.share, here.variance + t.variance) || luminance(here.unshadowed.rgb) <= 0.0);
        visible += alike ? seen : vec4(0.0);
        unshadowed += alike ? sent : vec4(0.0);
        square += alike ? t.unshadowed.a * t.weight : 0.0;
        alike_count += alike ? 1 : 0;
    }
    // A sample of much light that hardly any other has. If it is seen, only guided ones may have that much; if it is hidden,
    // the unshadowed light shows it, which is smooth.
    bool is_surrounded = surface_count >= MANY;
    bool is_bright = here.unshadowed.a > GUIDED * here.share
        && here.share > (is_surrounded ? 1.0 : RARE) * share_of(all_visible.rgb, all_unshadowed.rgb);
    bool is_heavy = is_surrounded
        && luminance(here.unshadowed.rgb) * all_unshadowed.a > HEAVY * luminance(all_unshadowed.rgb);
    bool is_outlier = spacing == 1 && alike_count <= FEW && (is_bright || is_heavy);
    visible = is_outlier ? all_visible : visible;
    unshadowed = is_outlier ? all_unshadowed : unshadowed;
    square = is_outlier ? all_square : square;
    visible.rgb /= max(visible.a, 1e-30);
    unshadowed.rgb /= max(unshadowed.a, 1e-30);
#ifdef SPECULAR_RAYS
    specular.rgb /= max(specular.a, 1e-30);
#endif
#ifdef WRITE_SHADOW_RATIO
    vec3 share = clamp(visible.rgb / max(unshadowed.rgb, 1e-30), 0.0, 1.0);
    float all_light = max(max(unshadowed.r, unshadowed.g), unshadowed.b);
    float specular_share = 0.0;
#ifdef SPECULAR_RAYS
    float diffuse_share = share_of(visible.rgb, unshadowed.rgb);
    float share_of_rays = specular.r / max(specular.g, 1e-30);
    specular_share = clamp(mix(diffuse_share, share_of_rays, specular.a / (specular.a + PRIOR)), 0.0, 1.0);
#endif
    out_shadow_ratio = vec4(unshadowed.r > 0.0 ? share.r : 1.0, unshadowed.g > 0.0 ? share.g : 1.0,
                            unshadowed.b > 0.0 ? share.b : 1.0, all_light > 0.0 ? 1.0 + specular_share : 0.0);
#else
    out_visible = visible;
    out_unshadowed = vec4(unshadowed.rgb, square / max(unshadowed.a, 1e-30));
#ifdef SPECULAR_RAYS
    out_specular = specular;
#endif
#endif
}
