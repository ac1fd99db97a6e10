// Hard shadows: the four texels of the map around a receiver are asked, and their answers interpolated. The map keeps
// the plane that each texel shows, and a texel blocks only if its point lies before the receiver's plane and the
// receiver behind the texel's. Two faces that meet, be it in a convex or in a concave edge, never shade each other by
// mistake then, so nothing is biased or moved off its surface, which would let light into creases and past overhangs.
#include "lights.glsl"
#include "numbers.glsl"
#include "quad.glsl"

const float SNAP = 1.0 / 64.0;  // texels by which rasterisation shifts surfaces, rounded up
const float ROUNDING = 2e-6;    // of inverse depth
const float RELIEF = 1.5;       // texels; parallel steps that are lower are too fine for the map
const float EDGE_TEXELS = 2.2;  // half the length along an edge over which the map is averaged; a longer one rounds corners and closes grids
const int EDGE_TAPS = 4;
const float FAINT = 0.9;        // difference of visibility across a quad's four places, up to which it is no edge,
const float CLEAR = 2.0;        // and from which it is a straight one
const float MAX_SHARPENING = 2.5;
const float MIN_MAGNIFICATION = 0.33;  // of texels of the map along one axis of the image if it is more than 1 along the other
const float MAX_RECEIVER_SLOPE = 1e5;

uniform sampler2D shadow_slope;

// A receiver in its light's map, whose places go from -1 to 1. The inverse depth is linear over the
// map along a plane: the receiver's depth divided by the depth, or for parallel light the negative depth in half widths of the map.
struct MapPlane {
    vec2 corner;     // of the light's square, in texels of the atlas
    vec2 at;
    vec2 slope;      // inverse depth that the receiver's plane gains along the map
    float inverse_depth;
    float depth;     // of the receiver; for parallel light half the map's width
    float wide;      // squared tangent of half the map's angle; for parallel light 1
    bool parallel;
    bool facing;     // the light; on its other side a surface shades itself
};

#ifdef HAS_PARALLEL_MAP
MapPlane parallel_plane(Light light, vec3 p, vec3 n)
{
    vec3 at = vec3(dot(light.frame_x.xyz, p) + light.frame_x.w, dot(light.frame_y.xyz, p) + light.frame_y.w,
                   dot(light.frame_z.xyz, p) + light.frame_z.w) / light.u.x;
    float away = dot(light.frame_z.xyz, n);
    vec2 slope = vec2(dot(light.frame_x.xyz, n), dot(light.frame_y.xyz, n)) / away;
    return MapPlane(light.tile.xy, at.xy, slope, -at.z, light.u.x, 1.0, true, away < 0.0);
}
#endif

#ifdef HAS_SINGLE_MAP
MapPlane single_plane(Light light, vec3 p, vec3 n)
{
    float away = dot(p, n), depth = max(dot(light.frame_z.xyz, p), 1e-30);
    float wide = 1.0 / dot(light.frame_x.xyz, light.frame_x.xyz);
    vec2 slope = vec2(dot(light.frame_x.xyz, n), dot(light.frame_y.xyz, n)) * (wide * depth / away);
    return MapPlane(light.tile.xy, vec2(dot(light.frame_x.xyz, p), dot(light.frame_y.xyz, p)) / depth, slope, 1.0,
                    depth, wide, false, away < 0.0);
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
    float away = dot(p, n), depth = max(abs(q.z), 1e-30);
    vec2 corner = light.tile.xy + light.tile.z * vec2(along_z ? 2.0 : along_x ? 0.0 : 1.0, q.z < 0.0 ? 0.0 : 1.0);
    return MapPlane(corner, q.xy / depth, edge * (depth / away), 1.0, depth, 1.0, false,
                    away < 0.0);
}
#endif

