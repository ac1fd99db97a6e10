// Normal and depth at low resolution, from the texels nearest to its centres. Later passes read them many times at
// scattered positions, so they have to fit into a cache.
#include "channels.glsl"
#include "nearest_texel.glsl"

uniform vec2 ratio;  // full-resolution texels per low-resolution texel

layout(location = 0) out vec4 out_lowres_gbuffer;  // normal, depth; a depth of 0 is sky

void main()
{
    ivec2 full = nearest_texel(ivec2(gl_FragCoord.xy), ratio);
    out_lowres_gbuffer = vec4(channel_normal_world_xyz(full), surface_depth(full));
}
