// What surfaces reflect of indirect light: the light along reflected rays, upsampled as in upsample.frag, or for rough surfaces
// the diffuse light that arrives, times the lobe's albedo (the split sum of Karis 2013, "Real Shading in Unreal Engine 4").
#include "numbers.glsl"
#include "grid.glsl"
#include "joint_bilateral.glsl"
#include "reflection.glsl"
#include "specular_albedo.glsl"

uniform sampler2D normal;
uniform sampler2D specular_roughness;
#ifdef HAS_CLEARCOAT
#include "octahedral.glsl"
#include "clearcoat.glsl"
uniform sampler2D clearcoat;  // normal, strength, perceptual roughness
#endif
#ifdef HAS_REFLECTION_FILTERED
uniform sampler2D depth;
uniform sampler2D reflection_gbuffer;
uniform sampler2D reflection_filtered;  // radiance; a: depth of its surface, 0 where no light is known
uniform vec2 ratio;  // full-resolution texels per low-resolution texel
const float SAME_DEPTH = 2e-3;     // of the depth, more than halves round it by
const float SPREAD_FACING = 0.75;  // cosine that the unknown normal of spread light counts as
#if defined(AT_REST) || defined(FOLLOWS_IMAGES)
const float EVEN = 1e-4, BUMPY = 1e-2;  // bumpiness, between which samples get noisy

uniform sampler2D reflection_detail;  // radiance; a: number of samples
uniform sampler2D reflection_detail_albedo;  // mean luminance of the samples' specular albedos, at rest
uniform sampler2D reflection_distance;  // length of the rays / depth
#endif
#ifdef AT_REST
const float MAX_RISE = 1.5;           // times that, up to which a surface may reflect more than those that samples are of
const float EDGE = 0.3;               // radians, that the turn to another surface counts as
const float MIN_LOBE = 5e-3;          // radians
const float ROUGHNESS_OF_ONE = 0.05;  // at which one sample of a pixel's own counts as much as all light that is averaged
const float FEW = 2.0, ENOUGH = 9.0;  // samples that averaged light counts as, between which those of pixels lose their weight
const float MIN_BLUR = 0.4;           // of ROUGHNESS_OF_ONE, from which pixels along count too
const float NOISELESS = 0.05, NOISY = 0.15;  // roughness, between which samples get noisy
const float NARROW_SPREAD = 0.15, WIDE_SPREAD = 0.6;  // texels of the grid that a lobe spreads over, between which they do too
const float NOISY_SAMPLES = 12.0;     // of noisy ones, that averaged light counts as at least
const float UNKNOWN = 0.5;            // samples, up to which a pixel has no light but that of the grid
const float UNSAMPLED = 0.1;          // samples that averaged light counts as, at least, in pixels without one
const int ALONG = 8;                  // pixels on a line that count beyond those around
#endif

// Weighted by how much the texel's surface is the receiver's.
vec4 tap(ivec2 low, float along, float closeness, BilateralReceiver r)
{
    vec4 light = texelFetch(reflection_filtered, low, 0);
    vec4 centre = texelFetch(reflection_gbuffer, low, 0);
    // Light that was spread to a texel beside a glossy surface is not that of its own normal.
    bool is_own = abs(centre.a - light.a) <= SAME_DEPTH * light.a;
    float weight = (closeness + MIN_WEIGHT) * similarity(vec4(is_own ? centre.xyz : SPREAD_FACING * r.normal, light.a), along, r);
    bool counts = light.a > 0.0 && is_finite(dot(light, vec4(1.0)));
    return counts ? vec4(clamp(light.rgb, 0.0, HALF_MAX), 1.0) * weight : vec4(0.0);
}

// Radiance from ``count`` of the four texels around; the others are not needed where nothing is traced. a: how far these show
// the same surface.
vec4 upsampled(vec3 n, float d, int count, vec3 otherwise)
{
    BilateralReceiver r = bilateral_receiver(gl_FragCoord.xy, n, d);
    Around t = texels_around(gl_FragCoord.xy, textureSize(reflection_filtered, 0), ratio, r);
    vec4 sum = vec4(0.0);
    int i = 0;
    do {
        bvec2 second = bvec2(i % 2 == 1, i > 1);
        vec2 along = mix(t.along_low, t.along_high, second), close = mix(1.0 - t.f, t.f, second);
        sum += tap(ivec2(second.x ? t.high.x : t.low.x, second.y ? t.high.y : t.low.y), along.x + along.y, close.x * close.y, r);
    } while (++i < count);
    return sum.a > 0.0 ? vec4(sum.rgb / sum.a, min(sum.a, 1.0)) : vec4(otherwise, 0.0);
}

