// Accumulates demodulated indirect light over frames at low resolution: each texel follows its surface by motion and
// blends with its history, so that the network's aliased inputs don't flicker.
#include "numbers.glsl"
#include "camera.glsl"
#include "nearest_texel.glsl"
#include "history.glsl"

const float MEAN_LEVEL = 4.0;  // mip level of the 16x16 mean that noisy light is compared with

uniform sampler2D indirect_now;
uniform sampler2D lowres_gbuffer;
uniform sampler2D motion;
uniform sampler2D indirect_low_prev;  // rgb: history, a: frames accumulated
uniform sampler2D lowres_gbuffer_prev;
uniform vec2 ratio;  // full-resolution texels per low-resolution texel
uniform float max_frames;  // of history
uniform bool history_valid;

layout(location = 0) out vec4 out_indirect_low;

struct Receiver {
    vec3 normal;   // relative space
    float previous;  // 1 / depth in the previous frame
    vec2 slope;    // of its plane; see plane_slope
};

// Adds a history texel at distance ``away`` from the receiver's previous position if it shows the same surface.
void add(ivec2 low, vec2 away, Receiver r, inout vec4 sum, inout float weight)
{
    vec4 old = texelFetch(indirect_low_prev, low, 0), surface = texelFetch(lowres_gbuffer_prev, low, 0);
    bool same = all(greaterThanEqual(low, ivec2(0))) && all(lessThan(low, textureSize(indirect_low_prev, 0)))
        && same_surface(surface.a > 0.0 ? 1.0 / surface.a : 0.0, r.previous * (1.0 + dot(r.slope * ratio, away)), r.slope,
                        surface.xyz, r.normal)
        && is_finite(dot(old, vec4(1.0))) && old.a >= 1.0;
    float closeness = (1.0 - abs(away.x)) * (1.0 - abs(away.y));
    sum += same ? vec4(max(old.rgb, 0.0), old.a) * closeness : vec4(0.0);
    weight += same ? closeness : 0.0;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy), full = nearest_texel(low, ratio);
    vec3 now = sanitize_radiance(texelFetch(indirect_now, low, 0).rgb);
    vec4 surface = texelFetch(lowres_gbuffer, low, 0);
    vec3 moved = texelFetch(motion, full, 0).xyz;
    Receiver r = Receiver(surface.xyz, 1.0 / (surface.a * moved.z), plane_slope(surface.xyz, vec2(full) + 0.5));
    vec2 at = gl_FragCoord.xy - moved.xy * vec2(1.0, -1.0) / ratio - 0.5;
    ivec2 base = ivec2(floor(at));
    vec2 f = at - vec2(base);
    vec4 sum = vec4(0.0);
    float weight = 0.0;
    add(base, vec2(0.0, 0.0) - f, r, sum, weight);
    add(base + ivec2(1, 0), vec2(1.0, 0.0) - f, r, sum, weight);
    add(base + ivec2(0, 1), vec2(0.0, 1.0) - f, r, sum, weight);
    add(base + ivec2(1, 1), vec2(1.0, 1.0) - f, r, sum, weight);
    bool keep = history_valid && weight > 0.05 && is_surface(surface.a);
    vec4 history = sum / max(weight, 1e-6);
    vec3 bright = now;
#ifdef NOISY
    vec2 here = gl_FragCoord.xy / vec2(textureSize(indirect_now, 0));
    bright = max(now, sanitize_radiance(textureLod(indirect_now, here, MEAN_LEVEL).rgb));
#endif
    history.rgb = without_flash(history.rgb, bright);
    float frames = keep ? min(history.a * weight + 1.0, max_frames) : 1.0;
    out_indirect_low = vec4(keep ? mix(history.rgb, now, 1.0 / frames) : now, frames);
}
