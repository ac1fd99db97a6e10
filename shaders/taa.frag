// Temporal anti-aliasing (Karis 2014, "High-Quality Temporal Supersampling"): jittered frames accumulated in a
// history that is reprojected by motion, rejected where a surface was hidden, and clipped to the variance of the
// neighbourhood in YCoCg (Salvi 2016, "An Excursion in Temporal Supersampling"). One frame misses most of what is thinner
// than a texel, so settled history stays while frames differ from it no more than they did among themselves.
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
const float EXPECTED_GAMMA = 4.0;   // standard deviations over time: as far as one sample of 17 is from the others' mean
const float MIN_SAMPLES = 4.0;      // of which a deviation is known
const float SAME_LUMA = 0.02;       // relative change that counts as none
const float MAX_FADING = 2.0;       // times the luma now, to which history may have settled around what flashed
const float THIN = 0.3;             // share of its luma that is around a thin bright thing: 2 of 8 texels along a wire
const float MAX_BRIGHTENING = 4.0;  // times the luma of its history, for one unexpected sample that is not thin
const float MAX_SPECK = 48.0;       // times the luma of its history and of what is around, for one settled sample
const float MOVING_FRAMES = 8.0;    // history length while something moves through the texel
const float STILL_FRAMES = 256.0;
const float RISING_FRAMES = 32.0;   // that count in proportion to their number; all later ones count alike
const float FLICKERING = 0.15;      // of the luma, deviation over time of what each frame shows in part, such as a grating
const float FLICKERING_FRAMES = 16.0;  // its history length while something else moves; less one for each darker sample in a row

uniform sampler2D taa_prev;  // rgb: history, a: frames accumulated
uniform sampler2D taa_deviation_prev;
uniform bool history_valid;

layout(location = WRITE_TAA) out vec4 out_taa;
layout(location = WRITE_TAA_DEVIATION) out float out_deviation;  // of the luma of the settled samples accumulated
#ifdef WRITE_RESAMPLED
uniform sampler2D resampled_prev;
layout(location = WRITE_RESAMPLED) out float out_resampled;  // how often the history was resampled, by its weight
#endif

#if defined(SETTLED) || defined(CAMERA_RESTS)
float deviation_before(ivec2 t)
{
    float deviation = texelFetch(taa_deviation_prev, t, 0).r;
    return is_finite(deviation) ? max(deviation, 0.0) : 0.0;
}
#endif

#ifdef SETTLED
// Whether a texel's history is far brighter than all that its samples lead to expect.
bool has_flashed(float now, float past, float deviation)
{
    return past > MAX_FADING * now + EXPECTED_GAMMA * deviation;
}
#endif