#if defined(AT_REST) || defined(FOLLOWS_IMAGES)
vec3 normal_at(ivec2 texel)
{
    return sanitize_normal(texelFetch(normal, clamp(texel, ivec2(0), textureSize(normal, 0) - 1), 0).xyz);
}

// How much the normals of two pixels on both sides differ from a steady turn, squared; 0 beside an edge.
float unsteadiness(vec3 n, vec3 before, vec3 after)
{
    vec3 bump = before + after - 2.0 * n;
    return min(dot(n, before), dot(n, after)) > SAME_NORMAL ? dot(bump, bump) : 0.0;
}

// The same in both directions of the image: bumps, of which a pixel shows one by chance.
float bumpiness(ivec2 texel, vec3 n)
{
    ivec2 right = ivec2(1, 0), up = ivec2(0, 1);
    return max(unsteadiness(n, normal_at(texel - right), normal_at(texel + right)),
               unsteadiness(n, normal_at(texel - up), normal_at(texel + up)));
}
#endif

#ifdef AT_REST
// How much the normal changes from n to that of a pixel, in radians. Beside an edge, the light of the grid is less certain.
float turn(vec3 n, ivec2 texel)
{
    vec3 m = normal_at(texel);
    return dot(n, m) > SAME_NORMAL ? distance(n, m) : EDGE;
}

// How much the normal changes within a low-resolution texel, in radians.
float bend(ivec2 texel, vec3 n)
{
    ivec2 reach = ivec2(0.5 * ratio + 0.5), right = ivec2(reach.x, 0), up = ivec2(0, reach.y);
    return max(max(turn(n, texel - right), turn(n, texel + right)), max(turn(n, texel - up), turn(n, texel + up)));
}

// The direction in which the normal changes least, as along a rod: the eigenvector of the smaller eigenvalue of squared changes.
vec2 straightest(ivec2 texel)
{
    vec3 dx = normal_at(texel + ivec2(1, 0)) - normal_at(texel - ivec2(1, 0));
    vec3 dy = normal_at(texel + ivec2(0, 1)) - normal_at(texel - ivec2(0, 1));
    float half_difference = 0.5 * (dot(dx, dx) - dot(dy, dy)), mixed = dot(dx, dy);
    float angle = 0.5 * atan(mixed, half_difference == 0.0 ? 1e-20 : half_difference);  // of the larger one's
    return vec2(-sin(angle), cos(angle));
}

