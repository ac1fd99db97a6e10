// Temporal anti-aliasing (Karis 2014, "High-Quality Temporal Supersampling"): jittered frames accumulated in a
// history that is reprojected by motion, rejected where a surface was hidden, and clipped to the variance of the
// neighbourhood in YCoCg (Salvi 2016, "An Excursion in Temporal Supersampling").
#include "numbers.glsl"
#include "camera.glsl"
#include "inverse_depth.glsl"
#include "quad.glsl"
#include "ycocg.glsl"
#include "history_filter.glsl"
#include "neighbourhood.glsl"
#include "reprojection.glsl"
#include "still.glsl"

const float CLIP_GAMMA = 1.25;      // standard deviations
const float SETTLED_GAMMA = 3.0;    // where history shows what is visible now, so only outliers are clipped
const float MOVING_FRAMES = 8.0;    // history length while something moves through the texel
const float STILL_FRAMES = 256.0;

uniform sampler2D taa_prev;    // rgb: history, a: frames accumulated
uniform bool history_valid;
uniform bool settled;          // history shows what is visible now, so it is rejected only where motion contradicts it, and only outliers are clipped

layout(location = WRITE_TAA) out vec4 out_taa;
#ifdef WRITE_RESAMPLED
uniform sampler2D resampled_prev;
layout(location = WRITE_RESAMPLED) out float out_resampled;  // how often the history was resampled, by its weight
#endif

void main()
{
    ivec2 last = ivec2(image.xy) - 1, t = min(ivec2(gl_FragCoord.xy), last);
    ivec2 outward = clamp(t - ivec2(quad_side()), ivec2(0), last) - t;
    vec3 now = current(t);
    vec4 moved = nearest_motion(t, outward);
    vec3 mean, square;
    neighbourhood(t, outward, ycocg(now), mean, square);
    vec3 deviation = sqrt(max(square - mean * mean, 0.0));

    bool still = is_still(moved.xy);
    vec2 back = still ? vec2(0.0) : is_finite(moved.x + moved.y) ? -moved.xy : vec2(1e9);
    ivec2 before = t + ivec2(floor(back + 0.5));
    vec4 accumulated = filter_history(taa_prev, gl_FragCoord.xy + back, image);
    vec3 history = max(accumulated.rgb, 0.0);
    bool healthy = is_finite(dot(accumulated, vec4(1.0))) && accumulated.a >= 1.0;
    bool unmoved = settled && still && abs(moved.z - moved.w) <= DEPTH_TOLERANCE * moved.w;
    bool keep = (unmoved || was_visible(before, outward, moved.z)) && healthy && history_valid;

    vec3 offset = ycocg(history) - mean;
    float share = clip_share(offset, (settled ? SETTLED_GAMMA : CLIP_GAMMA) * deviation);
    history = max(rgb(mean + offset * share), 0.0);
    float frames = keep ? min(accumulated.a * mix(0.25, 1.0, share) + 1.0, still ? STILL_FRAMES : MOVING_FRAMES) : 1.0;
#ifdef WRITE_RESAMPLED
    vec2 fraction = fract(back);  // half a texel blurs most, a whole one not at all
    float blur = 2.0 * dot(fraction, 1.0 - fraction);
    float resamplings = texelFetch(resampled_prev, clamp(before, ivec2(0), last), 0).r;
    resamplings = is_finite(resamplings) ? max(resamplings, 0.0) + blur : blur;
    out_resampled = keep ? min(resamplings, MOVING_FRAMES) * (1.0 - 1.0 / frames) : 0.0;
#endif
    out_taa = vec4(keep ? min(mix(history, now, 1.0 / frames), HALF_MAX) : now, frames);
}
