// Smallest distance in each tile of the shadow atlas: a map small enough to stay in the cache while the blocker
// search jumps about in it.
#include "shadow_tile.glsl"

uniform sampler2D shadow;
layout(location = 0) out float out_nearest;

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * TILE;
    float nearest = 1e30;
    for (int y = 0; y < TILE; ++y) {
        for (int x = 0; x < TILE; ++x) {
            nearest = min(nearest, texelFetch(shadow, corner + ivec2(x, y), 0).r);
        }
    }
    out_nearest = nearest;
}
