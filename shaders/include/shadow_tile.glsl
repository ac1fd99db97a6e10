// Shadow texels along the edge of one texel of the bounds map.
const int TILE = 8;