void main()
{
    ivec2 last = ivec2(image.xy) - 1, t = min(ivec2(gl_FragCoord.xy), last);
    ivec2 outward = clamp(t - ivec2(quad_side()), ivec2(0), last) - t;
    vec3 now = current(t);
    vec4 moved = nearest_motion(t, outward);
    vec3 mean, variance;
    neighbourhood(t, outward, ycocg(now), mean, variance);
    vec3 deviation = sqrt(variance);

    bool still = is_still(moved.xy);
    vec2 back = still ? vec2(0.0) : is_finite(moved.x + moved.y) ? -moved.xy : vec2(1e9);
    ivec2 before = t + ivec2(floor(back + 0.5));
    vec4 accumulated = still ? texelFetch(taa_prev, t, 0) : filter_history(taa_prev, gl_FragCoord.xy + back, image);
    vec3 history = max(accumulated.rgb, 0.0);
    bool healthy = is_finite(dot(accumulated, vec4(1.0))) && accumulated.a >= 1.0;
    bool visible = was_visible(before, outward, moved.z);
#ifdef SETTLED  // history shows what is visible now, so it is rejected only where motion contradicts it
    visible = visible || (still && abs(moved.z - moved.w) <= DEPTH_TOLERANCE * moved.w);
#endif
    vec3 offset = ycocg(history) - mean;
#if defined(SETTLED) || defined(CAMERA_RESTS)
    float own = ycocg(now).x, past = ycocg(history).x, spread = deviation_before(t);
#endif
#ifdef CAMERA_RESTS  // what has rested for longer than the history of what moves has had nothing moving before it
    bool flickers = still && accumulated.a > MOVING_FRAMES && spread > FLICKERING * past
        && abs(own - past) <= EXPECTED_GAMMA * spread;
    visible = visible || flickers;
#endif
    bool keep = visible && healthy && history_valid;
#ifdef SETTLED
    float share = clip_share(offset, SETTLED_GAMMA * deviation);
    ivec2 corner = t + outward;
    float past_beside = ycocg(texelFetch(taa_prev, corner, 0).rgb).x;
    bool flashed = quad_any(has_flashed(own, past, spread)
        || has_flashed(ycocg(current(corner)).x, past_beside, deviation_before(corner)));
    float brightest = quad_max(vec3(max(past, past_beside))).x;
    bool expected = abs(own - past) <= EXPECTED_GAMMA * spread + SAME_LUMA * own;
    if (expected && !flashed && accumulated.a >= MIN_SAMPLES) share = 1.0;
    float around = (9.0 * mean.x - own) / 8.0;
    bool is_new = !expected && accumulated.a >= MIN_SAMPLES, is_thin = around <= THIN * own;
    if (is_new && !is_thin && own > past) share = 1.0;
    float max_luma = !is_new ? MAX_SPECK * max(past, around) : (is_thin ? MAX_SPECK : MAX_BRIGHTENING) * brightest;
    if (keep && max_luma > 0.0) now *= min(max_luma / max(own, 1e-8), 1.0);
    float kept = accumulated.a * (accumulated.a < MIN_SAMPLES ? 1.0 : mix(0.25, 1.0, share));
#else
    float share = clip_share(offset, CLIP_GAMMA * deviation);
#ifdef CAMERA_RESTS
    share = flickers ? 1.0 : share;
#endif
    float kept = accumulated.a * mix(0.25, 1.0, share);
#endif
    history = max(rgb(mean + offset * share), 0.0);
    float max_frames = still ? STILL_FRAMES : MOVING_FRAMES;
#ifdef CAMERA_RESTS
    // A shadow that arrives darkens all samples: down to MOVING_FRAMES, history is clipped again.
    kept = flickers ? (own < past ? min(kept, FLICKERING_FRAMES) - 2.0 : FLICKERING_FRAMES - 1.0) : kept;
#endif
    float frames = keep ? min(kept + 1.0, max_frames) : 1.0, weight = 1.0 / frames;

    out_deviation = 0.0;
#if defined(SETTLED) || defined(CAMERA_RESTS)
    float change = ycocg(now - history).x, variance_before = share < 1.0 ? 0.0 : spread * spread;
#if defined(SETTLED) && defined(GATHERS_REFLECTIONS)
    // Pixel by pixel, so that later ones of the first frames have more of them, and count more.
    if (still) weight = 1.0 / (frames - 0.5 * (min(frames, RISING_FRAMES) - 1.0));
#endif
    if (keep) out_deviation = min(sqrt((1.0 - weight) * (variance_before + change * change * weight)), HALF_MAX);
#endif
#ifdef WRITE_RESAMPLED
    vec2 fraction = fract(back);  // half a texel blurs most, a whole one not at all
    float blur = 2.0 * dot(fraction, 1.0 - fraction);
    float resamplings = texelFetch(resampled_prev, clamp(before, ivec2(0), last), 0).r;
    resamplings = is_finite(resamplings) ? max(resamplings, 0.0) + blur : blur;
    out_resampled = keep ? min(resamplings, MOVING_FRAMES) * (1.0 - 1.0 / frames) : 0.0;
#endif
    out_taa = vec4(keep ? min(mix(history, now, weight), HALF_MAX) : now, frames);
}
