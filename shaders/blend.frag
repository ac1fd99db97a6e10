// A layer of blended and transmissive surfaces over what is behind it: its own light, and the share of the light behind
// that passes it, which comes from elsewhere where it is refracted, and from around there where the surface is rough.
#include "numbers.glsl"
#include "camera.glsl"
#include "grid.glsl"
#include "noise.glsl"
#include "specular_albedo.glsl"

const int BLUR_TAPS = 8;
const float GOLDEN_ANGLE = 2.39996323;
const float MIN_BLUR = 0.5;     // pixels
const float TAP_WIDTH = 0.5;    // of the innermost tap in radii; with sqrt(pi / BLUR_TAPS) taps would not overlap
const int SPREAD_STEPS = 6;     // of a ray to what it meets; they grow
const float MIN_SHARE = 0.02;   // of the way to what is infinitely far away, within which refraction is not carried on
const float SAME_SHARE = 0.1;   // relative difference of shares of the way to one surface
const float OUTERMOST = 8.0;    // radii, twice those of the outermost tap
const float START_TURNS = 13.0; // of a ray's first step while the taps turn once, so that one does not follow the other
const float GOLDEN_RATIO = 0.61803399;
const float FILL_RADIUS = 4.0;  // pixels to what stands in for what is hidden
const int STEPS_BACK = 16;      // from what is hidden to where the ray starts
const int INDIRECT_TAPS = 8;
const float INDIRECT_RADIUS = 24.0;  // pixels
const float SAME_DEPTH = 0.05;       // relative difference of depths of one surface,
const float MAX_APART = 4.0;         // and how many of these those of another one differ by

uniform sampler2D behind;
uniform sampler2D albedo;
uniform sampler2D direct;
uniform sampler2D depth;     // of the layer
uniform sampler2D opaque_depth;
#if defined(HAS_ARRIVING) || defined(HAS_EXIT)
uniform sampler2D normal;
#endif
uniform sampler2D passage;   // a: coverage
#ifdef HAS_SPECULAR
uniform sampler2D specular;
#endif
#ifdef HAS_EMISSION
uniform sampler2D emission;
#endif
#ifdef HAS_INDIRECT
uniform sampler2D indirect;  // of what is opaque
#endif
#ifdef HAS_ARRIVING
uniform sampler2D arriving;  // diffuse light on a coarse grid; a: depth of the layer there, 0 for none
#endif
#if defined(HAS_MIRRORED) && defined(HAS_SPECULAR_ROUGHNESS)
uniform sampler2D mirrored;  // the same of what surfaces send from the mirrored direction
uniform sampler2D specular_roughness;
#endif
#ifdef HAS_SKY_IRRADIANCE
#include "sky_irradiance.glsl"
#endif
#ifdef HAS_REFRACTION
#ifdef BLURS
#include "blur_level.glsl"
uniform sampler2D blur_light;  // levels of what is behind, see blur_levels.comp
uniform sampler2D blur_depth;
uniform int blur_levels;
#endif
uniform sampler2D refraction;  // ior, or 0 if thin; thickness / depth_scale; slope of the spread of what is behind
#endif
#ifdef HAS_OUTER_REFLECTION
uniform sampler2D outer_reflection;  // a: 1 for the layer, 0 for a clear coat
#endif

#ifdef HAS_REFRACTION
#include "refracted_source.glsl"
#endif

layout(location = 0) out vec4 out_lit;

#ifdef HAS_REFRACTION
// Whether a texel shows nothing nearer than a depth.
bool is_behind(ivec2 texel, float nearest)
{
    float there = texelFetch(opaque_depth, texel, 0).r;
    bool is_free = !is_surface(there) || there > nearest;
#ifdef HAS_EXIT
    is_free = is_free && depth_beside(texel, nearest) <= 0.0;  // which what is behind the layer lacks there
#endif
    return is_free;
}

// Light behind a layer at a texel; a: 1, or 0 if it shows something nearer.
vec4 light_at(ivec2 texel, float nearest)
{
    vec4 light = vec4(sanitize_radiance(texelFetch(behind, texel, 0).rgb), 1.0);
    return is_behind(texel, nearest) ? light : vec4(0.0);
}

