// Numbers of a network's input tensor as the renderer packed them, and what the network is fed instead: numbers within
// the channels' ranges, and radiance only where a surface is. The guide is made from the contract.
layout(std430, binding = 0) buffer Packed { float tensor[]; };
layout(std430, binding = 1) buffer Guide { float guide[]; };  // tensor on the same grid that shows where surfaces are

uniform int plane;  // numbers in one channel of both

// Infinities become the ends of the range, NaN the background. clamp() alone need not see NaN.
float clean(float x, float background, float low, float high)
{
    return isnan(x) ? background : clamp(x, low, high);
}

#ifdef GUIDE_ROW
float surface_at(int texel)
{
    for (int i = 0; i < GUIDE_COMPONENTS; ++i) {
        if (clean(guide[(GUIDE_ROW + i) * plane + texel], 0.0, GUIDE_LOW, GUIDE_HIGH) != 0.0) return 1.0;
    }
    return 0.0;
}
#endif
