// Packs one tensor of a network, NCHW and top row first, from the texels that stand for its grid.
// PACK_CHANNELS is made from the contract: one STORE per channel, in its order.
layout(local_size_x = 8, local_size_y = 8) in;

#include "channels.glsl"
#include "pick.glsl"
#ifdef PANORAMA
#include "panorama.glsl"
#endif

layout(std430, binding = 0) writeonly buffer Tensor { float tensor[]; };
uniform ivec2 grid;  // width and height of one image of the tensor

int plane;   // values in one channel
int offset;  // of this texel in channel 0

void store(int channel, float x)
{
    tensor[channel * plane + offset] = x;
}

void store(int channel, vec3 v)
{
    for (int i = 0; i < 3; ++i) tensor[(channel + i) * plane + offset] = v[i];
}

void main()
{
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at.xy, grid))) return;
    int area = grid.x * grid.y;
    plane = area * int(gl_NumWorkGroups.z);
    offset = at.z * area + (grid.y - 1 - at.y) * grid.x + at.x;
#if defined(PANORAMA)
    ivec2 t = panorama_texel(at.xy);
#elif defined(GRID_CUBE)
    ivec2 t = ivec2(at.x + at.z * CUBE_SIZE, at.y);
#else
    ivec2 t = representative(at.xy, texel_span);
#endif
    PACK_CHANNELS
}
