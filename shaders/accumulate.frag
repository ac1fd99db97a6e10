// Indirect light gathered over frames at low resolution, before albedo and edges come in: each texel follows its
// surface by motion and mixes in what it was, so that the network's picks don't flicker.
#include "numbers.glsl"
#include "camera.glsl"
#include "pick.glsl"

const float DEPTH_TOLERANCE = 0.05;  // relative
const float SAME_NORMAL = 0.9;       // cosine
const float BRIGHTEST = 4.0;         // history counts as at most this many times what is now, or a flash would linger
const float AROUND = 4.0;            // level of the mean that noisy light is compared with: of 16x16 texels

uniform sampler2D indirect_now;
uniform sampler2D normal;
uniform sampler2D depth;
uniform sampler2D motion;
uniform sampler2D indirect_low_prev;  // rgb: history, a: frames gathered
uniform sampler2D normal_prev;
uniform sampler2D depth_prev;
uniform vec2 ratio;  // full-resolution texels per low-resolution texel
uniform float longest;  // history in frames
uniform bool history_valid;

layout(location = 0) out vec4 out_indirect_low;

// Adds one texel of the history if it shows the same surface.
void add(ivec2 low, float closeness, vec3 n, float expected, inout vec4 sum, inout float weight)
{
    ivec2 full = representative(low, ratio);
    vec4 old = texelFetch(indirect_low_prev, low, 0);
    float found = texelFetch(depth_prev, full, 0).r;
    bool same = all(greaterThanEqual(low, ivec2(0))) && all(lessThan(low, textureSize(indirect_low_prev, 0)))
        && is_surface(found) && abs(found - expected) <= DEPTH_TOLERANCE * expected
        && dot(texelFetch(normal_prev, full, 0).xyz, n) > SAME_NORMAL
        && is_finite(dot(old, vec4(1.0))) && old.a >= 1.0;
    sum += same ? vec4(max(old.rgb, 0.0), old.a) * closeness : vec4(0.0);
    weight += same ? closeness : 0.0;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy), full = representative(low, ratio);
    vec3 now = sanitize_radiance(texelFetch(indirect_now, low, 0).rgb);
    vec3 n = sanitize_normal(texelFetch(normal, full, 0).xyz);
    vec3 moved = texelFetch(motion, full, 0).xyz;
    float d = texelFetch(depth, full, 0).r, before = d * moved.z;
    vec2 at = gl_FragCoord.xy - moved.xy * vec2(1.0, -1.0) / ratio - 0.5;
    ivec2 base = ivec2(floor(at));
    vec2 f = at - vec2(base);
    vec4 sum = vec4(0.0);
    float weight = 0.0;
    add(base, (1.0 - f.x) * (1.0 - f.y), n, before, sum, weight);
    add(base + ivec2(1, 0), f.x * (1.0 - f.y), n, before, sum, weight);
    add(base + ivec2(0, 1), (1.0 - f.x) * f.y, n, before, sum, weight);
    add(base + ivec2(1, 1), f.x * f.y, n, before, sum, weight);
    bool keep = history_valid && weight > 0.05 && is_surface(d);
    vec4 history = sum / max(weight, 1e-6);
    vec3 bright = now;
#ifdef NOISY
    vec2 here = gl_FragCoord.xy / vec2(textureSize(indirect_now, 0));
    bright = max(now, sanitize_radiance(textureLod(indirect_now, here, AROUND).rgb));
#endif
    history.rgb = min(history.rgb, BRIGHTEST * max(max(bright.r, bright.g), bright.b));
    float frames = keep ? min(history.a + 1.0, longest) : 1.0;
    out_indirect_low = vec4(keep ? mix(history.rgb, now, 1.0 / frames) : now, frames);
}
