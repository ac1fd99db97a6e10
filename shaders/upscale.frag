// Temporal upsampling (after AMD's FidelityFX Super Resolution 2 and Unreal Engine's Temporal Super Resolution): frames
// smaller than the image, jittered, are accumulated in a history of the image's size. A sample counts by its distance from
// the centre of the pixel.
#include "numbers.glsl"
#include "camera.glsl"
#include "ycocg.glsl"
#include "history_filter.glsl"
#include "still.glsl"

const float CLIP_GAMMA = 1.25;     // standard deviations, as in taa.frag
const float SETTLED_GAMMA = 3.0;
const float STILL_FALLOFF = 16.0;  // exp(-f x⁴) along each axis, x in pixels of the image: as wide as a pixel, and almost a box
const float MOVING_FALLOFF = 2.5;  // exp(-f x²): wider, since the history is short
const float MIN_WEIGHT = 0.05;     // of a history that begins, so that nearer samples soon replace distant ones
const float MOVING_WEIGHT = 2.0;   // of the history while something moves through the pixel; more blurs, as each frame resamples it
const float STILL_WEIGHT = 256.0;
#ifdef WRITE_RESAMPLED
const float MAX_RESAMPLINGS = 8.0;
#endif

uniform sampler2D lit;
uniform sampler2D guide_mean;
uniform sampler2D guide_deviation;
uniform sampler2D guide_motion;
uniform sampler2D taa_prev;        // rgb: history, a: weight accumulated
uniform vec4 output_image;         // width, height, 1/width, 1/height of the image in pixels
uniform bool history_valid;
uniform bool settled;              // see taa.frag

layout(location = WRITE_TAA) out vec4 out_taa;
#ifdef WRITE_RESAMPLED
uniform sampler2D resampled_prev;
layout(location = WRITE_RESAMPLED) out float out_resampled;  // how often the history was resampled, by its weight
#endif

vec3 current(int x, int y)
{
    return sanitize_radiance(texelFetch(lit, ivec2(x, y), 0).rgb);
}

vec2 falloff(vec2 distance, bool still)
{
    vec2 square = distance * distance;
    return exp(still ? -STILL_FALLOFF * square * square : -MOVING_FALLOFF * square);
}

void main()
{
    ivec2 last = ivec2(image.xy) - 1;
    vec2 ratio = image.xy * output_image.zw;  // pixels of the frame per pixel of the image
    vec2 at = gl_FragCoord.xy * ratio + 0.5 * (lens.zw - center.xy) * image.xy;  // in the frame, which is jittered
    ivec2 nearest = clamp(ivec2(at), ivec2(0), last);
    vec4 moved = texelFetch(guide_motion, nearest, 0);
    bool still = is_still(moved.xy);

    // The four samples around.
    vec2 corner = floor(at - 0.5), f = at - 0.5 - corner;
    ivec2 low = clamp(ivec2(corner), ivec2(0), last), high = clamp(ivec2(corner) + 1, ivec2(0), last);
    vec3 a = current(low.x, low.y), b = current(high.x, low.y), c = current(low.x, high.y), d = current(high.x, high.y);
    vec2 weight_low = falloff(f / ratio, still), weight_high = falloff((1.0 - f) / ratio, still);
    vec2 sum = weight_low + weight_high, share_high = weight_high / sum;
    float weight = sum.x * sum.y;
    vec3 now = mix(mix(a, b, share_high.x), mix(c, d, share_high.x), share_high.y);
    vec3 interpolated = mix(mix(a, b, f.x), mix(c, d, f.x), f.y);

    vec2 back = still ? vec2(0.0) : -moved.xy / ratio;
    vec2 before = gl_FragCoord.xy + back;
    vec4 accumulated = filter_history(taa_prev, before, output_image);
    vec3 history = max(accumulated.rgb, 0.0);
    bool healthy = is_finite(dot(accumulated, vec4(1.0))) && accumulated.a >= MIN_WEIGHT;
    bool inside = all(greaterThanEqual(before, vec2(0.0))) && all(lessThanEqual(before, output_image.xy));
    bool keep = moved.z > 0.5 && inside && healthy && history_valid;

    vec3 mean = texelFetch(guide_mean, nearest, 0).rgb;
    vec3 deviation = texelFetch(guide_deviation, nearest, 0).rgb;
    vec3 offset = ycocg(history) - mean;
    float share = clip_share(offset, (settled ? SETTLED_GAMMA : CLIP_GAMMA) * deviation);
    history = max(rgb(mean + offset * share), 0.0);
    float kept = accumulated.a * mix(0.25, 1.0, share);
    float total = keep ? min(kept + weight, still ? STILL_WEIGHT : MOVING_WEIGHT) : max(weight, MIN_WEIGHT);
    float share_now = min(weight / total, 1.0);
#ifdef WRITE_RESAMPLED
    vec2 fraction = fract(back);  // half a texel blurs most, a whole one not at all
    float blur = 2.0 * dot(fraction, 1.0 - fraction);
    float resamplings = texelFetch(resampled_prev, clamp(ivec2(before), ivec2(0), ivec2(output_image.xy) - 1), 0).r;
    resamplings = is_finite(resamplings) ? max(resamplings, 0.0) + blur : blur;
    out_resampled = keep ? min(resamplings, MAX_RESAMPLINGS) * (1.0 - share_now) : 0.0;
#endif
    out_taa = vec4(keep ? min(mix(history, now, share_now), HALF_MAX) : interpolated, max(total, MIN_WEIGHT));
}
