// Soft shadows by percentage closer soft shadows: blocker search, penumbra estimate, filtered lookup
// (Fernando 2005), with two changes. A tap is a point on the light projected through the mean blocker, so
// spheres, rectangles and parallel light share one code. And a tap compares its texel with the receiver's
// plane at the texel's own centre, so flat receivers need no bias however wide the kernel.
#include "lights.glsl"
#include "shadow_tile.glsl"

const int NO_MAP = 0;
const int SINGLE_MAP = 1;
const int CUBE_MAP = 2;
const int PARALLEL_MAP = 3;

const int TAPS = 4;                    // per texel, of the search and of the filter's first look; a quad shares them
const int PENUMBRA_TAPS = 12;          // more of the filter inside penumbrae
const float HARD_KERNEL = 1.0;         // kernels with a smaller radius, in texels, are filtered bilinearly
const float NEAREST_BLOCKER = 0.15;    // blockers nearer to the light than this share of the way are not searched
const float NORMAL_OFFSET = 1.5;       // texels
const float DISTANCE_BIAS = 5e-4;      // relative
const float QUAD_BLEND = 0.7;          // share of the quad's mean in the visibility of flat, soft quads

uniform sampler2D shadow;
#ifdef HAS_SOFT_LIGHT
uniform sampler2D shadow_bounds;
#endif
uniform float noise_phase;  // turns the sampling pattern, from the seed

// Fixed per texel, so that still pictures stay still (Jimenez 2014, interleaved gradient noise).
float texel_noise(vec2 pixel)
{
    return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715))) + noise_phase);
}

// Sum over the 2x2 texels that are shaded together. Not for use where they may part ways.
float quad_sum(float x)
{
    vec2 side = 1.0 - 2.0 * mod(floor(gl_FragCoord.xy), 2.0);
    x += x + dFdxFine(x) * side.x;
    return x + x + dFdyFine(x) * side.y;
}

// Index 0 to 3 of the texel in its quad.
float quad_lane()
{
    vec2 odd = mod(floor(gl_FragCoord.xy), 2.0);
    return odd.x + 2.0 * odd.y;
}

// Points on the light by Roberts' R2 sequence, whose every stretch is well spread.
struct Pattern {
    float k;
    float noise;
    vec2 spiral;
};

Pattern pattern_from(float first, float noise)
{
    float angle = 2.0 * PI * fract(noise + 0.56984029 * first);
    return Pattern(first, noise, vec2(cos(angle), sin(angle)));
}

// The next point: on the unit disc or, for rectangles, in the square [-1, 1]².
vec2 next_point(inout Pattern s, bool square)
{
    const mat2 TURN = mat2(-0.90525386, -0.42487109, 0.42487109, -0.90525386);
    float u = fract(0.5 + 0.75487767 * s.k);
    vec2 at = s.spiral * sqrt(u);
#ifdef HAS_RECT_LIGHT
    if (square) at = vec2(fract(u + s.noise * 7.31), fract(s.noise + 0.56984029 * s.k)) * 2.0 - 1.0;
#endif
    s.spiral = TURN * s.spiral;
    s.k += 1.0;
    return at;
}

#ifdef HAS_SOFT_LIGHT
// The four texels of a quad search together, so they need one noise value.
Pattern search_pattern()
{
    return pattern_from(quad_lane() * float(TAPS), texel_noise(floor(gl_FragCoord.xy * 0.5) * 2.0));
}

// How many taps more a texel takes whose quad's first ones saw both light and shadow.
int penumbra_taps(bool soft, float passed)
{
    float taken = quad_sum(soft ? float(TAPS) : 0.0), seen = quad_sum(soft ? passed : 0.0);
    return soft && seen > 0.0 && seen < taken ? PENUMBRA_TAPS : 0;
}

// Visibility from the taps that passed; where a whole quad lies on one plane in a penumbra, blended with its mean.
float soft_visibility(float passed, int more, vec3 p, vec3 n)
{
    float lit = passed / float(TAPS + more);
    vec3 dx = dFdxFine(p), dy = dFdyFine(p);
    bool flat_here = abs(dot(n, dx)) < 0.1 * length(dx) && abs(dot(n, dy)) < 0.1 * length(dy);
    float together = quad_sum(flat_here && more > 0 ? 1.0 : 0.0);
    return mix(lit, 0.25 * quad_sum(lit), together == 4.0 ? QUAD_BLEND : 0.0);
}
#endif

#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
// Where a direction falls on a light's map: u and v in [-1, 1] on the square at corner, whose texels lie in
// directions forward + u right + v up.
struct MapPoint {
    vec2 uv;
    vec2 corner;
    vec3 normal;   // the receiver's normal in the square's coordinates (right, up, forward)
    float square;  // squared length of right and up
};

