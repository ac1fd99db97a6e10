// Outgoing radiance on the low-resolution grid, from the texels nearest to its centres.
#include "channels.glsl"
#include "nearest_texel.glsl"

uniform vec2 ratio;  // full-resolution texels per low-resolution texel

layout(location = 0) out vec4 out_radiance;

void main()
{
    out_radiance = vec4(channel_radiance_rgb(nearest_texel(ivec2(gl_FragCoord.xy), ratio)), 1.0);
}
