// What a network is fed of one packed tensor: clean, exposed, and padded by repeating the edge.
layout(local_size_x = 64) in;

#include "network_input.glsl"
#include "numbers.glsl"
#ifdef HAS_MEAN
#include "mean_radiance.glsl"
#endif

layout(std430, binding = 3) buffer Exposed { float exposed[]; };  // may be the packed tensor itself

uniform ivec2 grid;    // width and height of the packed tensor
uniform ivec2 padded;  // of the exposed one

int texel;  // of the packed tensor
int place;  // in the exposed one

void put(int row, int components, float background, float low, float high, float factor)
{
    for (int i = 0; i < components; ++i) {
        float x = factor * clean(tensor[(row + i) * plane + texel], background, low, high);
        exposed[(row + i) * padded.x * padded.y + place] = clamp(x, -HALF_MAX, HALF_MAX);
    }
}

void main()
{
#ifdef HAS_MEAN
    float exposure = 1.0 / max(means[1], MIN_MEAN_RADIANCE);
#endif
    int step = int(gl_NumWorkGroups.x * gl_WorkGroupSize.x);
    for (place = int(gl_GlobalInvocationID.x); place < padded.x * padded.y; place += step) {
        ivec2 from = min(ivec2(place % padded.x, place / padded.x), grid - 1);
        texel = from.y * grid.x + from.x;
#ifdef GUIDE_ROW
        float surface = surface_at(texel);
#endif
        PUT_CHANNELS
    }
}