// Between the four texels around a pixel; a: the share of them that is behind.
vec4 interpolated(vec2 pixel, float nearest)
{
    vec2 first = floor(pixel - 0.5), part = pixel - 0.5 - first;
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        vec2 corner = vec2(i & 1, i >> 1), weight = mix(1.0 - part, part, corner);
        sum += light_at(texel_at(first + corner + 0.5), nearest) * weight.x * weight.y;
    }
    return sum;
}

// Around a pixel within about a radius; a: sum of weights of what is behind nearest.
vec4 light_around(vec2 pixel, float radius, float nearest)
{
    float turn = 2.0 * PI * texel_noise(gl_FragCoord.xy);
    vec4 sum = vec4(0.0);
    for (int i = 0; i < BLUR_TAPS; ++i) {
        float angle = turn + GOLDEN_ANGLE * float(i);
        vec2 at = pixel + radius * sqrt((float(i) + 0.5) / float(BLUR_TAPS)) * vec2(cos(angle), sin(angle));
        sum += light_at(texel_at(at), nearest);
    }
    return sum;
}

#ifdef BLURS
// How far rays have come that start at depth d, at depth z: what their points on the screen are linear in.
float share_at(float d, float z)
{
#ifdef ORTHOGRAPHIC
    return z - d;
#else
    return 1.0 - d / z;
#endif
}

// Of what is infinitely far away; in parallel views of what is as far as the image is high.
float infinite_share(float d)
{
#ifdef ORTHOGRAPHIC
    return depth_scale(d);
#else
    return 1.0;
#endif
}

// That of what is opaque at a depth, or of what is infinitely far away.
float share_of(float d, float there)
{
    return is_surface(there) ? share_at(d, there) : infinite_share(d);
}

// Level whose texels are about as wide as a number of pixels; -1 for the image itself.
int level_of(float width)
{
    return min(int(log2(max(width, 1.0)) + 0.5), blur_levels) - 1;
}

// Light behind a layer around a pixel, between the four texels of a level; a: its weight.
vec4 mean_behind(vec2 pixel, int level, float nearest)
{
    vec2 at = level_position(pixel, max(level, 0)), first = floor(at), part = at - first;
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        ivec2 beside = ivec2(i & 1, i >> 1);
        vec2 weight = mix(1.0 - part, part, vec2(beside));
        ivec2 t = level_texel(textureSize(blur_light, 0), ivec2(first) + beside, max(level, 0));
        sum += weight.x * weight.y * texelFetch(blur_light, t, 0);
    }
    return level < 0 ? light_at(ivec2(pixel), nearest) : sum;
}

// Share of the nearest thing among the texels of a level around a pixel.
float least_share(float d, vec2 pixel, int level)
{
    ivec2 first = ivec2(floor(level_position(pixel, level)));
    float least = FAR * depth_scale(d);
    for (int i = 0; i < 4; ++i) {
        ivec2 t = level_texel(textureSize(blur_depth, 0), first + ivec2(i & 1, i >> 1), level);
        least = min(least, texelFetch(blur_depth, t, 0).r);
    }
    return share_at(d, least);
}

// The share after which a ray from depth d meets what the screen shows, ``aside`` per unit of share from this pixel; less than
// nearest does not count, nor what it has passed by more than the length of a step. -1 if it passes behind all.
// Guessed first, unless the guess is 0.
float share_met(float d, vec2 aside, float farthest, float nearest, float guess, float start)
{
    float before = 0.0, met = -1.0;
    int i = -1;
    do {
        float part = i + 1 < SPREAD_STEPS ? (float(i) + start) / float(SPREAD_STEPS - 1) : 1.0;
        float share = i < 0 ? guess : farthest * part * part;
        float there = texelFetch(opaque_depth, texel_at(gl_FragCoord.xy + share * aside), 0).r, found = share_of(d, there);
        bool is_guessed = abs(found - guess) < SAME_SHARE * guess, crosses = found <= share && found >= 2.0 * before - share;
        met = (!is_surface(there) || there > nearest) && (i < 0 ? is_guessed : crosses) ? max(found, before) : met;
        before = i < 0 ? 0.0 : share;
    } while (++i < SPREAD_STEPS && met < 0.0);
    return met;
}

