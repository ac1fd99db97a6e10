// Soft shadows by percentage closer soft shadows: blocker search, penumbra estimate, filtered lookup
// (Fernando 2005), with three changes. A tap is a point on the light projected through the mean blocker, so spheres
// and rectangles share one code. It compares its texel with the receiver's plane in the tap's direction, so flat
// receivers need no more bias for wide kernels. And the four texels of a quad search together, for blockers and for a
// shadow's edge: where there are blockers and the first look finds no edge, a second one finds thin things and slits.
// Of parallel light, one mean can't stand for blockers of several heights, say a table below a blind: those near the
// receiver weigh most in it, and what is much nearer still hides the light that the others let pass.
#include "lights.glsl"
#include "noise.glsl"
#include "quad.glsl"
#include "shadow_tile.glsl"
#include "shadow_map.glsl"

const int TAPS = 2;                    // per texel, of the search for blockers and of each look for an edge; the four texels of a quad share theirs
const int PENUMBRA_TAPS = 14;          // of the filter
const float HARD_KERNEL = 1.0;         // smallest radius of the filter, in texels
const float CONTACT_KERNEL = 1.25;     // least radius around a receiver in which blockers much nearer to it are looked for, in texels
const float CONTACT_FADE = 0.35;       // a blocker hides all that it covers where the light's image at it is smaller than the filter by this share of the filter's radius
const float PAST_EDGE = 4.0;           // texels behind the receiver's plane, from which a texel shows what is past its edge
const float BESIDE = 6.0;              // texels before the receiver, up to which a blocker is right beside it
const float SMALLEST_RIM = 0.5;        // of the rim's usual radius
const float MIN_BLOCKER_SHARE = 0.15;    // of the distance to the light; blockers nearer to the light are not searched
const float SLACK = 2.0;               // on the light's squared radius, when asking whether a line meets it
const float NORMAL_OFFSET = 1.5;       // texels
const float PARALLEL_OFFSET = 1.0;     // texels, by which shadows are displaced; with less, rough ground shades itself
const float PLANE_MARGIN = 0.25;       // texels above the receiver's plane, below which nothing blocks
const float PLANE_SLACK = 0.5;         // texels, by which a surface behind a blocker lies off its plane
const float DISTANCE_BIAS = 5e-4;      // relative
const float PARALLEL_BIAS = 2e-5;      // of half the map's width, for rounding
const float QUAD_BLEND = 0.7;          // share of the quad's mean in the visibility of flat, soft quads

uniform sampler2D shadow;
#ifdef HAS_HARD_MAP
#include "hard_shadow.glsl"
#endif
#ifdef HAS_SOFT_MAP
uniform sampler2D shadow_nearest;
#endif
#ifdef HAS_SHADOW_TRANSMITTANCE
#include "shadow_transmittance.glsl"
#endif
uniform int edge_taps = TAPS;  // not a constant: the unrolled program outgrows a CPU's instruction cache (1.4 times slower)

// Whether a light with a map has a size.
bool is_soft(Light light)
{
#ifdef HAS_HARD_MAP
#ifdef HAS_SOFT_MAP
    return light.position.w > 0.0 || int(light.color.w) == RECT;
#else
    return false;
#endif
#else
    return true;
#endif
}

// The same for all texels of a quad, so that they share their points: noise, and where angles start.
struct QuadNoise {
    float value;
    vec2 turn;
};

QuadNoise quad_noise()
{
    float noise = texel_noise(floor(gl_FragCoord.xy * 0.5));
    vec2 u = fract(vec2(noise + 0.25, noise)) - 0.5;
    return QuadNoise(noise, normalize(u * (0.5 - abs(u))));  // parabolas for sines: any spread of angles will do
}

#ifdef HAS_NEAR_CASCADE
const float CASCADE_EDGE = 0.02;   // share of a cascade's half width that is not read
const float CASCADE_BLEND = 0.1;   // and over which it gives way to the map of the whole scene

