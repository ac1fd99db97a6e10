// The finest level of a pyramid over light at low resolution: what surfaces have, and nothing in the sky.
#include "numbers.glsl"

uniform sampler2D light_low;
uniform sampler2D lowres_gbuffer;
uniform vec2 span;   // low-resolution texels per texel of the pyramid, at most 1

layout(location = 0) out vec4 out_light;  // rgb: times a, a: 1 on surfaces

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy * span);
    bool surface = is_surface(texelFetch(lowres_gbuffer, low, 0).a);
    out_light = surface ? vec4(sanitize_radiance(texelFetch(light_low, low, 0).rgb), 1.0) : vec4(0.0);
}
