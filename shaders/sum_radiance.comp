// Sums the radiance of one input tensor of a network; each workgroup writes a partial sum.
layout(local_size_x = 256) in;

#include "network_input.glsl"
#include "mean_radiance.glsl"

const float NO_CAP = 1e30;

uniform int first;       // of the tensor's sums
uniform bool is_capped;  // whether the mean without a cap is known

shared vec2 partial[gl_WorkGroupSize.x];

float cap;
vec2 total;  // sum, count

void add(int row, int components, float high, float counts, int texel)
{
    for (int i = 0; i < components; ++i) {
        total += counts * vec2(min(clean(tensor[(row + i) * plane + texel], 0.0, 0.0, high), cap), 1.0);
    }
}

void main()
{
    int local = int(gl_LocalInvocationIndex), step = int(gl_NumWorkGroups.x * gl_WorkGroupSize.x);
    cap = is_capped ? MAX_RATIO_TO_MEAN * means[0] : NO_CAP;
    total = vec2(0.0);
    for (int texel = int(gl_GlobalInvocationID.x); texel < plane; texel += step) {
#ifdef GUIDE_ROW
        float surface = surface_at(texel);
#endif
        ADD_CHANNELS
    }
    partial[local] = total;
    for (int size = int(gl_WorkGroupSize.x) / 2; size > 0; size /= 2) {
        barrier();
        if (local < size) partial[local] += partial[local + size];
    }
    if (local == 0) sums[first + int(gl_WorkGroupID.x)] = partial[0];
}