// Without branches, since software rasterisers walk through both sides of each.
MapPoint map_point(Light light, vec3 q, vec3 n)
{
#ifdef HAS_SINGLE_MAP
    vec3 x = light.frame_x.xyz, y = light.frame_y.xyz, z = light.frame_z.xyz;
    float square = 1.0 / dot(x, x);
    MapPoint single = MapPoint(clamp(vec2(dot(x, q), dot(y, q)) / max(dot(z, q), 1e-30), -1.0, 1.0), light.tile.xy,
                               vec3(dot(x, n) * square, dot(y, n) * square, dot(z, n)), square);
#ifndef HAS_CUBE_MAP
    return single;
#endif
#endif
#ifdef HAS_CUBE_MAP
    vec3 a = abs(q);
    bool along_z = a.z >= max(a.x, a.y);
    bool along_x = !along_z && a.x >= a.y;
    float major = along_z ? q.z : along_x ? q.x : q.y;
    float s = major < 0.0 ? -1.0 : 1.0;
    float index = along_z ? 0.5 + 0.5 * s : along_x ? 2.5 + 0.5 * s : 4.5 - 0.5 * s;
    vec2 uv = vec2(along_z ? -s * q.x : along_x ? s * q.z : q.x, along_z || along_x ? q.y : s * q.z) / abs(major);
    vec3 turned = vec3(along_z ? -s * n.x : along_x ? s * n.z : n.x, along_z || along_x ? n.y : s * n.z,
                       s * (along_z ? n.z : along_x ? n.x : n.y));
    vec2 place = index < 3.0 ? vec2(index, 0.0) : vec2(index - 3.0, 1.0);
    MapPoint cube = MapPoint(uv, light.tile.xy + light.tile.z * place, turned, 1.0);
#ifndef HAS_SINGLE_MAP
    return cube;
#endif
#endif
#if defined(HAS_CUBE_MAP) && defined(HAS_SINGLE_MAP)
    return int(light.tile.w) == SINGLE_MAP ? single : cube;
#endif
}

// A receiver as its light sees it.
struct Receiver {
    float reach;   // distance from the light, less the bias
    float offset;  // distance of its plane from the light, less the bias
    float size;    // texels along a square of the map
};

// Whether a distance stored in direction d lies before the receiver: nearer than the receiver itself (a wall
// behind it is no blocker) and before its plane (its own surface is none either). length_d belongs to d.
bool before_receiver(Receiver r, float stored, float slope, float length_d)
{
    return stored < r.reach && -slope * stored < r.offset * length_d;
}

bool texel_blocks(Receiver r, MapPoint m, vec2 texel)
{
    texel = clamp(texel, 0.0, r.size - 1.0);
    float stored = texelFetch(shadow, ivec2(m.corner + texel), 0).r;
    vec2 d = (texel + 0.5) / r.size * 2.0 - 1.0;
    return before_receiver(r, stored, dot(m.normal, vec3(d, 1.0)), sqrt(1.0 + m.square * dot(d, d)));
}

// Four neighbouring texels compared, then interpolated: the smoothest hard shadow a map can give.
float hard_visibility(Receiver r, MapPoint m)
{
    vec2 at = (m.uv * 0.5 + 0.5) * r.size - 0.5;
    vec2 base = clamp(floor(at), 0.0, r.size - 2.0);
    vec2 f = clamp(at - base, 0.0, 1.0);
    vec4 lit = vec4(texel_blocks(r, m, base) ? 0.0 : 1.0, texel_blocks(r, m, base + vec2(1.0, 0.0)) ? 0.0 : 1.0,
                    texel_blocks(r, m, base + vec2(0.0, 1.0)) ? 0.0 : 1.0,
                    texel_blocks(r, m, base + vec2(1.0, 1.0)) ? 0.0 : 1.0);
    return mix(mix(lit.x, lit.y, f.x), mix(lit.z, lit.w, f.x), f.y);
}

#ifdef HAS_SOFT_LIGHT
// The smallest distance in the tile around a direction if it lies before the whole tile's part of the
// receiver's plane, else 0; and whether the largest one does too.
float blocker_distance(Receiver r, MapPoint m, out bool all_block)
{
    float tiles = r.size / float(TILE);
    vec2 tile = clamp(floor((m.uv * 0.5 + 0.5) * tiles), 0.0, tiles - 1.0);
    vec2 bounds = texelFetch(shadow_bounds, ivec2(m.corner / float(TILE) + tile), 0).rg;
    vec2 d = (tile + 0.5) / tiles * 2.0 - 1.0;
    float steepest = dot(m.normal, vec3(d, 1.0)) - (abs(m.normal.x) + abs(m.normal.y)) / tiles;
    float shortest = sqrt(1.0 + m.square * dot(d, d)) - 1.5 / tiles;
    all_block = before_receiver(r, bounds.y, steepest, shortest);
    return before_receiver(r, bounds.x, steepest, shortest) ? bounds.x : 0.0;
}
#endif

