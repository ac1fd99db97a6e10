// The full-resolution texel at the centre of a low-resolution one. Values are never averaged, so none is made up
// between two surfaces.
ivec2 nearest_texel(ivec2 low, vec2 ratio)
{
    return ivec2((vec2(low) + 0.5) * ratio);
}
