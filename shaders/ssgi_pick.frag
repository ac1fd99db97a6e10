// Surfaces and the radiance that they send, from the texels that stand for those of the low-resolution grid. What is
// read many times at scattered places has to be small enough for a cache.
#include "channels.glsl"
#include "pick.glsl"

uniform vec2 ratio;  // full-resolution texels per low-resolution texel

layout(location = WRITE_SSGI_SURFACE) out vec4 out_surface;    // normal, depth; a depth of 0 is sky
layout(location = WRITE_SSGI_RADIANCE) out vec4 out_radiance;

void main()
{
    ivec2 full = representative(ivec2(gl_FragCoord.xy), ratio);
    out_surface = vec4(channel_normal_world_xyz(full), surface_depth(full));
    out_radiance = vec4(channel_radiance_rgb(full), 1.0);
}
