// The kinds of shadow maps, and where directions lie in them.
#include "lights.glsl"

const int SINGLE_MAP = 1;
const int CUBE_MAP = 2;
const int PARALLEL_MAP = 3;

#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
// Texel of a light's map in direction q from the light, as a fraction of its squares, and the square's corner in
// texels. Without branches, since software rasterisers walk through both sides of each.
vec2 map_fraction(Light light, vec3 q, out vec2 corner)
{
    vec2 fraction;
#ifdef HAS_CUBE_MAP
    // Columns of squares are the axes x, y, z; rows their negative and positive ends (see lights.py).
    vec3 a = abs(q);
    bool along_z = a.z >= max(a.x, a.y);
    bool along_x = a.x >= a.y;
    vec3 turned = along_z ? q : along_x ? q.yzx : q.zxy;
    corner = light.tile.xy + light.tile.z * vec2(along_z ? 2.0 : along_x ? 0.0 : 1.0, turned.z < 0.0 ? 0.0 : 1.0);
    fraction = turned.xy * (0.5 / abs(turned.z)) + 0.5;
#endif
#ifdef HAS_SINGLE_MAP
    vec3 f = vec3(dot(light.frame_x.xyz, q), dot(light.frame_y.xyz, q), dot(light.frame_z.xyz, q));
    vec2 single = f.xy * (0.5 / max(f.z, 1e-30)) + 0.5;
#ifdef HAS_CUBE_MAP
    bool is_single = int(light.tile.w) == SINGLE_MAP;
    corner = is_single ? light.tile.xy : corner;
    fraction = is_single ? single : fraction;
#else
    corner = light.tile.xy;
    fraction = single;
#endif
#endif
    return fraction;
}
#endif
