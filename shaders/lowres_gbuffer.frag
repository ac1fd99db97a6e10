// Normal and depth at low resolution, from the texels nearest to its centres. Later passes read them many times at
// scattered positions, so they have to fit into a cache.
#include "channels.glsl"
#include "nearest_texel.glsl"

#ifdef SPARSE
const int STRIDE = 37;  // rows from column to column; coprime to the texel's side
#endif

uniform vec2 ratio;  // full-resolution texels per low-resolution texel

layout(location = 0) out vec4 out_lowres_gbuffer;  // normal, depth; a depth of 0 is sky

void main()
{
    ivec2 full = nearest_texel(ivec2(gl_FragCoord.xy), ratio);
#ifdef SPARSE  // one pixel of each column and row of the texel, so that none of what is long and thin is missed
    ivec2 first = ivec2(floor(gl_FragCoord.xy) * ratio), side = ivec2(ceil(ratio)), last = textureSize(depth, 0) - 1;
    int longer = max(side.x, side.y);
    for (int i = 0; i < longer && !is_surface(texelFetch(depth, full, 0).r); ++i)
        full = min(first + ivec2(i, i * STRIDE + 1) % longer, last);
#endif
    out_lowres_gbuffer = vec4(channel_normal_world_xyz(full), surface_depth(full));
}
