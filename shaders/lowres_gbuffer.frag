// Surfaces at low resolution: normal and depth of the texels that stand for the others. What is read many times at
// scattered places has to be small enough for a cache.
#include "channels.glsl"
#include "nearest_texel.glsl"

uniform vec2 ratio;  // full-resolution texels per low-resolution texel

layout(location = 0) out vec4 out_lowres_gbuffer;  // normal, depth; a depth of 0 is sky

void main()
{
    ivec2 full = nearest_texel(ivec2(gl_FragCoord.xy), ratio);
    out_lowres_gbuffer = vec4(channel_normal_world_xyz(full), surface_depth(full));
}
