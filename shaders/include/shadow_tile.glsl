// Shadow texels along the edge of one texel of the nearest map.
const int TILE = 8;
