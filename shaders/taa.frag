// Temporal anti-aliasing (Karis 2014, "High-Quality Temporal Supersampling"): jittered frames accumulated in a
// history that is reprojected by motion, rejected where a surface was hidden, and clipped to the variance of the
// neighbourhood in YCoCg (Salvi 2016, "An Excursion in Temporal Supersampling").
#include "numbers.glsl"
#include "camera.glsl"
#include "inverse_depth.glsl"
#include "quad.glsl"

const float CLIP_GAMMA = 1.25;      // standard deviations
const float SETTLED_GAMMA = 3.0;    // where history shows what is visible now, so only outliers are clipped
const float MOVING_FRAMES = 8.0;    // history length while something moves through the texel
const float SHARPNESS = 0.65;       // of the history's cubic filter; 0.5 is Catmull-Rom, which blurs moving textures
const float STILL_FRAMES = 256.0;
const float STILL_PIXELS = 0.01;    // motion below which a texel counts as still
const float DEPTH_TOLERANCE = 0.03; // relative

uniform sampler2D lit;
uniform sampler2D motion;      // w: inverse depth
uniform sampler2D taa_prev;    // rgb: history, a: frames accumulated
uniform sampler2D depth_prev;
uniform float near;            // distance of the near plane in scene units
uniform bool history_valid;
uniform bool settled;          // history shows what is visible now, so it is rejected only where motion contradicts it, and only outliers are clipped
#ifdef SKY
uniform mat3 previous_from_view;  // from this frame's camera space to the previous one's
uniform vec2 previous_lens;       // tangents of half its field of view
#endif

layout(location = WRITE_TAA) out vec4 out_taa;
#ifdef WRITE_RESAMPLED
uniform sampler2D resampled_prev;
layout(location = WRITE_RESAMPLED) out float out_resampled;  // how often the history was resampled, by its weight
#endif

vec3 ycocg(vec3 c)
{
    return vec3(dot(c, vec3(0.25, 0.5, 0.25)), 0.5 * (c.r - c.b), dot(c, vec3(-0.25, 0.5, -0.25)));
}

vec3 rgb(vec3 c)
{
    float t = c.x - c.z;
    return vec3(t + c.y, c.x + c.z, t - c.y);
}

vec3 current(ivec2 t)
{
    return sanitize_radiance(texelFetch(lit, t, 0).rgb);
}

// Cubic convolution (Keys 1981) as one bilinear fetch of the middle four texels and the four beside them, corners left
// out (after Jimenez 2016, "Filmic SMAA"); its lobes may make it negative. a: frames accumulated.
vec4 cubic(vec2 at)
{
    vec2 centre = floor(at - 0.5) + 0.5;
    vec2 f = at - centre;
    vec2 w0 = -SHARPNESS * f * (1.0 - f) * (1.0 - f);
    vec2 w1 = 1.0 + f * f * ((2.0 - SHARPNESS) * f - (3.0 - SHARPNESS));
    vec2 w3 = -SHARPNESS * f * f * (1.0 - f);
    vec2 w12 = 1.0 - w0 - w3;
    vec2 middle = centre + (w12 - w1) / w12;
    ivec2 c = ivec2(middle), last = ivec2(image.xy) - 1;
    ivec2 low = max(ivec2(centre) - 1, 0), high = min(ivec2(centre) + 2, last);
    c = clamp(c, ivec2(0), last);
    vec4 four = textureLod(taa_prev, middle * image.zw, 0.0);
    vec4 sum = vec4(four.rgb, 1.0) * (w12.x * w12.y)
        + vec4(texelFetch(taa_prev, ivec2(c.x, low.y), 0).rgb, 1.0) * (w12.x * w0.y)
        + vec4(texelFetch(taa_prev, ivec2(c.x, high.y), 0).rgb, 1.0) * (w12.x * w3.y)
        + vec4(texelFetch(taa_prev, ivec2(low.x, c.y), 0).rgb, 1.0) * (w0.x * w12.y)
        + vec4(texelFetch(taa_prev, ivec2(high.x, c.y), 0).rgb, 1.0) * (w3.x * w12.y);
    return vec4(sum.rgb / sum.a, four.a);
}

// Largest share of the way from the middle to c that stays in the box.
float clip_share(vec3 offset, vec3 half_size)
{
    vec3 ratio = abs(offset) / max(half_size, 1e-8);
    return 1.0 / max(1.0, max(ratio.x, max(ratio.y, ratio.z)));
}

