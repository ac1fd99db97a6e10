// Where the levels of the pyramid are that rough glass blurs by, side by side in one texture: some drivers take one mipmap level for
// four pixels. Texels of level k are 2^(k + 1) pixels wide; ``finest`` is the size of level 0.

ivec2 level_size(ivec2 finest, int level) { return finest >> level; }

ivec2 level_corner(ivec2 finest, int level)
{
    return level == 0 ? ivec2(0) : ivec2(finest.x, finest.y - (finest.y >> (level - 1)));
}

// Size of level 0 of a texture that holds them all.
ivec2 finest_size(ivec2 all) { return ivec2(all.x - all.x / 3, all.y); }

// Where a pixel of the image is among the texels of a level, whose middles have whole numbers.
vec2 level_position(vec2 pixel, int level) { return exp2(-float(level) - 1.0) * pixel - 0.5; }

// Where a level's texel, or the one at its border that is nearest to it, is in a texture of all levels.
ivec2 level_texel(ivec2 all, ivec2 texel, int level)
{
    ivec2 finest = finest_size(all);
    return level_corner(finest, level) + clamp(texel, ivec2(0), level_size(finest, level) - 1);
}
