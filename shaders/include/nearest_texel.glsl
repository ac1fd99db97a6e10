// The full-resolution texel that stands for a low-resolution one: the one at its centre. Picked, never
// averaged, so no value is made up between two surfaces.
ivec2 nearest_texel(ivec2 low, vec2 ratio)
{
    return ivec2((vec2(low) + 0.5) * ratio);
}