MapPlane map_plane(Light light, vec3 p, vec3 n)
{
    MapPlane r;
#ifdef HAS_CUBE_MAP
    if (int(light.tile.w) == CUBE_MAP) r = cube_plane(light, p - light.position.xyz, n);
#endif
#ifdef HAS_SINGLE_MAP
    if (int(light.tile.w) == SINGLE_MAP) r = single_plane(light, p - light.position.xyz, n);
#endif
#ifdef HAS_PARALLEL_MAP
    if (int(light.tile.w) == PARALLEL_MAP) r = parallel_plane(light, p, n);
#endif
    r.slope = clamp(r.slope, -MAX_RECEIVER_SLOPE, MAX_RECEIVER_SLOPE);
    return r;
}

// The four texels around a place in the map, one in each component: where they lie as seen from it, how near their planes come
// there and at the receiver, and how these slope.
struct MapTexels {
    vec4 weight;
    vec4 x;
    vec4 y;
    vec4 inverse_depth;
    vec4 at_receiver;
    vec4 slope_x;
    vec4 slope_y;
    vec4 surface;  // 1 where there is one
};

// Those that lie some texels away from a receiver.
MapTexels texels_around(Light light, MapPlane r, vec2 away)
{
    float unit = 2.0 / light.tile.z;
    vec2 place = (r.at + 1.0) / unit - 0.5 + away;
    vec2 base = clamp(floor(place), 0.0, light.tile.z - 2.0);
    vec2 f = clamp(place - base, 0.0, 1.0);
    MapTexels t;
    t.weight = vec4(1.0 - f.x, f.x, 1.0 - f.x, f.x) * vec4(1.0 - f.yy, f.yy);

    vec2 corner = (r.corner + base + 1.0) / vec2(textureSize(shadow, 0));
    vec4 stored = textureGather(shadow, corner).wzxy;
    t.slope_x = clamp(textureGather(shadow_slope, corner, 0).wzxy, -HALF_MAX, HALF_MAX);
    t.slope_y = clamp(textureGather(shadow_slope, corner, 1).wzxy, -HALF_MAX, HALF_MAX);
    t.surface = vec4(lessThan(stored, vec4(MAX_DISTANCE)));

    vec2 first = (base + 0.5) * unit - 1.0;
    t.x = first.x + vec4(0.0, unit, 0.0, unit);
    t.y = first.y + vec4(0.0, 0.0, unit, unit);
    if (r.parallel) {
        t.inverse_depth = -stored / r.depth;
    } else {
        t.inverse_depth = r.depth * sqrt(1.0 + r.wide * (t.x * t.x + t.y * t.y)) / stored;
        t.slope_x *= t.inverse_depth;
        t.slope_y *= t.inverse_depth;
    }
    t.x -= r.at.x;
    t.y -= r.at.y;
    t.at_receiver = t.inverse_depth - t.slope_x * t.x - t.slope_y * t.y;
    return t;
}

// Weight of those texels that light passes to a receiver, and of those that block it, some texels away from it in the map.
vec2 light_and_shadow(Light light, MapPlane r, vec2 away, float rounding)
{
    MapTexels t = texels_around(light, r, away);
    float unit = 2.0 / light.tile.z;
    float slack = SNAP * unit * (abs(r.slope.x) + abs(r.slope.y)) + rounding;
    vec4 slacks = SNAP * unit * (abs(t.slope_x) + abs(t.slope_y)) + rounding;
    float relief = RELIEF * unit * sqrt(r.wide);

    vec4 before_plane = t.inverse_depth - r.inverse_depth - r.slope.x * t.x - r.slope.y * t.y;
    vec4 before_receiver = t.at_receiver - r.inverse_depth;
    vec4 bend = (abs(t.slope_x - r.slope.x) + abs(t.slope_y - r.slope.y)) * unit;
    vec4 blocks = t.surface * vec4(greaterThan(before_plane, vec4(slack))) * vec4(greaterThan(before_receiver, slacks))
        * vec4(greaterThan(before_receiver + bend, vec4(relief)));
    vec4 dark = t.weight * blocks;
    float most = max(max(dark.x, dark.y), max(dark.z, dark.w));
    if (!(most > 0.0)) return vec2(1.0, 0.0);

    // Beside a blocker only those speak for light that show what lies behind its plane, not past the receiver's edge.
    vec4 first = vec4(equal(dark, vec4(most)));
    first /= dot(first, vec4(1.0));
    vec4 blocker = dot(first, t.at_receiver) + dot(first, t.slope_x) * t.x + dot(first, t.slope_y) * t.y;
    vec4 behind = vec4(lessThan(t.inverse_depth, blocker - dot(first, slacks)));
    vec4 past = vec4(lessThan(max(before_plane, before_receiver), vec4(-relief)));
    return vec2(dot(t.weight, (1.0 - blocks) * behind * (1.0 - past)), dot(dark, vec4(1.0)));
}