// The light with its near cascade for a map, if that holds all that may hide it from relative point p. The same for all
// texels of a quad, which search together.
Light with_cascade(Light light, vec3 p, QuadNoise noise)
{
    vec3 at = vec3(dot(light.frame_x.xyz, p), dot(light.frame_y.xyz, p), dot(light.frame_z.xyz, p))
        + vec3(light.frame_x.w, light.frame_y.w, light.frame_z.w);
    vec2 away = abs(at.xy - light.v.xy);
    float reach = quad_max(vec3(max(away.x, away.y) + light.position.w * clamp(at.z, 0.0, light.u.y))).x;
    bool has_cascade = int(light.tile.w) == PARALLEL_MAP && light.u.z > 0.0;
    if (has_cascade && reach < light.u.z * (1.0 - CASCADE_EDGE - CASCADE_BLEND * noise.value)) {
        light.tile.xyz = vec3(light.v.zw, light.u.w);
        light.u.x = light.u.z;
        light.frame_x.w -= light.v.x;
        light.frame_y.w -= light.v.y;
    }
    return light;
}
#endif

#ifdef HAS_SOFT_MAP
// Points on the light by Roberts' R2 sequence, whose every stretch is well spread. The angle turns with k.
struct Pattern {
    float k;
    float noise;
    vec2 spiral;
};

const mat2 SPIRAL_ROTATION = mat2(-0.90525386, -0.42487109, 0.42487109, -0.90525386);  // from one point to the next

// The next point: on the unit disc or, for rectangles, in the square [-1, 1]².
vec2 next_point(inout Pattern s, bool square)
{
    float u = fract(0.5 + 0.75487767 * s.k);
    vec2 at = s.spiral * sqrt(u);
#ifdef HAS_RECT_LIGHT
    if (square) at = vec2(fract(u + s.noise * 7.31), fract(s.noise + 0.56984029 * s.k)) * 2.0 - 1.0;
#endif
    s.spiral = SPIRAL_ROTATION * s.spiral;
    s.k += 1.0;
    return at;
}

vec2 rotate(vec2 a, vec2 b)
{
    return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}

// A texel's stretch of the points that its quad shares, when each takes that many. The spiral starts where TAPS points
// before it end; the filter's stretches are longer, but starts of its own cost half as much again as the whole pass
// (the program outgrows a CPU's instruction cache) and bring an error of 0.0185 down by 0.0003 at most.
Pattern quad_pattern(QuadNoise noise, int points)
{
    const vec2 STARTS[4] = vec2[4](vec2(1.0, 0.0), vec2(0.63896911, 0.76923239), vec2(-0.18343695, 0.98303148), vec2(-0.87339020, 0.48702111));
    float lane = quad_lane();
    vec2 start = lane < 2.0 ? (lane < 1.0 ? STARTS[0] : STARTS[1]) : (lane < 3.0 ? STARTS[2] : STARTS[3]);
    return Pattern(lane * float(points), noise.value, rotate(noise.turn, start));
}

// The next point to search a blocker through. They lie closer towards the middle, where blockers near the receiver
// are, whose share of the light's image is small.
vec2 search_point(inout Pattern s, bool square)
{
    float u = (s.k + 0.5) / float(4 * TAPS);
    vec2 at = s.spiral * (u * u);
#ifdef HAS_RECT_LIGHT
    if (square) at /= max(abs(s.spiral.x), abs(s.spiral.y));
#endif
    s.spiral = SPIRAL_ROTATION * s.spiral;
    s.k += 1.0;
    return at;
}

// A texel's first point to look for a shadow's edge at; the second lies opposite. The quad's eight are six around
// the rim, which every straight edge that takes more than a fortieth of the disc must part, and two inside.
vec2 rim_point(bool square, QuadNoise noise)
{
    float lane = quad_lane();
    vec2 at = rotate(noise.turn, lane < 1.0 ? vec2(1.0, 0.0) : lane > 2.0 ? vec2(0.0, 1.0)
                                                              : vec2(1.5 - lane, 0.86602540));
#ifdef HAS_RECT_LIGHT
    if (square) at /= max(abs(at.x), abs(at.y));
#endif
    return at * (lane > 2.0 ? 0.4 : 1.1);
}

// Where to look for an edge again: turned by an eighth of a circle and drawn inwards.
vec2 turn_inwards(vec2 rim)
{
    return rotate(rim, vec2(0.5));
}