#ifdef HAS_SOFT_LIGHT
// The light as seen from a receiver, projected to a share of the way from the light to the receiver.
struct Disc {
    vec3 p;
    vec3 axis_u;
    vec3 axis_v;
    float share;
    bool square;
};

vec3 next_tap(Disc disc, inout Pattern pattern)
{
    vec2 s = next_point(pattern, disc.square);
    return disc.p * disc.share + (disc.axis_u * s.x + disc.axis_v * s.y) * (1.0 - disc.share);
}

float passed_taps(Light light, Receiver r, Disc disc, vec3 n, inout Pattern pattern, int taps)
{
    float passed = 0.0;
    for (int i = 0; i < taps; ++i) {
        MapPoint m = map_point(light, next_tap(disc, pattern), n);
        passed += texel_blocks(r, m, floor((m.uv * 0.5 + 0.5) * r.size)) ? 0.0 : 1.0;
    }
    return passed;
}
#endif

// Share of a point, sphere, spot or rectangle light that relative point p with face normal n sees. Where the
// answer is not wanted, loops don't run: software rasterisers skip a loop that no texel of a group enters.
float radial_visibility(Light light, vec3 p, vec3 n, float noise, bool wanted)
{
    p -= light.position.xyz;
    p += n * (NORMAL_OFFSET * 2.0 / light.tile.z * length(p));
    float reach = length(p);
    Receiver r = Receiver(reach * (1.0 - DISTANCE_BIAS), -dot(n, p) * (1.0 - DISTANCE_BIAS), light.tile.z);
    float lit = hard_visibility(r, map_point(light, p, n));
#ifdef HAS_SOFT_LIGHT
#ifdef HAS_RECT_LIGHT
    bool square = int(light.color.w) == RECT;
    float radius = square ? max(length(light.u.xyz), length(light.v.xyz)) : light.position.w;
#else
    const bool square = false;
    float radius = light.position.w;
#endif
    vec3 side = abs(p.y) < 0.9 * reach ? vec3(p.z, 0.0, -p.x) : vec3(0.0, -p.z, p.y);
    vec3 axis_u = side * (radius * inversesqrt(max(dot(side, side), 1e-30)));
    vec3 axis_v = cross(axis_u, p) / reach;
#ifdef HAS_RECT_LIGHT
    axis_u = square ? light.u.xyz : axis_u;
    axis_v = square ? light.v.xyz : axis_v;
#endif

    Disc disc = Disc(p, axis_u, axis_v, max(NEAREST_BLOCKER, min(2.0 * radius / reach, 0.9)), square);
    Pattern search = search_pattern();
    float sum = 0.0, hits = 0.0, misses = 0.0;
    int taps = wanted && radius > 0.0 ? TAPS : 0;
    for (int i = 0; i < taps; ++i) {
        bool all_block;
        float found = blocker_distance(r, map_point(light, next_tap(disc, search), n), all_block);
        sum += found;
        hits += found > 0.0 ? 1.0 : 0.0;
        misses += all_block ? 0.0 : 1.0;
    }
    hits = quad_sum(hits);
    disc.share = clamp(quad_sum(sum) / max(hits, 1.0) / reach, 1e-3, 1.0);
    float kernel = radius / reach * (1.0 - disc.share) / disc.share * 0.5 * r.size;
    bool umbra = quad_sum(misses) == 0.0;
    lit = taps > 0 && umbra ? 0.0 : lit;
    bool soft = taps > 0 && hits > 0.0 && !umbra && kernel > HARD_KERNEL;
    Pattern filtering = pattern_from(0.0, noise);
    float passed = passed_taps(light, r, disc, n, filtering, soft ? TAPS : 0);
    int more = penumbra_taps(soft, passed);
    passed += passed_taps(light, r, disc, n, filtering, more);
    float filtered = soft_visibility(passed, more, p, n);
    lit = soft ? filtered : lit;
#endif
    return lit;
}
#endif

#ifdef HAS_PARALLEL_MAP
// A receiver in the map of parallel light: its plane is depth + dot(gradient, offset in [-1, 1]).
struct ParallelReceiver {
    vec2 uv;
    float depth;
    vec2 gradient;
};

bool parallel_blocks(Light light, ParallelReceiver r, vec2 texel)
{
    texel = clamp(texel, vec2(0.0), vec2(light.tile.z - 1.0));
    float stored = texelFetch(shadow, ivec2(light.tile.xy + texel), 0).r;
    vec2 offset = (texel + 0.5) / light.tile.z * 2.0 - 1.0 - r.uv;
    return stored < r.depth + min(dot(r.gradient, offset), 0.0);
}

