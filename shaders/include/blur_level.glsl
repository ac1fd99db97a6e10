// Where the levels of the pyramid are that rough glass blurs by, side by side in one texture: some drivers take one mipmap level for
// four pixels. Texels of level k are 2^(k + 1) pixels wide; ``finest`` is the size of level 0.

ivec2 level_size(ivec2 finest, int level) { return finest >> level; }

ivec2 level_corner(ivec2 finest, int level)
{
    return level == 0 ? ivec2(0) : ivec2(finest.x, finest.y - (finest.y >> (level - 1)));
}

// Size of level 0 of a texture that holds them all.
ivec2 finest_size(ivec2 all) { return ivec2(all.x - all.x / 3, all.y); }