// Whether a quad whose texels took that many taps each, of which seen saw the light, found a shadow's edge.
bool parted(float seen, int taps)
{
    return seen > 0.0 && seen < 4.0 * float(taps);
}

// Where all of a quad take taps and lie on one plane, blended with the quad's mean.
vec3 blend_quad(vec3 x, int taps, vec3 p, vec3 n)
{
    bool together = quad_all(is_on_plane(p, n) && taps > 0);
    return mix(x, 0.25 * quad_sum(x), together ? QUAD_BLEND : 0.0);
}

// Visibility by the filter's taps in a penumbra, passed by light and known ones, elsewhere all or nothing.
float soft_visibility(float seen, bool penumbra, vec2 passed, int taps, vec3 p, vec3 n)
{
    float filtered = blend_quad(vec3(passed.x / max(passed.y, 1.0)), taps, p, n).x;
    return penumbra ? filtered : seen > 0.0 ? 1.0 : 0.0;
}

// The smaller of the differences to the texel before and to the one after: the other one may lead past an edge. 0 where
// both do, beside what is one texel wide.
float steady_difference(float before, float here, float after)
{
    float to = here - before, on = after - here;
    return to * on < 0.0 ? 0.0 : abs(to) < abs(on) ? to : on;
}

// By how much what a texel holds may lie off a plane of that gradient per texel, and still count as on it.
float plane_slack(vec2 gradient)
{
    return PLANE_SLACK * (abs(gradient.x) + abs(gradient.y));
}

#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
// A receiver as its light sees it: relative to the light, moved off its surface by the normal offset.
struct Receiver {
    vec3 p;
    vec3 n;
    float reach;   // distance from the light, less the bias
    float offset;  // distance of its plane from the light, less the bias
    float radius;  // of the light
};

// How a distance stored in direction q relates to a receiver.
struct Stored {
    bool before;  // nearer than the receiver (a wall behind it is no blocker) and before its plane
    float along;  // distance from the light, along the line to the receiver
    float off;    // squared distance from the line to the light's centre
    float size;   // squared radius that the light has on its way to the receiver there
};

Stored relate(Receiver r, vec3 q, float distance, float offset)
{
    float unit = inversesqrt(dot(q, q));
    float along = distance * dot(q, r.p) * unit * ((1.0 - DISTANCE_BIAS) / r.reach);
    float size = r.radius * (1.0 - along / r.reach);
    return Stored(distance < r.reach && -dot(r.n, q) * unit * distance < offset, along,
                  distance * distance - along * along, size * size);
}

// The light as seen from a receiver, projected to a share of the way from the light to the receiver.
struct Disc {
    vec3 axis_u;
    vec3 axis_v;
    float share;
};

vec3 tap(Receiver r, Disc disc, vec2 s)
{
    return r.p * disc.share + (disc.axis_u * s.x + disc.axis_v * s.y) * (1.0 - disc.share);
}

// A texel of a light's map: its square's corner in the atlas, its centre in the square, and the distance that it holds.
struct MapTexel {
    vec2 corner;
    vec2 at;
    float distance;
};

MapTexel texel_at(Light light, vec2 corner, vec2 place)
{
    vec2 at = floor(clamp(place, 0.0, light.tile.z - 1.0));
    return MapTexel(corner, at + 0.5, texelFetch(shadow, ivec2(corner + at), 0).r);
}

MapTexel texel_towards(Light light, vec3 q)
{
    vec2 corner, fraction = map_fraction(light, q, corner);
    return texel_at(light, corner, fraction * light.tile.z);
}

// Distance from the light divided by depth in a light's square; 1 in its middle.
float obliqueness(Light light, vec2 at)
{
    vec2 xy = at * (2.0 / light.tile.z) - 1.0;
    float wide = 1.0;
#ifdef HAS_SINGLE_MAP
    if (int(light.tile.w) == SINGLE_MAP) wide = 1.0 / dot(light.frame_x.xyz, light.frame_x.xyz);
#endif
    return sqrt(1.0 + wide * dot(xy, xy));
}

// What hides the middle of the light: whether anything does, how far it is from the light, and its plane, over which
// inverse depth is linear in the map.
struct Hider {
    bool before;
    float along;
    vec2 corner;
    vec2 at;
    float inverse_depth;
    vec2 gradient;  // per texel
};