#ifdef HAS_SOFT_LIGHT
// As blocker_distance, for parallel light; -1 where nothing blocks.
float parallel_blocker(Light light, ParallelReceiver r, vec2 uv, out bool all_block)
{
    float tiles = light.tile.z / float(TILE);
    vec2 tile = clamp(floor((uv * 0.5 + 0.5) * tiles), 0.0, tiles - 1.0);
    vec2 bounds = texelFetch(shadow_bounds, ivec2(light.tile.xy / float(TILE) + tile), 0).rg;
    vec2 offset = (tile + 0.5) / tiles * 2.0 - 1.0 - r.uv;
    float stop = r.depth + min(dot(r.gradient, offset) - (abs(r.gradient.x) + abs(r.gradient.y)) / tiles, 0.0);
    all_block = bounds.y < stop;
    return bounds.x < stop ? bounds.x : -1.0;
}
#endif

#ifdef HAS_SOFT_LIGHT
float parallel_passed_taps(Light light, ParallelReceiver r, float kernel, inout Pattern pattern, int taps)
{
    float passed = 0.0;
    for (int i = 0; i < taps; ++i) {
        vec2 tap = r.uv + next_point(pattern, false) * kernel;
        passed += parallel_blocks(light, r, floor((tap * 0.5 + 0.5) * light.tile.z)) ? 0.0 : 1.0;
    }
    return passed;
}
#endif

// Share of a directional light's disc that relative point p with face normal n sees.
float parallel_visibility(Light light, vec3 p, vec3 n, float noise, bool wanted)
{
    float half_width = light.u.x, size = light.tile.z;
    float c = max(dot(n, light.position.xyz), 0.05);
    p += n * (NORMAL_OFFSET * 2.0 / size * half_width);
    vec3 axis_x = light.frame_x.xyz, axis_y = light.frame_y.xyz;
    ParallelReceiver r;
    r.uv = vec2(dot(axis_x, p) + light.frame_x.w, dot(axis_y, p) + light.frame_y.w) / half_width;
    r.depth = dot(light.frame_z.xyz, p) + light.frame_z.w - DISTANCE_BIAS * half_width;
    r.gradient = vec2(dot(n, axis_x), dot(n, axis_y)) / c * half_width;
    vec2 at = (r.uv * 0.5 + 0.5) * size - 0.5;
    vec2 base = floor(at), f = at - base;
    vec4 four = vec4(parallel_blocks(light, r, base) ? 0.0 : 1.0, parallel_blocks(light, r, base + vec2(1.0, 0.0)) ? 0.0 : 1.0,
                     parallel_blocks(light, r, base + vec2(0.0, 1.0)) ? 0.0 : 1.0,
                     parallel_blocks(light, r, base + vec2(1.0, 1.0)) ? 0.0 : 1.0);
    float lit = mix(mix(four.x, four.y, f.x), mix(four.z, four.w, f.x), f.y);
#ifdef HAS_SOFT_LIGHT
    float spread = light.position.w / half_width;  // growth of the kernel in map units per unit of depth
    float width = spread * min(r.depth, 0.5 * half_width);
    Pattern search = search_pattern();
    float sum = 0.0, hits = 0.0, misses = 0.0;
    int taps = wanted && width * 0.5 * size > HARD_KERNEL ? TAPS : 0;
    for (int i = 0; i < taps; ++i) {
        bool all_block;
        float found = parallel_blocker(light, r, r.uv + next_point(search, false) * width, all_block);
        sum += max(found, 0.0);
        hits += found >= 0.0 ? 1.0 : 0.0;
        misses += all_block ? 0.0 : 1.0;
    }
    hits = quad_sum(hits);
    float kernel = spread * max(r.depth - quad_sum(sum) / max(hits, 1.0), 0.0);
    bool umbra = quad_sum(misses) == 0.0;
    lit = taps > 0 && umbra ? 0.0 : lit;
    bool soft = taps > 0 && hits > 0.0 && !umbra && kernel * 0.5 * size > HARD_KERNEL;
    Pattern filtering = pattern_from(0.0, noise);
    float passed = parallel_passed_taps(light, r, kernel, filtering, soft ? TAPS : 0);
    int more = penumbra_taps(soft, passed);
    passed += parallel_passed_taps(light, r, kernel, filtering, more);
    float filtered = soft_visibility(passed, more, p, n);
    lit = soft ? filtered : lit;
#endif
    return lit;
}
#endif

// Share of the light that relative point p with face normal n sees; of no meaning unless wanted.
float visibility(Light light, vec3 p, vec3 n, float noise, bool wanted)
{
#ifdef HAS_PARALLEL_MAP
    if (int(light.tile.w) == PARALLEL_MAP) return parallel_visibility(light, p, n, noise, wanted);
#endif
#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
    return radial_visibility(light, p, n, noise, wanted);
#else
    return 1.0;
#endif
}