// Width of texels of the map in those of the image, the smaller one along its axes; 0 where the map is finer than the image
// along both, much finer along one, or the quad shows no plane. Texels of one point, as in surfel_light.frag, are no plane.
float magnification(Light light, MapPlane r, vec3 p, vec3 n)
{
    vec2 along_x = dFdxFine(r.at), along_y = dFdyFine(r.at);
    vec2 passed = vec2(dot(along_x, along_x), dot(along_y, along_y)) * (0.25 * light.tile.z * light.tile.z);  // squared texels
    float most = max(passed.x, passed.y);
    bool is_magnified = min(passed.x, passed.y) < 1.0 && most * MIN_MAGNIFICATION * MIN_MAGNIFICATION < 1.0;
    return quad_all(is_magnified && is_on_plane(p, n)) ? inversesqrt(most) : 0.0;
}

// Share of a light without a size that relative point p with face normal n sees. Where the map's texels would show, those of
// a quad look at four places around it. Between light and shadow, the map is averaged along the edge, which runs in steps
// there, and the edge made as sharp as the image.
float hard_visibility(Light light, vec3 p, vec3 n)
{
    MapPlane r = map_plane(light, p, n);
    float rounding = ROUNDING * max(1.0, abs(r.inverse_depth));
#ifdef HAS_PARALLEL_MAP
    // The map may be much smaller than the way from the eye, which positions are relative to.
    rounding = max(rounding, r.parallel ? ROUNDING * length(p) / r.depth : 0.0);
#endif
    float magnified = magnification(light, r, p, n), clearness = 0.0;
    vec2 side = quad_side(), to_middle = (0.25 * quad_sum(vec3(r.at, 0.0)).xy - r.at) * (0.5 * light.tile.z);
    vec2 away = magnified > 0.0 ? to_middle + side : vec2(0.0), along = vec2(0.0), sum = vec2(0.0);
    int look = 0, looks = 1;
    do {  // a software rasteriser runs the body of any other loop once more; a quad's texels make equally many turns
        vec2 found = light_and_shadow(light, r, away, rounding);
        vec3 of_quad = quad_sum(vec3(side, 1.0) * (found.x / max(found.x + found.y, 1e-6)));
        if (look == 0 && magnified > 0.0 && of_quad.z > 0.0 && of_quad.z < 4.0) {
            clearness = clamp((max(abs(of_quad.x), abs(of_quad.y)) - FAINT) / (CLEAR - FAINT), 0.0, 1.0);
            along = vec2(-of_quad.y, of_quad.x) * (EDGE_TEXELS * clearness / max(length(of_quad.xy), 1e-6));
            looks = 1 + EDGE_TAPS;
            found = vec2(0.0);
        }
        sum += found;
        away = along * ((float(look) + 0.5) * (2.0 / float(EDGE_TAPS)) - 1.0);
    } while (++look < looks);
    float visible = sum.x / max(sum.x + sum.y, 1e-6), sharpening = mix(1.0, clamp(magnified, 1.0, MAX_SHARPENING), clearness);
    return r.facing ? clamp((visible - 0.5) * sharpening + 0.5, 0.0, 1.0) : 0.0;
}