float inverse_depth(Light light, MapTexel t)
{
    return obliqueness(light, t.at) / t.distance;
}

Hider find_hider(Light light, Receiver r)
{
    vec2 corner, place = map_fraction(light, r.p, corner) * light.tile.z;
    MapTexel here = texel_at(light, corner, place);
    const vec2 X = vec2(1.0, 0.0), Y = vec2(0.0, 1.0);
    float inverse = inverse_depth(light, here);
    vec2 gradient = vec2(steady_difference(inverse_depth(light, texel_at(light, corner, here.at - X)), inverse,
                                           inverse_depth(light, texel_at(light, corner, here.at + X))),
                         steady_difference(inverse_depth(light, texel_at(light, corner, here.at - Y)), inverse,
                                           inverse_depth(light, texel_at(light, corner, here.at + Y))));
    float reached = inverse + dot(gradient, place - here.at);
    Stored s = relate(r, r.p, obliqueness(light, place) / max(reached, 1e-30), r.offset);
    return Hider(s.before, s.along, corner, here.at, inverse, gradient);
}

// Whether the line from the receiver through what a texel holds meets the light: a wall beside the receiver is no blocker.
bool meets_light(Light light, Receiver r, Stored s)
{
    float least = HARD_KERNEL * 2.0 / light.tile.z * r.reach;  // or thin penumbrae would be lost between texels
    return s.before && s.off <= SLACK * s.size + least * least;
}

bool texel_blocks(Light light, Receiver r, vec3 q)
{
    return meets_light(light, r, relate(r, q, texel_towards(light, q).distance, r.offset));
}

// x: whether light passes the texel in direction q. y: whether that is known: not where a wall beside the receiver may go
// on behind what hides the light's middle, nor where the plane of that goes on.
vec2 texel_passes(Light light, Receiver r, vec3 q, Hider hider)
{
    MapTexel t = texel_towards(light, q);
    Stored s = relate(r, q, t.distance, r.offset);
    if (meets_light(light, r, s)) return vec2(0.0, 1.0);
    if (!hider.before) return vec2(1.0);
    bool may_go_on = s.before && s.along > hider.along;
    float plane = hider.inverse_depth + dot(hider.gradient, t.at - hider.at);
    bool is_plane = t.corner == hider.corner
        && inverse_depth(light, t) > plane - plane_slack(hider.gradient);
    return may_go_on || is_plane ? vec2(0.0) : vec2(1.0);
}

// The nearest blocker in the tile of the map around direction q, if it lies before the part of the receiver's plane
// that the tile may show. x: its distance times its weight, y: its weight, which is 1 where its line from the
// receiver meets the light and fades beyond.
vec2 nearest_blocker(sampler2D nearest, Light light, Receiver r, vec3 q)
{
    float tiles = light.tile.z / float(TILE);
    vec2 corner;
    vec2 tile = clamp(map_fraction(light, q, corner) * tiles, 0.0, tiles - 1.0);
    float stored = texelFetch(nearest, ivec2(corner / float(TILE)) + ivec2(tile), 0).r;
    Stored s = relate(r, q, stored, r.offset - r.reach * 2.0 / tiles);
    return s.before ? vec2(s.along, 1.0) * (s.size / max(s.off, s.size + 1e-30)) : vec2(0.0);
}

// Share of the way from the light at which the filter has its smallest radius.
float smallest_kernel(Light light, Receiver r)
{
    return r.radius / (r.radius + HARD_KERNEL * 2.0 / light.tile.z * length(r.p));
}

bool is_square(Light light)
{
#ifdef HAS_RECT_LIGHT
    return int(light.color.w) == RECT;
#else
    return false;
#endif
}

