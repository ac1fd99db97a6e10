// The full-resolution texel at the centre of a low-resolution one. Values are never averaged, so none is made up
// between two surfaces.
ivec2 nearest_texel(ivec2 low, vec2 ratio)
{
    return ivec2((vec2(low) + 0.5) * ratio);
}

// The full-resolution texel at a place inside a low-resolution one, in [0, 1)^2.
ivec2 texel_inside(ivec2 low, vec2 ratio, vec2 inside, ivec2 size)
{
    return min(ivec2((vec2(low) + inside) * ratio), size - 1);
}

// One of them by its number, row by row.
ivec2 numbered_texel(ivec2 low, vec2 ratio, int number, ivec2 size)
{
    ivec2 texels = ivec2(ceil(ratio));
    return texel_inside(low, ratio, (vec2(number % texels.x, number / texels.x) + 0.5) / vec2(texels), size);
}

// The number of the one at its centre.
int number_of_centre(vec2 ratio)
{
    ivec2 texels = ivec2(ceil(ratio));
    return texels.y / 2 * texels.x + texels.x / 2;
}
