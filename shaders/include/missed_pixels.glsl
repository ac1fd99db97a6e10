// Pixels that the low-resolution grid misses: at most one in a tile, TILE pixels a side, has light of its own.
ivec2 missed_texel(ivec2 tile, int number)
{
    return tile * TILE + ivec2(number % TILE, number / TILE);
}