// The light projected to the mean of its blockers' distances, of those in a map of the nearest in tiles; has_blockers:
// whether there are any.
Disc blocker_disc(sampler2D nearest, Light light, Receiver r, QuadNoise noise, out bool has_blockers)
{
    float reach = length(r.p), radius = r.radius;
    vec3 side = abs(r.p.y) < 0.9 * reach ? vec3(r.p.z, 0.0, -r.p.x) : vec3(0.0, -r.p.z, r.p.y);
    vec3 axis_u = side * (radius * inversesqrt(max(dot(side, side), 1e-30)));
    Disc disc = Disc(axis_u, cross(axis_u, r.p) / reach, max(MIN_BLOCKER_SHARE, min(radius / reach, 0.9)));
#ifdef HAS_RECT_LIGHT
    if (is_square(light)) {
        disc.axis_u = light.u.xyz;
        disc.axis_v = light.v.xyz;
    }
#endif
    Pattern pattern = quad_pattern(noise, TAPS);
    vec2 sum = vec2(0.0);
    for (int i = 0; i < TAPS; ++i) {
        sum += nearest_blocker(nearest, light, r, tap(r, disc, search_point(pattern, is_square(light))));
    }
    float weight = quad_sum(sum.y);
    has_blockers = weight > 0.0;
    float blocker = quad_sum(sum.x) / max(weight, 1e-30) / reach, smallest = smallest_kernel(light, r);
    disc.share = has_blockers ? clamp(blocker, 1e-3, smallest) : smallest;
    return disc;
}

#ifdef HAS_SHADOW_TRANSMITTANCE
// What the texel in direction q lets pass to the receiver.
vec3 transmittance_towards(Light light, Receiver r, vec3 q, MapTexel t)
{
    ivec2 texel = ivec2(t.corner + t.at);
    return texel_transmittance(texel, relate(r, q, nearest_passed(texel, own_width(light) * r.reach), r.offset).before);
}
#endif

// Share of a light with a size that the receiver sees.
float soft_radial_visibility(Light light, Receiver r, QuadNoise noise, bool wanted, inout vec4 tint)
{
    bool square = is_square(light), has_blockers;
    Disc disc = blocker_disc(shadow_nearest, light, r, noise, has_blockers);
    float seen = 0.0;
    // The rim of a kernel of one texel lies within it, or what hides the light there would count as beside its way.
    vec2 rim = rim_point(square, noise) * (disc.share < smallest_kernel(light, r) ? 1.0 : SMALLEST_RIM);
    for (int i = 0; i < edge_taps; ++i) seen += texel_blocks(light, r, tap(r, disc, i == 0 ? rim : -rim)) ? 0.0 : 1.0;
    seen = quad_sum(seen);
    float seen_again = 0.0;
    int taps_again = has_blockers && !parted(seen, TAPS) ? edge_taps : 0;
    rim = turn_inwards(rim);
    for (int i = 0; i < taps_again; ++i) {
        seen_again += texel_blocks(light, r, tap(r, disc, i == 0 ? rim : -rim)) ? 0.0 : 1.0;
    }
    seen += quad_sum(seen_again);
    bool penumbra = parted(seen, TAPS + taps_again);
    int taps = wanted && penumbra ? PENUMBRA_TAPS : 0;
    Pattern pattern = quad_pattern(noise, PENUMBRA_TAPS);
    Hider hider = Hider(false, 0.0, vec2(0.0), vec2(0.0), 0.0, vec2(0.0));
    for (int i = 0; i < min(taps, 1); ++i) hider = find_hider(light, r);
    vec2 passed = vec2(0.0);
    for (int i = 0; i < taps; ++i) {
        vec3 q = tap(r, disc, next_point(pattern, square));
        vec2 passes = texel_passes(light, r, q, hider);
        passed += passes;
#ifdef HAS_SHADOW_TRANSMITTANCE
        MapTexel t = texel_towards(light, q);
        tint += passes.x * vec4(transmittance_towards(light, r, q, t), 1.0);
#endif
    }
    return soft_visibility(seen, penumbra, passed, taps, r.p, r.n);
}

Receiver radial_receiver(Light light, vec3 p, vec3 n)
{
    p -= light.position.xyz;
    float height = -dot(n, p) - PLANE_MARGIN * 2.0 / light.tile.z * length(p);  // of the light above the receiver's plane
    p += n * (NORMAL_OFFSET * 2.0 / light.tile.z * length(p));
    float radius = light.position.w;
#ifdef HAS_RECT_LIGHT
    if (is_square(light)) radius = sqrt(dot(light.u.xyz, light.u.xyz) + dot(light.v.xyz, light.v.xyz));
#endif
    return Receiver(p, n, length(p) * (1.0 - DISTANCE_BIAS), height * (1.0 - DISTANCE_BIAS), radius);
}
#endif

