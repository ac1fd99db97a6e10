// Smallest and largest distance in each tile of the shadow atlas: a map small enough to stay in the cache while
// the blocker search jumps about in it.
#include "shadow_tile.glsl"

uniform sampler2D shadow;
layout(location = 0) out vec2 out_bounds;

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * TILE;
    vec2 bounds = vec2(1e30, 0.0);
    for (int y = 0; y < TILE; ++y) {
        for (int x = 0; x < TILE; ++x) {
            float stored = texelFetch(shadow, corner + ivec2(x, y), 0).r;
            bounds = vec2(min(bounds.x, stored), max(bounds.y, stored));
        }
    }
    out_bounds = bounds;
}