// What rays meet that a surface at depth d spreads as GGX does its slopes, around the one that meets a pixel after a share of its
// way; half of them are within radius pixels per unit of that. a: sum of weights.
vec4 spread_light(float d, vec2 pixel, float share, float radius, float nearest)
{
    float noise = texel_noise(gl_FragCoord.xy), farthest = max(infinite_share(d), share);
    vec2 middle = (pixel - gl_FragCoord.xy) / max(share, MIN_SHARE * farthest);
    bool is_clear = least_share(d, pixel, max(level_of(OUTERMOST * radius * share), 0)) > (1.0 - SAME_SHARE) * share;
    float guess = is_clear ? share : 0.0;  // where nothing nearer is around
    vec4 sum = vec4(0.0);
    for (int i = 0; i < BLUR_TAPS; ++i) {
        float angle = 2.0 * PI * noise + GOLDEN_ANGLE * float(i), u = (float(i) + 0.5) / float(BLUR_TAPS);
        vec2 aside = middle + radius * sqrt(u / (1.0 - u)) * vec2(cos(angle), sin(angle));
        float width = TAP_WIDTH * radius / (1.0 - u), start = fract(START_TURNS * noise + GOLDEN_RATIO * float(i));
        float met = share_met(d, aside, farthest, nearest, guess, start);
        vec4 light = mean_behind(inside_image(gl_FragCoord.xy + max(met, 0.0) * aside), level_of(width * met), nearest);
        sum += met >= 0.0 ? light : vec4(0.0);
    }
    return sum;
}
#endif

#ifdef HAS_EXIT
// Radiance from a direction that the picture does not show: the mean of what arrives, or the environment's around that
// direction if it is about as bright as that; where neither is known, as at the edge of the picture.
vec3 surrounding(vec3 direction, vec3 diffuse, vec3 at_edge)
{
#ifdef HAS_SKY_IRRADIANCE
    vec3 sky = unshadowed_sky_irradiance(normalize(relative_from_view(direction))) / PI;
#endif
#if defined(HAS_ARRIVING) && defined(HAS_SKY_IRRADIANCE)
    vec3 n = sanitize_normal(texelFetch(normal, ivec2(gl_FragCoord.xy), 0).xyz);
    float ratio = luminance(diffuse) * PI / max(luminance(unshadowed_sky_irradiance(n)), 1e-30);
    return ratio > 0.0 ? mix(diffuse, sky, clamp(1.5 - abs(log2(ratio)), 0.0, 1.0)) : sky;
#elif defined(HAS_ARRIVING)
    return diffuse;
#elif defined(HAS_SKY_IRRADIANCE)
    return sky;
#else
    return at_edge;
#endif
}
#endif

// Light behind a surface at depth d that is seen through rough or thick glass.
vec3 transmitted_light(float d, vec4 from, vec3 diffuse)
{
    Source source = Source(gl_FragCoord.xy, d, vec3(1.0), true, vec3(0.0));
#ifdef HAS_EXIT
    if (from.x > 0.0) source = refracted(d, from);
#endif
    // Where something before the glass hides what the ray meets, what is beside it on the way back stands for that.
    vec2 aside = inside_image(source.pixel) - gl_FragCoord.xy;
    float way = 1.0, stride = 1.0 / float(STEPS_BACK), first = stride * texel_noise(gl_FragCoord.xy);
    for (int i = 0; i < STEPS_BACK && !is_behind(texel_at(gl_FragCoord.xy + way * aside), source.nearest); ++i)
        way = max(way - (i == 0 ? first : stride), 0.0);
    vec2 pixel = inside_image(gl_FragCoord.xy + way * aside);
    ivec2 texel = ivec2(pixel);
    vec4 sum = vec4(0.0);
    bool spreads = false;
#ifdef BLURS
    float share = max(share_of(d, texelFetch(opaque_depth, texel, 0).r), 0.0), radius = 0.5 * from.z * image.y / lens.y;
    spreads = radius * share >= MIN_BLUR;
    if (spreads) sum = spread_light(d, pixel, share, radius, source.nearest);
#endif
    if (!spreads) sum = interpolated(pixel, source.nearest);
    if (sum.a <= 0.0) sum = light_around(pixel, FILL_RADIUS, source.nearest);
    vec3 light = sum.a > 0.0 ? sum.rgb / sum.a : sanitize_radiance(texelFetch(behind, texel, 0).rgb);
#ifdef HAS_EXIT
    light = source.tint * (source.is_known ? light : surrounding(source.along, diffuse, light));
#endif
    return light;
}
#endif