// Mean and mean square of the 3x3 neighbourhood in YCoCg. Each texel of a quad fetches its own corner of the
// quad's 4x4 surroundings, and they hand each other what is theirs.
void neighbourhood(ivec2 t, ivec2 outward, vec3 own, out vec3 mean, out vec3 square)
{
    vec3 beside = ycocg(current(t + ivec2(outward.x, 0)));
    vec3 above = ycocg(current(t + ivec2(0, outward.y)));
    vec3 corner = ycocg(current(t + outward));
    vec3 inner = quad_swap_x(own), inner_above = quad_swap_x(above);
    vec3 row = own + beside + inner, row2 = own * own + beside * beside + inner * inner;
    mean = row + above + corner + inner_above + quad_swap_y(row);
    square = row2 + above * above + corner * corner + inner_above * inner_above + quad_swap_y(row2);
    mean /= 9.0;
    square /= 9.0;
}

#ifdef SKY
// Motion of the sky in pixels, y up: it is infinitely far away, so only the camera's rotation moves it.
vec2 sky_motion()
{
#ifdef ORTHOGRAPHIC
    return vec2(0.0);  // it has one colour
#endif
    vec3 previous = previous_from_view * view_ray(gl_FragCoord.xy + 0.5 * lens.zw * image.xy);
    if (previous.z >= 0.0) return vec2(1e9);  // was behind the camera
    vec2 at = (previous.xy / (-previous.z * previous_lens) * 0.5 + 0.5) * image.xy;
    return gl_FragCoord.xy - at;
}
#endif

// Motion of the nearest surface in and around the quad (z: inverse depth one frame ago, w: now), so that edges move with
// what is before them.
vec4 nearest_motion(ivec2 t, ivec2 outward)
{
    vec4 best = texelFetch(motion, t, 0), other = texelFetch(motion, t + outward, 0);
    best = other.w > best.w ? other : best;
    other = quad_swap_x(best);
    best = other.w > best.w ? other : best;
    other = quad_swap_y(best);
    best = other.w > best.w ? other : best;
#ifdef SKY
    if (best.w <= 0.0) return vec4(sky_motion(), 0.0, 0.0);
#endif
    return vec4(best.xy * vec2(1.0, -1.0), best.z > 0.0 ? best.w / best.z : 0.0, best.w);
}

// Whether a surface of the given inverse depth was visible one frame ago in or around the quad at texel t: between the
// nearest and the farthest there, so that jitter across an edge counts as seen.
bool was_visible(ivec2 t, ivec2 outward, float expected)
{
    ivec2 last = ivec2(image.xy) - 1;
    float here = inverse_depth(texelFetch(depth_prev, clamp(t, ivec2(0), last), 0).r, near);
    float beside = inverse_depth(texelFetch(depth_prev, clamp(t + outward, ivec2(0), last), 0).r, near);
    float low = min(here, beside), high = max(here, beside);
    low = min(low, quad_swap_x(low));
    low = min(low, quad_swap_y(low));
    high = max(high, quad_swap_x(high));
    high = max(high, quad_swap_y(high));
    return expected >= low * (1.0 - DEPTH_TOLERANCE) && expected <= high * (1.0 + DEPTH_TOLERANCE)
        && all(greaterThanEqual(t, ivec2(0))) && all(lessThanEqual(t, last));
}

void main()
{
    ivec2 last = ivec2(image.xy) - 1, t = min(ivec2(gl_FragCoord.xy), last);
    ivec2 outward = clamp(t - ivec2(quad_side()), ivec2(0), last) - t;
    vec3 now = current(t);
    vec4 moved = nearest_motion(t, outward);
    vec3 mean, square;
    neighbourhood(t, outward, ycocg(now), mean, square);
    vec3 deviation = sqrt(max(square - mean * mean, 0.0));

    bool still = dot(moved.xy, moved.xy) < STILL_PIXELS * STILL_PIXELS;
    vec2 back = still ? vec2(0.0) : is_finite(moved.x + moved.y) ? -moved.xy : vec2(1e9);
    ivec2 before = t + ivec2(floor(back + 0.5));
    vec4 accumulated = cubic(gl_FragCoord.xy + back);
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
