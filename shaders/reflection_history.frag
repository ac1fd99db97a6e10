// Gathers reflected light over frames. It follows the mirror image rather than the surface.
#include "numbers.glsl"
#include "grid.glsl"
#include "mirror_image.glsl"
#include "nearest_texel.glsl"
#include "reflection.glsl"
#include "reflections_around.glsl"

const float MIN_SHARE = 0.05;        // of the texels around that must show the same surface
const float MIN_NEIGHBOURS = 4.0;    // with samples, that bound the history
const float MAX_BRIGHTENING = 4.0;   // history counts as at most this many times what is around now, or a flash would linger
const float MAX_RARE = 40.0;         // the same where few rays of a wide lobe meet a window or a lamp, and at rest
const float MAX_WEIGHT = 8.0;             // of a traced sample
const float SIGMAS = 2.0;            // of their mean, within which history counts

#ifdef FAST_PATH
uniform sampler2D reflection_origin;  // a: 0 where nothing reflects
#elif defined(HAS_REFLECTION_LOW_PREV)
uniform sampler2D reflection_ray;     // a: (SHARP_)NOT_SHOWN if the screen does not show the end
uniform sampler2D reflection_chance;  // that such a ray of a blurred image is traced
uniform sampler2D reflection_gbuffer;
uniform sampler2D specular_roughness;
uniform sampler2D motion;
uniform sampler2D reflection_low_prev;
uniform sampler2D reflection_distance_prev;
uniform sampler2D reflection_gbuffer_prev;
uniform vec2 ratio;            // full-resolution texels per low-resolution texel
uniform vec2 max_frames;       // of the history of mirrors, and of rough surfaces
uniform bool history_valid;
uniform bool bounded;          // whether that of sharp images counts only within what the texels around show now
#endif

layout(location = WRITE_REFLECTION_LOW) out vec4 out_reflection_low;       // radiance; a: frames, by their weights
layout(location = WRITE_REFLECTION_DISTANCE) out float out_reflection_distance;  // length of the rays / depth

#if defined(HAS_REFLECTION_LOW_PREV) && !defined(FAST_PATH)
// How many samples a texel's counts for: a traced one stands for rays that were not, as those that the screen shows all are.
float sample_weight(ivec2 low)
{
    float chance = texelFetch(reflection_chance, ivec2(0), 0).r;
    float along = texelFetch(reflection_ray, low, 0).a;
    return along < 0.0 && along > SHARP_NOT_SHOWN && chance < 1.0 ? 1.0 / max(chance, 1.0 / MAX_WEIGHT) : 1.0;
}

// Adds a texel of the frame before, if it shows the surface with the plane through p, in that frame's camera space.
void add(ivec2 low, float closeness, vec3 p, vec3 n, float tolerance, inout vec4 sum, inout float distances, inout float weight)
{
    bool inside = all(greaterThanEqual(low, ivec2(0))) && all(lessThan(low, textureSize(reflection_gbuffer_prev, 0)));
    low = inside ? low : ivec2(0);
    vec4 surface = texelFetch(reflection_gbuffer_prev, low, 0), old = texelFetch(reflection_low_prev, low, 0);
    float length_before = texelFetch(reflection_distance_prev, low, 0).r;
    vec3 q = previous_point(vec2(nearest_texel(low, ratio)) + 0.5, surface.a), m = mat3(previous_from_relative) * surface.xyz;
    bool same = inside && is_surface(surface.a) && abs(dot(n, q - p)) <= tolerance && dot(n, m) > SAME_NORMAL
        && is_finite(dot(old, vec4(1.0))) && old.a >= 1.0 && is_finite(length_before);
    sum += same ? vec4(clamp(old.rgb, 0.0, HALF_MAX), old.a) * closeness : vec4(0.0);
    distances += same ? max(length_before, 0.0) * closeness : 0.0;
    weight += same ? closeness : 0.0;
}
#endif

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
#ifdef FAST_PATH  // done where no ray starts
    out_reflection_low = vec4(0.0);
    out_reflection_distance = 0.0;
    gl_FragDepth = texelFetch(reflection_origin, low, 0).a == 0.0 ? 1.0 : 0.0;
#else
    vec4 now = texelFetch(reflection_now, low, 0);
    bool sampled = is_finite(dot(now, vec4(1.0))) && now.a > 0.0;
    now = sampled ? max(now, 0.0) : vec4(0.0);
    out_reflection_low = sampled ? vec4(now.rgb, 1.0) : vec4(0.0);
    out_reflection_distance = now.a;
#ifdef HAS_REFLECTION_LOW_PREV
    ivec2 full = nearest_texel(low, ratio);
    vec4 surface = texelFetch(reflection_gbuffer, low, 0);
    vec3 moved = texelFetch(motion, full, 0).xyz;
    float roughness = texelFetch(specular_roughness, full, 0).a;
    if (!(history_valid && is_surface(surface.a) && is_finite(dot(moved, vec3(1.0))) && roughness <= 1.0)) return;

    Around around = reflections_around(low);
    float reach = sampled ? now.a : around.reach;

    float depth = surface.a;
    MirrorImage image_before = mirror_image(surface_point(vec2(full) + 0.5, depth), depth, moved, reach, roughness);
    vec3 before = image_before.surface;
    vec2 at = vec2(low) - image_before.moved / ratio, f = fract(at);
    ivec2 base = ivec2(floor(at));
    vec3 n = mat3(previous_from_relative) * surface.xyz;
    float tolerance = PLANE_TOLERANCE * depth_scale(depth * moved.z);
    vec4 sum = vec4(0.0);
    float old_distances = 0.0, weight = 0.0;
    add(base, (1.0 - f.x) * (1.0 - f.y), before, n, tolerance, sum, old_distances, weight);
    add(base + ivec2(1, 0), f.x * (1.0 - f.y), before, n, tolerance, sum, old_distances, weight);
    add(base + ivec2(0, 1), (1.0 - f.x) * f.y, before, n, tolerance, sum, old_distances, weight);
    add(base + ivec2(1, 1), f.x * f.y, before, n, tolerance, sum, old_distances, weight);
    if (!(weight > MIN_SHARE)) return;
    vec4 history = sum / weight;
    float old_distance = old_distances / weight;
    vec3 margin = SIGMAS * around.deviation;
    float blur = image_blur(reach, roughness, depth, ratio);
    float loose = bounded ? blur : 1.0;
    history.rgb = around.brightest > 0.0 ? min(history.rgb, mix(MAX_BRIGHTENING, MAX_RARE, loose) * around.brightest) : history.rgb;
    vec3 near = clamp(history.rgb, around.mean - margin, around.mean + margin);
    history.rgb = around.count >= MIN_NEIGHBOURS ? mix(near, history.rgb, loose) : history.rgb;
    float frames = clamp(history.a * weight, 1.0, mix(max_frames.x, max_frames.y, clamp(roughness, 0.0, 1.0)));
    // Of a sharp image, all rays of a texel end where the screen shows them, or none.
    float weight_now = sampled ? mix(1.0, sample_weight(low), blur) : 0.0, share = weight_now / (frames + weight_now);
    out_reflection_low = vec4(mix(history.rgb, now.rgb, share), frames + weight_now);
    out_reflection_distance = mix(old_distance, now.a, share);
#endif
#endif
}
