// Reflections at full resolution: in each frame one pixel of each low-resolution texel gets the light along its own ray. In motion,
// sharp images are resampled where they were (FOLLOWS_IMAGES), and pixels beside that one get some of its light.
#include "numbers.glsl"
#include "grid.glsl"
#include "nearest_texel.glsl"
#include "reflection.glsl"
#include "reflections_around.glsl"
#include "mirror_image.glsl"
#include "history_filter.glsl"

const float MAX_SAMPLES = 256.0;
const float MOVED = 0.9;  // samples that what was gathered in motion counts as, until the pixel has a ray of its own

uniform sampler2D reflection_origin;  // a: 1 + number of the pixel where the ray started, negative on another surface
uniform sampler2D reflection_detail_prev;
uniform vec2 ratio;           // full-resolution texels per low-resolution texel
uniform bool history_stands;  // whether what was gathered before stands
uniform sampler2D reflection_filtered;  // radiance; a: depth of its surface, 0 where no light is known
#ifdef FOLLOWS_IMAGES
const float MAX_MOVED_SAMPLES = 4.0;
const float UNSAMPLED = 0.5;      // samples that the light of the grid counts as
const float SAME_LENGTH = 0.15;   // relative difference of rays that meet the same thing
const float SIGMAS = 3.0;         // of the texels around, within which history counts where other things than the camera move
const float SAMPLE_SIGMA = 0.7;   // pixels, of the weight of a sample beside its own

uniform sampler2D reflection_distance;  // length of the rays / depth
uniform sampler2D reflection_distance_prev;
uniform sampler2D reflection_gbuffer_prev;
uniform sampler2D motion;
uniform sampler2D normal;
uniform sampler2D depth;
uniform sampler2D specular_roughness;
uniform bool bounded;         // whether history counts only within what the texels around show now
#else
uniform sampler2D reflection_albedo;  // luminance of the specular albedo where a ray starts
uniform sampler2D reflection_detail_albedo_prev;
uniform bool has_rested;      // whether what was gathered before is no image in motion
#endif

// Radiance; a: number of samples; 0 where there is none, but the light of the grid.
layout(location = WRITE_REFLECTION_DETAIL) out vec4 out_detail;
// Mean luminance of the samples' specular albedos, at rest.
layout(location = WRITE_REFLECTION_DETAIL_ALBEDO) out float out_detail_albedo;

// Of the grid.
vec4 of_grid(ivec2 low, float samples)
{
    vec4 light = texelFetch(reflection_filtered, low, 0);
    bool known = light.a > 0.0 && is_finite(dot(light, vec4(1.0)));
    return known ? vec4(clamp(light.rgb, 0.0, HALF_MAX), samples) : vec4(0.0);
}

int pixel_number(ivec2 low)
{
    return int(abs(texelFetch(reflection_origin, low, 0).a)) - 1;
}

#ifdef FOLLOWS_IMAGES
// What was gathered before around a position, in pixels; nothing beside what shows no sharp image.
vec4 gathered_at(vec2 position)
{
    vec2 base = floor(position - 0.5);
    vec4 least = vec4(HALF_MAX);
    for (int i = 0; i < 4; ++i) {
        vec2 corner = base + 2.0 * vec2(i % 2, i / 2);
        least = min(least, textureGather(reflection_detail_prev, corner * image.zw, 3));
    }
    bool all_known = min(min(least.x, least.y), min(least.z, least.w)) > 0.0;
    return all_known ? filter_history(reflection_detail_prev, position, image) : vec4(0.0);
}

// What was gathered of what the surface at p with that normal shows; else the light of the grid. Edges move with what is before them.
vec4 followed(ivec2 texel, ivec2 low, vec3 p, vec3 n, float d, float roughness)
{
    ivec2 last = textureSize(reflection_now, 0) - 1;
    Around now = reflections_around(low);
    vec3 margin = bounded && now.count > 0.0 ? SIGMAS * now.deviation : vec3(HALF_MAX);
    float reach = now.nearest < HALF_MAX ? now.nearest : texelFetch(reflection_distance, low, 0).r;
    vec3 moved = texelFetch(motion, texel, 0).xyz;
    MirrorImage before = mirror_image(p, d, moved, reach, roughness);
    vec2 position = vec2(texel) + 0.5 - before.moved;
    ivec2 low_before = ivec2(floor(position / ratio));
    bool inside = is_finite(position.x + position.y) && low_before == clamp(low_before, ivec2(0), last);
    low_before = inside ? low_before : ivec2(0);
    vec4 surface = texelFetch(reflection_gbuffer_prev, low_before, 0);
    vec3 q = previous_point(vec2(nearest_texel(low_before, ratio)) + 0.5, surface.a);
    vec3 m = mat3(previous_from_relative) * n;
    vec4 grid = texelFetch(reflection_filtered, low, 0);
    float off_grid = dot(n, surface_point(vec2(nearest_texel(low, ratio)) + 0.5, grid.a) - p);
    float length_before = texelFetch(reflection_distance_prev, low_before, 0).r * surface.a;
    bool same = inside && is_surface(surface.a) && dot(n, surface.xyz) > SAME_NORMAL
        && abs(dot(m, q - before.surface)) <= PLANE_TOLERANCE * depth_scale(d * moved.z)
        && length_before >= (1.0 - SAME_LENGTH) * reach * d;
    vec4 history = gathered_at(inside ? position : vec2(0.5));
    bool stands = history_stands && same && history.a > 0.0 && is_finite(dot(history, vec4(1.0)));
    history.rgb = clamp(history.rgb, max(now.mean - margin, 0.0), min(now.mean + margin, HALF_MAX));
    vec4 grid_light = of_grid(low, abs(off_grid) <= PLANE_TOLERANCE * depth_scale(d) ? UNSAMPLED : 0.0);
    return stands ? vec4(history.rgb, min(history.a, MAX_MOVED_SAMPLES)) : grid_light;
}

