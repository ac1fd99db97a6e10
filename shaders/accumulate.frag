// Accumulates demodulated indirect light over frames at low resolution: each texel follows its surface by motion and
// blends with its history, so that the network's aliased inputs don't flicker.
#include "lowres_history.glsl"

const float MEAN_LEVEL = 4.0;  // mip level of the 16x16 mean that noisy light is compared with

uniform sampler2D indirect_now;
uniform sampler2D indirect_low_prev;  // rgb: history, a: frames accumulated
uniform float max_frames;  // of history

layout(location = 0) out vec4 out_indirect_low;

void add(ivec2 low, float closeness, inout vec4 sum, inout float weight)
{
    vec4 old = texelFetch(indirect_low_prev, low, 0);
    bool healthy = is_finite(dot(old, vec4(1.0))) && old.a >= 1.0;
    sum += healthy ? vec4(max(old.rgb, 0.0), old.a) * closeness : vec4(0.0);
    weight += healthy ? closeness : 0.0;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
    vec3 now = sanitize_radiance(texelFetch(indirect_now, low, 0).rgb);
    Reprojection r = reproject(low);
    vec4 sum = vec4(0.0);
    float weight = 0.0;
    add(r.base, r.weights.x, sum, weight);
    add(r.base + ivec2(1, 0), r.weights.y, sum, weight);
    add(r.base + ivec2(0, 1), r.weights.z, sum, weight);
    add(r.base + ivec2(1, 1), r.weights.w, sum, weight);
    bool keep = weight > MIN_SHARE;
    vec4 history = sum / weight;  // if it is kept
    vec3 bright = now;
#ifdef NOISY
    vec2 here = gl_FragCoord.xy / vec2(textureSize(indirect_now, 0));
    bright = max(now, sanitize_radiance(textureLod(indirect_now, here, MEAN_LEVEL).rgb));
#endif
    history.rgb = without_flash(history.rgb, bright);
    float frames = keep ? min(history.a * weight + 1.0, max_frames) : 1.0;
    out_indirect_low = vec4(keep ? mix(history.rgb, now, 1.0 / frames) : now, frames);
}
