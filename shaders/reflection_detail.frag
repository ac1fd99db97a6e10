// Reflections at full resolution, gathered while nothing moves: in each frame one pixel of each low-resolution texel gets the
// light along its own ray.
#include "numbers.glsl"
#include "nearest_texel.glsl"

const float MAX_SAMPLES = 256.0;

uniform sampler2D reflection_now;  // radiance; a: 0 for none
uniform sampler2D reflection_origin;  // a: 1 + number of the pixel where the ray started, negative on another surface
uniform sampler2D reflection_detail_prev;
uniform vec2 ratio;           // full-resolution texels per low-resolution texel
uniform bool history_stands;  // whether what was gathered before stands

layout(location = 0) out vec4 out_detail;  // radiance; a: number of samples

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy), last = textureSize(reflection_now, 0) - 1;
    ivec2 low = min(ivec2(gl_FragCoord.xy / ratio), last);
    vec4 before = texelFetch(reflection_detail_prev, texel, 0), now = texelFetch(reflection_now, low, 0);
    bool stands = history_stands && before.a >= 1.0 && is_finite(dot(before, vec4(1.0)));
    before = stands ? vec4(clamp(before.rgb, 0.0, HALF_MAX), min(before.a, MAX_SAMPLES)) : vec4(0.0);
    int number = int(abs(texelFetch(reflection_origin, low, 0).a)) - 1;
    bool sampled = number >= 0 && numbered_texel(low, ratio, number, textureSize(reflection_detail_prev, 0)) == texel
        && is_finite(dot(now, vec4(1.0))) && now.a != 0.0;
    float samples = before.a + 1.0;
    out_detail = sampled ? vec4(mix(before.rgb, clamp(now.rgb, 0.0, HALF_MAX), 1.0 / samples), samples) : before;
}