#ifdef HAS_PARALLEL_MAP
// A receiver in the map of parallel light: the depth of its plane is depth + dot(gradient, offset of the map).
struct ParallelReceiver {
    vec2 fraction;  // of the map
    float depth;
    vec2 gradient;
};

// Whether a depth stored at a fraction of the map lies before the receiver and its plane.
bool before_parallel_receiver(ParallelReceiver r, vec2 at, float stored, float margin)
{
    return stored < r.depth + min(dot(r.gradient, at - r.fraction) - margin, 0.0);
}

ivec2 parallel_texel(Light light, vec2 at)
{
    return ivec2(light.tile.xy + clamp(at * light.tile.z, 0.0, light.tile.z - 1.0));
}

float stored_depth(Light light, vec2 at)
{
    return texelFetch(shadow, parallel_texel(light, at), 0).r;
}

// Radius of the light's image at what a texel holds before the receiver; 0 where it holds nothing. spread is the growth
// of the image in map fractions per unit of depth.
float image_size(Light light, ParallelReceiver r, vec2 at, float stored, float spread)
{
    return before_parallel_receiver(r, at, stored, 0.0) ? spread * (r.depth - stored) + HARD_KERNEL / light.tile.z : 0.0;
}

// Whether the line from the receiver through what lies there meets the light.
bool meets_image(ParallelReceiver r, vec2 at, float size)
{
    vec2 away = at - r.fraction;
    return size > 0.0 && dot(away, away) <= SLACK * size * size;
}

// What hides the middle of the light: the radius of the light's image there, 0 if nothing does, and its plane.
struct ParallelHider {
    float image;
    float depth;
    vec2 gradient;
};

ParallelHider find_parallel_hider(Light light, ParallelReceiver r, float spread)
{
    float texel = 1.0 / light.tile.z, depth = stored_depth(light, r.fraction);
    vec2 x = vec2(texel, 0.0), y = vec2(0.0, texel);
    vec2 gradient = vec2(
        steady_difference(stored_depth(light, r.fraction - x), depth, stored_depth(light, r.fraction + x)),
        steady_difference(stored_depth(light, r.fraction - y), depth, stored_depth(light, r.fraction + y)));
    vec2 texels = r.fraction * light.tile.z;
    float here = depth + dot(gradient, fract(texels) - 0.5);
    return ParallelHider(image_size(light, r, r.fraction, here, spread), depth, gradient);
}

bool parallel_texel_blocks(Light light, ParallelReceiver r, vec2 at, float spread)
{
    return meets_image(r, at, image_size(light, r, at, stored_depth(light, at), spread));
}

// As texel_passes. z: whether the texel shows what is past the receiver's edge, beside what hides the light right there.
vec3 parallel_texel_passes(Light light, ParallelReceiver r, vec2 at, float spread, ParallelHider hider)
{
    float stored = stored_depth(light, at), size = image_size(light, r, at, stored, spread);
    if (meets_image(r, at, size)) return vec3(0.0, 1.0, 0.0);
    if (hider.image == 0.0) return vec3(1.0, 1.0, 0.0);
    // What hides the light right beside the receiver, such as the other wall of a corner, may end where the receiver does.
    float texel = 2.0 / light.tile.z * light.u.x, past = dot(r.gradient, at - r.fraction) + PAST_EDGE * texel;
    if (r.depth - hider.depth < BESIDE * texel && stored - r.depth > past) return vec3(0.0, 0.0, 1.0);
    vec2 texels = floor(at * light.tile.z) - floor(r.fraction * light.tile.z);
    bool may_go_on = size > 0.0 && size < hider.image;
    float plane = hider.depth + dot(hider.gradient, texels);
    bool is_plane = stored < plane + plane_slack(hider.gradient);
    return may_go_on || is_plane ? vec3(0.0) : vec3(1.0, 1.0, 0.0);
}