// Adds the light along the ray of a texel, if it started on the surface at p with that normal, by how near it started.
void add(ivec2 low, ivec2 texel, vec3 p, vec3 n, float tolerance, inout vec4 sum)
{
    low = clamp(low, ivec2(0), textureSize(reflection_now, 0) - 1);
    vec4 now = texelFetch(reflection_now, low, 0), origin = texelFetch(reflection_origin, low, 0);
    vec2 away = vec2(numbered_texel(low, ratio, int(abs(origin.a)) - 1, textureSize(depth, 0)) - texel);
    bool counts = is_finite(dot(now, vec4(1.0))) && now.a != 0.0 && abs(dot(n, origin.xyz - p)) <= tolerance;
    float weight = counts ? exp(-0.5 * dot(away, away) / (SAMPLE_SIGMA * SAMPLE_SIGMA)) : 0.0;
    sum += weight > 0.0 ? vec4(clamp(now.rgb, 0.0, HALF_MAX), 1.0) * weight : vec4(0.0);
}
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy), last = textureSize(reflection_now, 0) - 1;
    ivec2 low = min(ivec2(gl_FragCoord.xy / ratio), last);
#ifdef FOLLOWS_IMAGES
    out_detail_albedo = 0.0;
    vec4 reflectance = texelFetch(specular_roughness, texel, 0);
    float d = texelFetch(depth, texel, 0).r;
#ifdef FAST_PATH  // done where no image is sharp
    bool is_sharp = is_surface(d) && max(max(reflectance.r, reflectance.g), reflectance.b) > 0.0
        && image_sharpness(reflectance.a, d, ratio) > 0.0;
    out_detail = of_grid(low, 0.0);
    gl_FragDepth = is_sharp ? 0.0 : 1.0;
#else
    vec3 p = surface_point(gl_FragCoord.xy, d), n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
    vec4 before = followed(texel, low, p, n, d, reflectance.a), sum = vec4(0.0);
    ivec2 own = numbered_texel(low, ratio, pixel_number(low), textureSize(depth, 0));
    ivec2 beside = ivec2(texel.x < own.x ? -1 : 1, texel.y < own.y ? -1 : 1);
    float tolerance = PLANE_TOLERANCE * depth_scale(d);
    for (int i = 0; i < 4; ++i) add(low + ivec2(i % 2, i / 2) * beside, texel, p, n, tolerance, sum);
    float samples = before.a + sum.a;
    out_detail = samples > 0.0 ? vec4((before.rgb * before.a + sum.rgb) / samples, samples) : of_grid(low, 0.0);
#endif
#else
    vec4 before = texelFetch(reflection_detail_prev, texel, 0), now = texelFetch(reflection_now, low, 0);
    bool stands = history_stands && before.a > 0.0 && is_finite(dot(before, vec4(1.0)));
    before = stands ? vec4(clamp(before.rgb, 0.0, HALF_MAX), min(before.a, has_rested ? MAX_SAMPLES : MOVED)) : of_grid(low, 0.0);
    bool sampled = numbered_texel(low, ratio, max(pixel_number(low), 0), textureSize(reflection_detail_prev, 0)) == texel
        && pixel_number(low) >= 0 && is_finite(dot(now, vec4(1.0))) && now.a != 0.0;
    // At an edge a pixel shows faces that reflect more and less in turn; weighted by that, the mean is right for both together.
    float samples = before.a < 1.0 ? 1.0 : before.a + 1.0, albedo_now = texelFetch(reflection_albedo, low, 0).r;
    float albedo_before = texelFetch(reflection_detail_albedo_prev, texel, 0).r;
    albedo_before = samples > 1.0 && is_finite(albedo_before) && albedo_before > 0.0 ? albedo_before : 0.0;
    float albedo = albedo_before > 0.0 ? mix(albedo_before, albedo_now, 1.0 / samples) : albedo_now;
    float share = albedo > 0.0 ? albedo_now / (albedo * samples) : 1.0 / samples;
    out_detail = sampled ? vec4(mix(before.rgb, clamp(now.rgb, 0.0, HALF_MAX), share), samples) : before;
    out_detail_albedo = sampled ? albedo : albedo_before;
#endif
}
