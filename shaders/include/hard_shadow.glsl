// Hard shadows: the four texels of the map around a receiver are asked, and their answers interpolated. The map keeps
// the plane that each texel shows, and a texel blocks only if its point lies before the receiver's plane and the
// receiver behind the texel's. Two faces that meet, be it in a convex or in a concave edge, never shade each other by
// mistake then, so nothing is biased or moved off its surface, which would let light into creases and past overhangs.
#include "lights.glsl"
#include "numbers.glsl"

const float SNAP = 1.0 / 64.0;  // texels by which rasterisation shifts surfaces, rounded up
const float ROUNDING = 2e-6;    // of nearness
const float STEEPEST = 1e5;     // slope of a receiver

uniform sampler2D shadow_slope;

// A receiver in its light's map, whose places go from -1 to 1. Nearness is what changes evenly over the map along a
// plane: the receiver's depth over the depth, or for parallel light the negative depth in half widths of the map.
struct MapPlane {
    vec2 corner;     // of the light's square, in texels of the atlas
    vec2 at;
    vec2 slope;      // nearness that the receiver's plane gains along the map
    float nearness;
    float depth;     // of the receiver; of parallel light: half the map's width
    float wide;      // squared tangent of half the map's angle; of parallel light: 0
    bool facing;     // the light; on its other side a surface shades itself
};

#ifdef HAS_PARALLEL_MAP
MapPlane parallel_plane(Light light, vec3 p, vec3 n)
{
    vec3 at = vec3(dot(light.frame_x.xyz, p) + light.frame_x.w, dot(light.frame_y.xyz, p) + light.frame_y.w,
                   dot(light.frame_z.xyz, p) + light.frame_z.w) / light.u.x;
    float away = dot(light.frame_z.xyz, n);
    vec2 slope = vec2(dot(light.frame_x.xyz, n), dot(light.frame_y.xyz, n)) / away;
    return MapPlane(light.tile.xy, at.xy, slope, -at.z, light.u.x, 0.0, away < 0.0);
}
#endif

#ifdef HAS_SINGLE_MAP
MapPlane single_plane(Light light, vec3 p, vec3 n)
{
    float away = dot(p, n), depth = max(dot(light.frame_z.xyz, p), 1e-30);
    float wide = 1.0 / dot(light.frame_x.xyz, light.frame_x.xyz);
    vec2 slope = vec2(dot(light.frame_x.xyz, n), dot(light.frame_y.xyz, n)) * (wide * depth / away);
    return MapPlane(light.tile.xy, vec2(dot(light.frame_x.xyz, p), dot(light.frame_y.xyz, p)) / depth, slope, 1.0,
                    depth, wide, away < 0.0);
}
#endif

#ifdef HAS_CUBE_MAP
MapPlane cube_plane(Light light, vec3 p, vec3 n)
{
    // Columns of squares are the axes x, y, z; rows their negative and positive ends (see lights.py).
    vec3 a = abs(p);
    bool along_z = a.z >= max(a.x, a.y), along_x = a.x >= a.y;
    vec3 q = along_z ? p : along_x ? p.yzx : p.zxy;
    vec2 edge = along_z ? n.xy : along_x ? n.yz : n.zx;
    float away = dot(p, n), depth = abs(q.z);
    vec2 corner = light.tile.xy + light.tile.z * vec2(along_z ? 2.0 : along_x ? 0.0 : 1.0, q.z < 0.0 ? 0.0 : 1.0);
    return MapPlane(corner, q.xy / depth, edge * (depth / away), 1.0, depth, 1.0, away < 0.0);
}
#endif

MapPlane map_plane(Light light, vec3 p, vec3 n)
{
#ifdef HAS_PARALLEL_MAP
    if (int(light.tile.w) == PARALLEL_MAP) return parallel_plane(light, p, n);
#endif
#ifdef HAS_SINGLE_MAP
    if (int(light.tile.w) == SINGLE_MAP) return single_plane(light, p - light.position.xyz, n);
#endif
#ifdef HAS_CUBE_MAP
    return cube_plane(light, p - light.position.xyz, n);
#else
    return MapPlane(vec2(0.0), vec2(0.0), vec2(0.0), 0.0, 1.0, 0.0, true);
#endif
}

bool blocks(Light light, MapPlane r, vec2 texel)
{
    vec2 at = (texel + 0.5) * (2.0 / light.tile.z) - 1.0, away = at - r.at;
    float stored = texelFetch(shadow, ivec2(r.corner + texel), 0).r;
    vec2 slope = texelFetch(shadow_slope, ivec2(r.corner + texel), 0).xy;
    float nearness = -stored / r.depth;
    if (r.wide > 0.0) {
        nearness = r.depth * sqrt(1.0 + r.wide * dot(at, at)) / stored;
        slope *= nearness;
    }
    float rounding = ROUNDING * max(1.0, abs(r.nearness));
    float before_plane = nearness - r.nearness - dot(r.slope, away);
    float before_receiver = nearness - r.nearness - dot(slope, away);
    vec2 snap = vec2(dot(abs(r.slope), vec2(1.0)), dot(abs(slope), vec2(1.0))) * (SNAP * 2.0 / light.tile.z);
    return stored < FAR && before_plane > snap.x + rounding && before_receiver > snap.y + rounding;
}

// Share of a light without a size that relative point p with face normal n sees.
float hard_visibility(Light light, vec3 p, vec3 n)
{
    MapPlane r = map_plane(light, p, n);
    r.slope = clamp(r.slope, -STEEPEST, STEEPEST);
    vec2 at = (r.at * 0.5 + 0.5) * light.tile.z - 0.5;
    vec2 base = clamp(floor(at), 0.0, light.tile.z - 2.0);
    vec2 f = clamp(at - base, 0.0, 1.0);
    float seen = 0.0;
    for (int i = 0; i < 4; ++i) {
        vec2 corner = vec2(i & 1, i >> 1);
        vec2 weight = mix(1.0 - f, f, corner);
        seen += blocks(light, r, base + corner) ? 0.0 : weight.x * weight.y;
    }
    return r.facing ? seen : 0.0;
}
