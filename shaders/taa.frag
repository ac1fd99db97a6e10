// Temporal anti-aliasing (Karis 2014, "High-Quality Temporal Supersampling"): jittered frames gathered in a
// history that is reprojected by motion, rejected where a surface was hidden, and clipped to the variance of the
// neighbourhood in YCoCg (Salvi 2016, "An Excursion in Temporal Supersampling").
#include "numbers.glsl"
#include "camera.glsl"

const float CLIP_GAMMA = 1.25;      // standard deviations
const float MOVING_FRAMES = 12.0;   // history length while something moves through the texel
const float STILL_FRAMES = 256.0;
const float STILL_PIXELS = 0.01;    // motion below which a texel counts as still
const float DEPTH_TOLERANCE = 0.03; // relative

uniform sampler2D lit;
uniform sampler2D depth;
uniform sampler2D motion;
uniform sampler2D taa_prev;    // rgb: history, a: frames gathered
uniform sampler2D depth_prev;
uniform bool history_valid;

layout(location = 0) out vec4 out_taa;

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

// Catmull-Rom in five bilinear fetches (Jimenez 2016, "Filmic SMAA"); its negative lobes are clamped.
vec3 catmull_rom(vec2 at)
{
    vec2 centre = floor(at - 0.5) + 0.5;
    vec2 f = at - centre;
    vec2 w0 = f * (-0.5 + f * (1.0 - 0.5 * f));
    vec2 w1 = 1.0 + f * f * (-2.5 + 1.5 * f);
    vec2 w3 = f * f * (-0.5 + 0.5 * f);
    vec2 w2 = 1.0 - w0 - w1 - w3;
    vec2 w12 = w1 + w2;
    vec2 low = (centre - 1.0) * image.zw, middle = (centre + w2 / w12) * image.zw, high = (centre + 2.0) * image.zw;
    vec4 sum = vec4(texture(taa_prev, middle).rgb, 1.0) * (w12.x * w12.y)
        + vec4(texture(taa_prev, vec2(middle.x, low.y)).rgb, 1.0) * (w12.x * w0.y)
        + vec4(texture(taa_prev, vec2(middle.x, high.y)).rgb, 1.0) * (w12.x * w3.y)
        + vec4(texture(taa_prev, vec2(low.x, middle.y)).rgb, 1.0) * (w0.x * w12.y)
        + vec4(texture(taa_prev, vec2(high.x, middle.y)).rgb, 1.0) * (w3.x * w12.y);
    return max(sum.rgb / sum.a, 0.0);
}

// Largest share of the way from the middle to c that stays in the box.
float clip_share(vec3 offset, vec3 half_size)
{
    vec3 ratio = abs(offset) / max(half_size, 1e-8);
    return 1.0 / max(1.0, max(ratio.x, max(ratio.y, ratio.z)));
}

// The motion of the nearest surface among the texel and its neighbours, so that edges move with what is before.
vec3 nearest_motion(ivec2 t, float d)
{
    ivec2 last = ivec2(image.xy) - 1, best = t;
    for (int i = 0; i < 4; ++i) {
        ivec2 n = clamp(t + ivec2((i & 1) * 2 - 1, (i >> 1) * 2 - 1), ivec2(0), last);
        float other = texelFetch(depth, n, 0).r;
        if (is_surface(other) && (other < d || !is_surface(d))) {
            d = other;
            best = n;
        }
    }
    return texelFetch(motion, best, 0).xyz;
}

// Whether the surface at t was visible one frame ago where it came from.
bool was_visible(vec2 at, float expected)
{
    if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, image.xy))) return false;
    float found = texelFetch(depth_prev, ivec2(at), 0).r;
    if (!is_surface(expected)) return !is_surface(found);
    return is_surface(found) && abs(found - expected) <= DEPTH_TOLERANCE * expected;
}

void main()
{
    ivec2 t = ivec2(gl_FragCoord.xy);
    vec3 now = current(t);
    out_taa = vec4(now, 1.0);
    if (!history_valid) return;

    float d = texelFetch(depth, t, 0).r;
    vec3 own = texelFetch(motion, t, 0).xyz;
    vec3 moved = nearest_motion(t, d);
    vec2 shift = vec2(moved.x, -moved.y);
    if (!(is_finite(shift.x) && is_finite(shift.y))) return;
    vec2 at = gl_FragCoord.xy - shift;
    bool still = dot(shift, shift) < STILL_PIXELS * STILL_PIXELS;

    vec3 mean = vec3(0.0), square = vec3(0.0);
    ivec2 last = ivec2(image.xy) - 1;
    for (int i = 0; i < 9; ++i) {
        ivec2 n = clamp(t + ivec2(i % 3 - 1, i / 3 - 1), ivec2(0), last);
        vec3 c = ycocg(current(n));
        mean += c;
        square += c * c;
    }
    mean /= 9.0;
    vec3 deviation = sqrt(max(square / 9.0 - mean * mean, 0.0));

    vec4 nearest = texelFetch(taa_prev, clamp(ivec2(at), ivec2(0), last), 0);
    vec3 history = still ? nearest.rgb : catmull_rom(at);
    bool healthy = is_finite(history.r + history.g + history.b) && nearest.a >= 1.0;
    float before = is_surface(d) ? own.z : 0.0;
    if (!healthy || !was_visible(gl_FragCoord.xy - vec2(own.x, -own.y), before)) return;

    vec3 offset = ycocg(history) - mean;
    float share = clip_share(offset, CLIP_GAMMA * deviation);
    history = max(rgb(mean + offset * share), 0.0);
    float frames = min(nearest.a * mix(0.25, 1.0, share) + 1.0, still ? STILL_FRAMES : MOVING_FRAMES);
    out_taa = vec4(min(mix(history, now, 1.0 / frames), HALF_MAX), frames);
}