// As nearest_blocker, but blockers near the receiver weigh more: little of the light passes them. z: the radius of the
// light's image at the blocker, in map fractions.
vec3 nearest_parallel_blocker(sampler2D nearest, Light light, ParallelReceiver r, vec2 at, float spread)
{
    float tiles = light.tile.z / float(TILE);
    vec2 tile = clamp(at * tiles, 0.0, tiles - 1.0);
    float stored = texelFetch(nearest, ivec2(light.tile.xy / float(TILE)) + ivec2(tile), 0).r;
    float margin = (abs(r.gradient.x) + abs(r.gradient.y)) / tiles;
    float size = spread * max(r.depth - stored, 0.0), away = length(at - r.fraction);
    float least = HARD_KERNEL / light.tile.z, square = size * size + least * least;
    float meets = square / max(away * away, square), weight = meets * meets / square;
    bool before = before_parallel_receiver(r, at, stored, margin);
    return before ? vec3(vec2(stored, 1.0) * weight, size + least) : vec3(0.0, 0.0, 1.0);
}

// How much light a texel hides by a blocker so near that the light's image there is smaller than the filter, and whether
// that is known: not where a blocker farther away covers what lies behind it.
vec2 contact_texel(Light light, ParallelReceiver r, vec2 at, float spread, float width)
{
    float size = image_size(light, r, at, stored_depth(light, at), spread);
    float hides = meets_image(r, at, size) ? clamp((1.0 - size / width) / CONTACT_FADE, 0.0, 1.0) : 0.0;
    return vec2(hides, size < width ? 1.0 : 0.0);
}

// Growth of the light's image, in map fractions per unit of depth.
float image_spread(Light light)
{
    return 0.5 * light.position.w / light.u.x;
}

// What a search for blockers found in a map of the nearest in tiles. width: of the light's image at their mean depth, in
// map fractions; nearest_image: of its image at the one nearest to the receiver.
struct ParallelBlockers {
    bool any;
    float width;
    float nearest_image;
};

ParallelBlockers find_parallel_blockers(sampler2D nearest, Light light, ParallelReceiver r, QuadNoise noise)
{
    float spread = image_spread(light), width = spread * min(r.depth, light.u.y);
    Pattern pattern = quad_pattern(noise, TAPS);
    vec2 sum = vec2(0.0);
    float nearest_image = 1.0;
    for (int i = 0; i < TAPS; ++i) {
        vec2 at = r.fraction + search_point(pattern, false) * width;
        vec3 found = nearest_parallel_blocker(nearest, light, r, at, spread);
        sum += found.xy;
        nearest_image = min(nearest_image, found.z);
    }
    float weight = quad_sum(sum.y), blocker = quad_sum(sum.x) / max(weight, 1e-30);
    width = max(weight > 0.0 ? spread * (r.depth - blocker) : 0.0, HARD_KERNEL / light.tile.z);
    return ParallelBlockers(weight > 0.0, width, -quad_max(vec3(-nearest_image)).x);
}

#ifdef HAS_SHADOW_TRANSMITTANCE
// What the texel at a fraction of the map lets pass to the receiver.
vec3 transmittance_at(Light light, ParallelReceiver r, vec2 at)
{
    ivec2 texel = parallel_texel(light, at);
    float nearest = nearest_passed(texel, own_width(light) * light.u.x);
    return texel_transmittance(texel, before_parallel_receiver(r, at, nearest, 0.0));
}
#endif