// With the light of rays from the pixel and those around, which counts the more, the smoother the surface is, and the more it
// bends. How much they count must not depend on what they have found: rare rays of much light would count less than the others.
vec3 detailed(ivec2 texel, vec3 n, float d, float roughness, float albedo, vec4 averaged)
{
    float blur = roughness / ROUGHNESS_OF_ONE, bent = bend(texel, n), bends = 0.5 * bent / max(roughness * roughness, MIN_LOBE);
    float flatness = 1.0 / (1.0 + bends * bends), known = averaged.a * blur * blur * flatness * flatness;
    float needed = 1.0 - smoothstep(FEW, ENOUGH, known);
    // Bumps count as noise: a pixel's own ray sees one of many.
    float bumps = bumpiness(texel, n), bumpy = smoothstep(EVEN, BUMPY, bumps);
    float own = max(texelFetch(reflection_detail, texel, 0).a, 0.0);
    ivec2 low = min(ivec2(gl_FragCoord.xy / ratio), textureSize(reflection_distance, 0) - 1);
    float spread_there = lobe_texels(texelFetch(reflection_distance, low, 0).r, roughness, d, ratio);
    float spreads = smoothstep(NARROW_SPREAD, WIDE_SPREAD, spread_there) * flatness * flatness;
    known += NOISY_SAMPLES * max(max(smoothstep(NOISELESS, NOISY, roughness), spreads), bumpy) * averaged.a;
    known = max(known, own < 1.0 ? UNSAMPLED * averaged.a : 0.0);
    known = max(known, 1e-6);
    vec4 sum = vec4(averaged.rgb, 1.0) * known;
    vec3 p = surface_point(gl_FragCoord.xy, d);
    // In squared pixels. Few samples are aliased, unless those around count too.
    float spread = blur * blur + 1.0 / (1.0 + own) + 2.0 * bumpy;
    float sharpness = 1.0 / (roughness * roughness * roughness * roughness + 8.0 * bent * bent / dot(ratio, ratio)
                             + 4.0 * bumps + 1e-8);
    // A loop that need not begin takes no time, unlike a branch, which some drivers run for all.
    bool counts_any = ray_share(roughness) > 0.0 && needed > 0.0, counts_along = counts_any && blur > MIN_BLUR;
    vec2 along = counts_along ? straightest(texel) : vec2(0.0);
    int end = counts_along ? 9 + ALONG : counts_any ? 9 : 0;
    for (int i = 0; i < end; ++i) {
        int pixels = (3 + (i - 9) / 2) * (1 - 2 * (i % 2));  // along the line: 3, -3, 4, -4 ... of them
        ivec2 offset = i < 9 ? ivec2(i % 3, i / 3) - 1 : ivec2(round(along * float(pixels)));
        ivec2 at = clamp(texel + offset, ivec2(0), textureSize(reflection_detail, 0) - 1);
        vec4 detail = texelFetch(reflection_detail, at, 0);
        vec3 turned = normal_at(at) - n;
        float falloff = float(offset.x * offset.x + offset.y * offset.y) / spread + dot(turned, turned) * sharpness;
        float away = dot(n, surface_point(vec2(at) + 0.5, texelFetch(depth, at, 0).r) - p);
        float rougher = (texelFetch(specular_roughness, at, 0).a - roughness) / ROUGHNESS_SIGMA;
        float weight = detail.a * needed * exp(-falloff - rougher * rougher);
        bool counts = detail.a > UNKNOWN && is_finite(dot(detail, vec4(1.0))) && is_finite(weight)
            && at == texel + offset && dot(turned, turned) < 2.0 - 2.0 * SAME_NORMAL && abs(away) <= PLANE_TOLERANCE * depth_scale(d);
        // Samples of a face seen from the front say little of what one seen at a slant reflects in the same pixel.
        float rise = albedo / max(texelFetch(reflection_detail_albedo, at, 0).r, 1e-6);
        vec3 light = clamp(detail.rgb, 0.0, HALF_MAX) * (rise > MAX_RISE ? MAX_RISE / rise : 1.0);
        sum += counts ? vec4(light, 1.0) * weight : vec4(0.0);
    }
    return sum.rgb / sum.a;
}
#endif
#endif

// Radiance; arriving: the diffuse light that arrives at the texel, irradiance / pi.
vec3 reflected_light(ivec2 texel, vec3 arriving)
{
    vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
    vec4 reflectance = texelFetch(specular_roughness, texel, 0);  // 0 where nothing is seen
    vec3 light = arriving, v = -normalize(along_view(surface_ray(gl_FragCoord.xy)));
    float n_v = dot(n, v);
    vec3 reflected = specular_albedo(sanitize_albedo(reflectance.rgb), reflectance.a, n_v);
#ifdef HAS_REFLECTION_FILTERED
    float share = ray_share(reflectance.a);
    float d = texelFetch(depth, texel, 0).r;
    vec4 averaged = upsampled(n, d, share > 0.0 ? 4 : 1, light);
#ifdef AT_REST
    averaged.rgb = detailed(texel, n, d, reflectance.a, luminance(reflected), averaged);
#endif
#ifdef FOLLOWS_IMAGES
    vec4 detail = texelFetch(reflection_detail, texel, 0);
    float sharpness = image_sharpness(reflectance.a, d, ratio) * (1.0 - smoothstep(EVEN, BUMPY, bumpiness(texel, n)));
    bool is_known = detail.a > 0.0 && is_finite(dot(detail, vec4(1.0))) && sharpness > 0.0;
    averaged.rgb = is_known ? mix(averaged.rgb, clamp(detail.rgb, 0.0, HALF_MAX), sharpness) : averaged.rgb;
#endif
    light = mix(light, averaged.rgb, share);
#endif
#ifdef HAS_CLEARCOAT
    vec4 coat = texelFetch(clearcoat, texel, 0);
    light *= below_clearcoat(sanitize_albedo(coat.zzz).x, dot(octahedral_decode(coat.xy), v));
#endif
    return sanitize_radiance(reflected * light);
}
