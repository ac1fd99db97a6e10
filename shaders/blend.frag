// A layer of blended and transmissive surfaces over what is behind it: its own light, and the share of the light behind
// that passes it, which comes from elsewhere where it is refracted, and from around there where the surface is rough.
#include "numbers.glsl"
#include "camera.glsl"
#include "noise.glsl"

const int BLUR_TAPS = 8;
const float GOLDEN_ANGLE = 2.39996323;
const float MIN_BLUR = 0.5;     // pixels
const float TAP_WIDTH = 0.5;    // of the innermost tap in radii; with sqrt(pi / BLUR_TAPS) taps would not overlap
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
#ifdef HAS_SKY_IRRADIANCE
#include "sky_irradiance.glsl"
#endif
#ifdef HAS_REFRACTION
#ifdef BLUR_LEVELS
uniform sampler2D blur_light;  // levels of what is behind, see blur_levels.comp
uniform sampler2D blur_depth;
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

// Between the four texels around a pixel; a: the share of them that is behind.
vec4 interpolated(vec2 pixel, float nearest)
{
    vec2 first = floor(pixel - 0.5), part = pixel - 0.5 - first;
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        vec2 corner = vec2(i & 1, i >> 1), weight = mix(1.0 - part, part, corner);
        ivec2 t = texel_at(first + corner + 0.5);
        vec4 tap = vec4(sanitize_radiance(texelFetch(behind, t, 0).rgb), 1.0) * weight.x * weight.y;
        sum += is_behind(t, nearest) ? tap : vec4(0.0);
    }
    return sum;
}

#ifdef BLUR_LEVELS
// Between the four texels of a level around a pixel; 0 where something is among them that is not behind nearest. By hand, since
// some drivers' textureLod takes one level for four pixels.
vec4 level_light(vec2 pixel, int level, float nearest)
{
    vec2 at = exp2(-float(level) - 1.0) * pixel - 0.5, first = floor(at), part = at - first;
    ivec2 last = textureSize(blur_depth, level) - 1;
    vec4 sum = vec4(0.0);
    bool is_free = true;
    for (int i = 0; i < 4; ++i) {
        ivec2 corner = ivec2(i & 1, i >> 1), t = clamp(ivec2(first) + corner, ivec2(0), last);
        vec2 weight = mix(1.0 - part, part, vec2(corner));
        sum += weight.x * weight.y * texelFetch(blur_light, t, level);
        is_free = is_free && texelFetch(blur_depth, t, level).r > nearest;
    }
    return is_free ? sum : vec4(0.0);
}
#endif

// Light behind a layer around a pixel, over about 2^lod pixels, or less where something nearer is among them; a: its weight.
vec4 mean_behind(vec2 pixel, float lod, float nearest)
{
    vec4 light = vec4(0.0);
#ifdef BLUR_LEVELS
    int level = min(int(lod + 0.5), BLUR_LEVELS) - 1;
    bool is_coarse = level >= 0;
    do light = level_light(pixel, max(level--, 0), nearest); while (level >= 0 && light.a <= 0.0);
    light = is_coarse ? light : vec4(0.0);
#endif
    light = light.a > 0.0 ? light : vec4(sanitize_radiance(texelFetch(behind, ivec2(pixel), 0).rgb), 1.0);
    return is_behind(ivec2(pixel), nearest) ? light : vec4(0.0);
}

// Around a pixel as far as GGX spreads its slopes, half of them within radius pixels; a: sum of weights of what is behind. A tap
// has its share of them, 1 / BLUR_TAPS, within about width / (1 - u) pixels.
vec4 blurred(vec2 pixel, float radius, float width, float nearest)
{
    float turn = 6.2831853 * texel_noise(gl_FragCoord.xy);
    vec4 sum = vec4(0.0);
    for (int i = 0; i < BLUR_TAPS; ++i) {
        float angle = turn + GOLDEN_ANGLE * float(i), u = (float(i) + 0.5) / float(BLUR_TAPS);
        vec2 at = inside_image(pixel + radius * sqrt(u / (1.0 - u)) * vec2(cos(angle), sin(angle)));
        sum += mean_behind(at, log2(max(width / (1.0 - u), 1.0)), nearest);
    }
    return sum;
}

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
    float there = texelFetch(opaque_depth, texel, 0).r;
#ifdef ORTHOGRAPHIC
    float share = is_surface(there) ? max(there - d, 0.0) : depth_scale(d);  // of a unit, as lens.y is in scene units
#else
    float share = is_surface(there) ? max(there - d, 0.0) / there : 1.0;  // of the way from the eye
#endif
    float radius = from.z * share * 0.5 * image.y / lens.y, nearest = source.nearest;
    vec4 sum = radius < MIN_BLUR ? interpolated(pixel, nearest) : blurred(pixel, radius, TAP_WIDTH * radius, nearest);
    if (sum.a <= 0.0) sum = blurred(pixel, FILL_RADIUS, 0.0, nearest);
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
vec3 arriving_at(vec2 pixel, float d, vec3 otherwise)
{
    vec2 size = vec2(textureSize(arriving, 0)), at = pixel * image.zw * size - 0.5, first = floor(at) - 1.0;
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 16; ++i) {
        vec2 t = first + vec2(i % 4, i / 4), closeness = max(1.0 - 0.5 * abs(t - at), 0.0);
        vec4 light = texelFetch(arriving, ivec2(clamp(t, vec2(0.0), size - 1.0)), 0);
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
        diffuse = arriving_at(gl_FragCoord.xy, d, diffuse);
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
        vec4 mirrored = texelFetch(outer_reflection, texel, 0);
        light += mirrored.a > 0.5 ? sanitize_radiance(mirrored.rgb) : vec3(0.0);
#endif
        light += sanitize_albedo(texelFetch(albedo, texel, 0).rgb) * diffuse;
    }
    out_lit = vec4(min(light, HALF_MAX), 1.0);
}