float soft_parallel_visibility(Light light, ParallelReceiver r, vec3 p, vec3 n, QuadNoise noise, bool wanted,
                               inout vec4 tint)
{
    float spread = image_spread(light);
    ParallelBlockers blockers = find_parallel_blockers(shadow_nearest, light, r, noise);
    float width = blockers.width;

    float seen = 0.0;
    vec2 rim = rim_point(false, noise) * width;
    for (int i = 0; i < edge_taps; ++i) {
        seen += parallel_texel_blocks(light, r, r.fraction + (i == 0 ? rim : -rim), spread) ? 0.0 : 1.0;
    }
    seen = quad_sum(seen);
    float seen_again = 0.0;
    int taps_again = blockers.any && !parted(seen, TAPS) ? edge_taps : 0;
    rim = turn_inwards(rim);
    for (int i = 0; i < taps_again; ++i) {
        seen_again += parallel_texel_blocks(light, r, r.fraction + (i == 0 ? rim : -rim), spread) ? 0.0 : 1.0;
    }
    seen += quad_sum(seen_again);
    bool penumbra = parted(seen, TAPS + taps_again);
    vec2 contact = vec2(0.0);
    int contact_taps = width * light.tile.z > HARD_KERNEL ? edge_taps : 0;
    float own = image_size(light, r, r.fraction, stored_depth(light, r.fraction), spread);
    float image = own > 0.0 ? own : blockers.nearest_image;
    rim = rim_point(false, noise) * max(image < width ? image : 0.0, CONTACT_KERNEL / light.tile.z);
    for (int i = 0; i < contact_taps; ++i) {
        contact += contact_texel(light, r, r.fraction + (i == 0 ? rim : -rim), spread, width);
    }
    int taps = wanted && penumbra ? PENUMBRA_TAPS : 0;
    Pattern pattern = quad_pattern(noise, PENUMBRA_TAPS);
    ParallelHider hider = ParallelHider(0.0, 0.0, vec2(0.0));
    for (int i = 0; i < min(taps, 1); ++i) hider = find_parallel_hider(light, r, spread);
    vec3 found = vec3(0.0);
    for (int i = 0; i < taps; ++i) {
        vec2 at = r.fraction + next_point(pattern, false) * width;
        vec3 passes = parallel_texel_passes(light, r, at, spread, hider);
        found += passes;
#ifdef HAS_SHADOW_TRANSMITTANCE
        tint += passes.x * vec4(transmittance_at(light, r, at), 1.0);
#endif
    }
    contact = vec2(quad_sum(contact.x), quad_sum(contact.y));
    float passes_contact = 1.0 - contact.x / max(contact.y, 1.0);
    vec2 passed = found.y > 0.0 ? found.xy : found.zz;
    return passes_contact * soft_visibility(seen, penumbra, passed, taps, p, n);
}

ParallelReceiver parallel_receiver(Light light, vec3 p, vec3 n)
{
    float half_width = light.u.x;
    float c = max(dot(n, light.position.xyz), 0.01);
    vec3 moved = p + n * (PARALLEL_OFFSET * 2.0 / light.tile.z * half_width);
    vec3 axis_x = light.frame_x.xyz, axis_y = light.frame_y.xyz;
    ParallelReceiver r;
    r.fraction = vec2(dot(axis_x, moved) + light.frame_x.w, dot(axis_y, moved) + light.frame_y.w) * (0.5 / half_width)
        + 0.5;
    r.depth = dot(light.frame_z.xyz, moved) + light.frame_z.w - PARALLEL_BIAS * half_width;
    r.gradient = vec2(dot(n, axis_x), dot(n, axis_y)) * (2.0 * half_width / c);
    return r;
}
#endif
#endif
#ifdef HAS_SHADOW_TRANSMITTANCE
#include "soft_transmittance.glsl"
#endif

// Share of the light that relative point p with face normal n sees; of no meaning unless wanted. In a penumbra, tint is
// the sum of what see-through surfaces leave of the light at points that see it, and their number.
float visibility(Light light, vec3 p, vec3 n, QuadNoise noise, bool wanted, inout vec4 tint)
{
#ifdef HAS_HARD_MAP
    if (!is_soft(light)) return hard_visibility(light, p, n);
#endif
#ifdef HAS_SOFT_MAP
#ifdef HAS_PARALLEL_MAP
    if (int(light.tile.w) == PARALLEL_MAP) {
        return soft_parallel_visibility(light, parallel_receiver(light, p, n), p, n, noise, wanted, tint);
    }
#endif
#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
    return soft_radial_visibility(light, radial_receiver(light, p, n), noise, wanted, tint);
#endif
#endif
    return 1.0;
}

// Share of the light that arrives.
vec3 arriving_share(Light light, vec3 p, vec3 n, QuadNoise noise, bool wanted)
{
    vec4 tint = vec4(0.0);
    float seen = visibility(light, p, n, noise, wanted, tint);
#ifdef HAS_SHADOW_TRANSMITTANCE
    return seen * transmittance(light, p, n, noise, wanted && seen > 0.0, tint);
#else
    return vec3(seen);
#endif
}
