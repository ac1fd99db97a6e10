// What composite.frag adds of indirect specular light, on its own.
#include "numbers.glsl"
#include "reflected_light.glsl"

uniform sampler2D indirect;

layout(location = 0) out vec4 out_reflection;

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    out_reflection = vec4(reflected_light(texel, sanitize_radiance(texelFetch(indirect, texel, 0).rgb)), 1.0);
}
