// Packs one tensor of a network, NCHW and top row first, from the texels nearest to its grid's centres.
// PACK_CHANNELS is made from the contract: one store() per channel, in its order.
layout(local_size_x = 8, local_size_y = 8) in;

#include "channels.glsl"
#include "nearest_texel.glsl"
#ifdef PANORAMA
#include "panorama.glsl"
#endif

layout(std430, binding = 0) writeonly buffer Tensor { float tensor[]; };
#ifdef HAS_UNSHADOWED_DIFFUSE
uniform sampler2D unshadowed_diffuse;  // on the tensor's own grid
#endif
#ifdef HAS_UNSHADOWED_SPECULAR
uniform sampler2D unshadowed_specular;
#endif
#ifdef HAS_GATHERED_LIGHT
uniform sampler2D gathered_light;      // on the tensor's own grid; a: rays
#endif
#ifdef HAS_GATHERED_SURFELS
uniform sampler2D gathered_surfels;    // rgb: light between the surfels, a: mean distance of rays
#endif
uniform ivec2 grid;  // width and height of one image of the tensor

ivec2 low;   // texel of the tensor, bottom row first
int plane;   // values in one channel
int offset;  // of this texel in channel 0

#ifdef HAS_UNSHADOWED_DIFFUSE
vec3 channel_unshadowed_environment_diffuse_rgb(ivec2 t)
{
    return sanitize_radiance(texelFetch(unshadowed_diffuse, low, 0).rgb);
}
#endif

vec3 channel_unshadowed_environment_specular_rgb(ivec2 t)
{
#ifdef HAS_UNSHADOWED_SPECULAR
    return sanitize_radiance(texelFetch(unshadowed_specular, low, 0).rgb);
#else
    return vec3(0.0);
#endif
}

#ifdef HAS_GATHERED_LIGHT
vec3 channel_gathered_rgb(ivec2 t)
{
    return sanitize_radiance(texelFetch(gathered_light, low, 0).rgb);
}

float channel_gathered_count(ivec2 t)
{
    float count = texelFetch(gathered_light, low, 0).a;
    return is_finite(count) ? clamp(count, 0.0, HALF_MAX) : 0.0;
}
#endif

#ifdef HAS_GATHERED_SURFELS
float channel_gathered_distance(ivec2 t)
{
    float d = texelFetch(gathered_surfels, low, 0).a;
    return is_finite(d) ? clamp(d, 0.0, 1.0) : 0.0;
}

vec3 channel_interpolated_rgb(ivec2 t)
{
    return sanitize_radiance(texelFetch(gathered_surfels, low, 0).rgb);
}
#endif

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
    low = at.xy;
    int area = grid.x * grid.y;
    plane = area * int(gl_NumWorkGroups.z);
    offset = at.z * area + (grid.y - 1 - at.y) * grid.x + at.x;
#if defined(PANORAMA)
    ivec2 t = panorama_texel(at.xy);
#elif defined(GRID_CUBE)
    ivec2 t = ivec2(at.x + at.z * CUBE_SIZE, at.y);
#else
    ivec2 t = nearest_texel(at.xy, texel_span);
#endif
    PACK_CHANNELS
}
