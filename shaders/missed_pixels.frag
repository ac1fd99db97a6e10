// For each tile of the image a pixel whose surface none of the four low-resolution texels around shows, if there is one.
// A frame with history tests only some pixels of a tile, other ones each time.
#include "numbers.glsl"
#include "grid.glsl"
#include "joint_bilateral.glsl"
#include "missed_pixels.glsl"

const int STRIDE = 37;  // between tested pixels; coprime to their number, so that all get their turn

uniform sampler2D normal;
uniform sampler2D depth;
uniform sampler2D lowres_gbuffer;
uniform vec2 ratio;  // full-resolution texels per low-resolution texel
uniform int first;   // pixel to test
uniform int tested;  // pixels of a tile

layout(location = 0) out vec4 out_missed_position;  // relative space; a: 1 + number of the pixel in its tile, or 0
layout(location = 1) out vec4 out_missed_surface;   // normal, depth

float shown(ivec2 low, float along, float closeness, BilateralReceiver r)
{
    vec4 surface = texelFetch(lowres_gbuffer, low, 0);
    return surface.a > 0.0 ? closeness * similarity(surface, along, r) : 0.0;
}

bool is_missed(vec2 pixel, vec3 n, float d)
{
    BilateralReceiver r = bilateral_receiver(pixel, n, d);
    Around t = texels_around(pixel, textureSize(lowres_gbuffer, 0), ratio, r);
    vec2 f = t.f, g = 1.0 - f;
    return shown(t.low, t.along_low.x + t.along_low.y, g.x * g.y, r)
        + shown(ivec2(t.high.x, t.low.y), t.along_high.x + t.along_low.y, f.x * g.y, r)
        + shown(ivec2(t.low.x, t.high.y), t.along_low.x + t.along_high.y, g.x * f.y, r)
        + shown(t.high, t.along_high.x + t.along_high.y, f.x * f.y, r) < SHOWN;
}

void main()
{
    ivec2 tile = ivec2(gl_FragCoord.xy);
    out_missed_position = out_missed_surface = vec4(0.0);
    for (int i = 0; i < tested; ++i) {
        int number = ((first + i) * STRIDE + tile.x * 11 + tile.y * 23) & (TILE * TILE - 1);
        ivec2 texel = missed_texel(tile, number);
        if (any(greaterThanEqual(texel, textureSize(depth, 0)))) continue;
        float d = texelFetch(depth, texel, 0).r;
        vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
        vec2 pixel = vec2(texel) + 0.5;
        if (!is_surface(d) || n == vec3(0.0) || !is_missed(pixel, n, d)) continue;
        out_missed_position = vec4(surface_point(pixel, d), float(1 + number));
        out_missed_surface = vec4(n, d);
        return;
    }
}