#ifdef HAS_INDIRECT
// The mean of what arrives at opaque surfaces around, whose outlines would show in the light of one of them.
vec3 indirect_around(vec2 pixel)
{
    vec4 sum = vec4(0.0);
    for (int i = 0; i < INDIRECT_TAPS; ++i) {
        float angle = GOLDEN_ANGLE * float(i), radius = INDIRECT_RADIUS * sqrt((float(i) + 0.5) / float(INDIRECT_TAPS));
        ivec2 t = ivec2(clamp(pixel + radius * vec2(cos(angle), sin(angle)), vec2(0.0), image.xy - 1.0));
        bool is_known = is_surface(texelFetch(opaque_depth, t, 0).r);
        sum += is_known ? vec4(sanitize_radiance(texelFetch(indirect, t, 0).rgb), 1.0) : vec4(0.0);
    }
    return sum.rgb / max(sum.a, 1.0);
}
#endif

#ifdef HAS_ARRIVING
// Interpolated between the texels around that show the layer, or otherwise light.
vec3 coarse_light(sampler2D coarse, vec2 pixel, float d, vec3 otherwise)
{
    vec2 size = vec2(textureSize(coarse, 0)), at = pixel * image.zw * size - 0.5, first = floor(at) - 1.0;
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 16; ++i) {
        vec2 t = first + vec2(i % 4, i / 4), closeness = max(1.0 - 0.5 * abs(t - at), 0.0);
        vec4 light = texelFetch(coarse, ivec2(clamp(t, vec2(0.0), size - 1.0)), 0);
        float apart = (light.a - d) / (SAME_DEPTH * d), weight = closeness.x * closeness.y / (1.0 + apart * apart);
        sum += light.a > 0.0 && abs(apart) < MAX_APART && is_finite(dot(light, vec4(1.0))) ? vec4(light.rgb, 1.0) * weight : vec4(0.0);
    }
    return sum.a > 0.0 ? sanitize_radiance(sum.rgb / sum.a) : otherwise;
}
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 light = sanitize_radiance(texelFetch(behind, texel, 0).rgb);
    float d = texelFetch(depth, texel, 0).r;
    if (is_surface(d)) {
        vec4 passing = texelFetch(passage, texel, 0);
        float coverage = sanitize_albedo(passing.aaa).x;
        vec3 diffuse = vec3(0.0);
#ifdef HAS_INDIRECT
        diffuse = indirect_around(gl_FragCoord.xy);
#ifdef HAS_ARRIVING
#ifdef HAS_SKY_IRRADIANCE
        diffuse += unshadowed_sky_irradiance(sanitize_normal(texelFetch(normal, texel, 0).xyz)) / PI;
#endif
        diffuse = coarse_light(arriving, gl_FragCoord.xy, d, diffuse);
#endif
#endif
#ifdef HAS_REFRACTION
        vec4 from = texelFetch(refraction, texel, 0);
        light = transmitted_light(d, clamp(mix(from, vec4(0.0), isnan(from)), 0.0, HALF_MAX), diffuse);
#endif
        light *= sanitize_albedo(passing.rgb);
        light += sanitize_radiance(texelFetch(direct, texel, 0).rgb);
#ifdef HAS_SPECULAR
        light += coverage * sanitize_radiance(texelFetch(specular, texel, 0).rgb);
#endif
#ifdef HAS_EMISSION
        light += sanitize_radiance(texelFetch(emission, texel, 0).rgb);
#endif
#ifdef HAS_OUTER_REFLECTION
        vec4 reflection = texelFetch(outer_reflection, texel, 0);
        light += reflection.a > 0.5 ? sanitize_radiance(reflection.rgb) : vec3(0.0);
#endif
#if defined(HAS_MIRRORED) && defined(HAS_SPECULAR_ROUGHNESS)
        vec4 reflectance = texelFetch(specular_roughness, texel, 0);
        vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
        vec3 v = -normalize(along_view(surface_point(gl_FragCoord.xy, d)));
        light += coverage * specular_albedo(sanitize_albedo(reflectance.rgb), reflectance.a, dot(n, v))
            * coarse_light(mirrored, gl_FragCoord.xy, d, vec3(0.0));
#endif
        light += sanitize_albedo(texelFetch(albedo, texel, 0).rgb) * diffuse;
    }
    out_lit = vec4(min(light, HALF_MAX), 1.0);
}
