// The mean radiance of all inputs of a network, from the partial sums of their workgroups.
layout(local_size_x = 1) in;

#include "mean_radiance.glsl"

uniform int index;  // of the mean

void main()
{
    vec2 total = vec2(0.0);
    for (int i = 0; i < sums.length(); ++i) total += sums[i];
    means[index] = total.x / max(total.y, 1.0);
}
