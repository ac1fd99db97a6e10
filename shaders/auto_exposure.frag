// Exposure that brings the picture's geometric mean luminance to middle grey (Reinhard et al. 2002, equations 1 and 2),
// approached over time in steps of equal ratio.
#include "numbers.glsl"

uniform sampler2D picture;  // the finished one
uniform sampler2D auto_exposure_prev;
uniform float adaptation;  // share of the way in this frame

const int SAMPLES = 64;            // along each side of the picture
const float MIDDLE_GREY = 0.18;
const float MIN_LUMINANCE = 1e-6;  // 17 steps of halves; darker texels show nothing

layout(location = 0) out float out_exposure;

void main()
{
    ivec2 size = textureSize(picture, 0);
    vec2 sum = vec2(0.0);
    for (int y = 0; y < SAMPLES; y++)
        for (int x = 0; x < SAMPLES; x++) {
            ivec2 texel = (ivec2(x, y) * 2 + 1) * size / (2 * SAMPLES);
            float l = luminance(sanitize_radiance(texelFetch(picture, texel, 0).rgb));
            sum += l >= MIN_LUMINANCE ? vec2(log2(l), 1.0) : vec2(0.0);
        }
    float target = log2(MIDDLE_GREY) - (sum.y > 0.0 ? sum.x / sum.y : 0.0);
    float before = texelFetch(auto_exposure_prev, ivec2(0), 0).r;
    bool follows = adaptation < 1.0 && is_finite(before) && before > 0.0;
    out_exposure = exp2(follows ? mix(log2(before), target, adaptation) : target);
}
