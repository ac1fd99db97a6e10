// Soft shadows by percentage closer soft shadows: blocker search, penumbra estimate, filtered lookup
// (Fernando 2005), with two changes. A tap is a point on the light projected through the mean blocker, so
// spheres, rectangles and parallel light share one code. And a tap compares its texel with the receiver's
// plane at the texel's own centre, so flat receivers need no bias however wide the kernel.
#include "lights.glsl"

const int NO_MAP = 0;
const int SINGLE_MAP = 1;
const int CUBE_MAP = 2;
const int PARALLEL_MAP = 3;

const int SEARCH_TAPS = 16;
const int FILTER_TAPS = 32;
const float HARD_KERNEL = 1.0;         // kernels with a smaller radius, in texels, are filtered bilinearly
const float NEAREST_BLOCKER = 0.15;    // blockers nearer to the light than this share of the way are not searched
const float NORMAL_OFFSET = 1.5;       // texels
const float DISTANCE_BIAS = 5e-4;      // relative
const mat2 GOLDEN_TURN = mat2(-0.73736888, 0.67549029, -0.67549029, -0.73736888);

uniform sampler2D shadow;
uniform float noise_phase;  // turns the sampling pattern, from the seed

// Fixed per texel, so that still pictures stay still (Jimenez 2014, interleaved gradient noise).
float texel_noise(vec2 pixel)
{
    return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715))) + noise_phase);
}

// A square of the atlas: texel centres lie in directions forward + u right + v up, u and v in [-1, 1].
struct Face {
    vec3 forward;
    vec3 right;
    vec3 up;
    vec2 corner;
    float size;
};

#include "cube.glsl"

Face face_towards(Light light, vec3 d)
{
    Face face;
    face.size = light.tile.z;
#ifdef HAS_SINGLE_MAP
    if (int(light.tile.w) == SINGLE_MAP) {
        face.forward = light.frame_z.xyz;
        face.right = light.frame_x.xyz / dot(light.frame_x.xyz, light.frame_x.xyz);
        face.up = light.frame_y.xyz / dot(light.frame_y.xyz, light.frame_y.xyz);
        face.corner = light.tile.xy;
        return face;
    }
#endif
    int index = cube_face_index(d);
    CubeFace f = cube_face(index);
    face.forward = f.forward;
    face.right = f.right;
    face.up = f.up;
    face.corner = light.tile.xy + face.size * vec2(index % 3, index / 3);
    return face;
}

vec2 face_uv(Face face, vec3 d)
{
    return vec2(dot(face.right, d) / dot(face.right, face.right), dot(face.up, d) / dot(face.up, face.up))
        / max(dot(face.forward, d), 1e-30);
}

// Where the ray from the light in direction d stops being in front of the receiver: its plane, at most its
// own distance (a wall behind the receiver is no blocker).
float stop_distance(vec3 d, vec3 p, vec3 n, float reach)
{
    float slope = dot(n, d);
    float t = slope < 0.0 ? dot(n, p) / slope * length(d) : reach;
    return min(t, reach) * (1.0 - DISTANCE_BIAS);
}

// Distance stored nearest to direction q from the light, and whether it lies before the receiver.
bool blocked(Light light, Face face, vec3 q, vec3 p, vec3 n, float reach, out float stored)
{
    vec2 uv = face_uv(face, q);
#ifdef HAS_CUBE_MAP
    if (max(abs(uv.x), abs(uv.y)) > 1.0 || dot(face.forward, q) <= 0.0) {
        face = face_towards(light, q);
        uv = face_uv(face, q);
    }
#endif
    vec2 texel = clamp(floor((uv * 0.5 + 0.5) * face.size), 0.0, face.size - 1.0);
    stored = texelFetch(shadow, ivec2(face.corner + texel), 0).r;
    vec2 centre = (texel + 0.5) / face.size * 2.0 - 1.0;
    vec3 d = face.forward + centre.x * face.right + centre.y * face.up;
    return stored < stop_distance(d, p, n, reach);
}

// Four neighbouring texels compared, then interpolated: the smoothest hard shadow a map can give.
float hard_visibility(Light light, Face face, vec3 p, vec3 n, float reach)
{
    vec2 at = (face_uv(face, p) * 0.5 + 0.5) * face.size - 0.5;
    vec2 base = clamp(floor(at), 0.0, face.size - 2.0);
    vec2 f = clamp(at - base, 0.0, 1.0);
    float lit[4];
    for (int i = 0; i < 4; ++i) {
        vec2 texel = base + vec2(i & 1, i >> 1);
        vec2 centre = (texel + 0.5) / face.size * 2.0 - 1.0;
        vec3 d = face.forward + centre.x * face.right + centre.y * face.up;
        float stored = texelFetch(shadow, ivec2(face.corner + texel), 0).r;
        lit[i] = stored < stop_distance(d, p, n, reach) ? 0.0 : 1.0;
    }
    return mix(mix(lit[0], lit[1], f.x), mix(lit[2], lit[3], f.x), f.y);
}

// The k-th of count points: on the unit disc (Vogel's spiral) or, for rectangles, in the square [-1, 1]².
vec2 light_sample(int k, int count, bool square, float noise, inout vec2 spiral)
{
    if (square) return fract(vec2(noise, noise * 7.31) + float(k) * vec2(0.75487767, 0.56984029)) * 2.0 - 1.0;
    spiral = GOLDEN_TURN * spiral;
    return spiral * sqrt((float(k) + 0.5) / float(count));
}

vec2 spiral_start(float noise)
{
    return vec2(cos(2.0 * PI * noise), sin(2.0 * PI * noise));
}

#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
// Share of a point, sphere, spot or rectangle light that relative point p with face normal n sees.
float radial_visibility(Light light, vec3 p, vec3 n, float noise)
{
    p -= light.position.xyz;
    if (dot(n, p) >= 0.0 && int(light.color.w) != RECT && light.position.w <= 0.0) return 0.0;
    p += n * (NORMAL_OFFSET * 2.0 / light.tile.z * length(p));
    float reach = length(p);
    Face face = face_towards(light, p);
#ifdef HAS_SINGLE_MAP
    if (int(light.tile.w) == SINGLE_MAP && dot(face.forward, p) <= 0.0) return 1.0;
#endif
#ifdef HAS_SOFT_LIGHT
    bool square = int(light.color.w) == RECT;
    vec3 axis_u, axis_v;
    float radius = light.position.w;
    if (square) {
        axis_u = light.u.xyz;
        axis_v = light.v.xyz;
        radius = max(length(axis_u), length(axis_v));
    } else {
        axis_u = normalize(cross(p, abs(p.y) < 0.9 * reach ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0))) * radius;
        axis_v = cross(axis_u, p / reach);
    }
    if (radius > 0.0) {
        float share = max(NEAREST_BLOCKER, min(2.0 * radius / reach, 0.9));
        vec2 spiral = spiral_start(noise);
        float sum = 0.0, hits = 0.0;
        for (int k = 0; k < SEARCH_TAPS; ++k) {
            vec2 s = light_sample(k, SEARCH_TAPS, square, noise, spiral);
            float stored;
            if (blocked(light, face, p * share + (axis_u * s.x + axis_v * s.y) * (1.0 - share), p, n, reach, stored)) {
                sum += stored;
                hits += 1.0;
            }
        }
        if (hits == 0.0) return 1.0;
        if (hits == float(SEARCH_TAPS)) return 0.0;
        share = clamp(sum / hits / reach, 1e-3, 1.0);
        float kernel = radius / reach * (1.0 - share) / share * 0.5 * face.size;
        if (kernel > HARD_KERNEL) {
            float lit = 0.0;
            for (int k = 0; k < FILTER_TAPS; ++k) {
                vec2 s = light_sample(k, FILTER_TAPS, square, noise, spiral);
                float stored;
                vec3 q = p * share + (axis_u * s.x + axis_v * s.y) * (1.0 - share);
                lit += blocked(light, face, q, p, n, reach, stored) ? 0.0 : 1.0;
            }
            return lit / float(FILTER_TAPS);
        }
    }
#endif
    return hard_visibility(light, face, p, n, reach);
}
#endif

#ifdef HAS_PARALLEL_MAP
// The plane of the receiver in map space: depth = z + dot(gradient, offset in [-1, 1]).
struct ParallelReceiver {
    vec2 uv;
    float depth;
    vec2 gradient;
};

bool parallel_blocked(Light light, ParallelReceiver r, vec2 texel, out float stored)
{
    texel = clamp(texel, vec2(0.0), vec2(light.tile.z - 1.0));
    stored = texelFetch(shadow, ivec2(light.tile.xy + texel), 0).r;
    vec2 offset = (texel + 0.5) / light.tile.z * 2.0 - 1.0 - r.uv;
    return stored < r.depth + min(dot(r.gradient, offset), 0.0) - DISTANCE_BIAS * light.u.x;
}

// Share of a directional light's disc that relative point p with face normal n sees.
float parallel_visibility(Light light, vec3 p, vec3 n, float noise)
{
    float half_width = light.u.x, size = light.tile.z;
    float c = dot(n, light.position.xyz);
    if (c <= 0.0) return 0.0;
    p += n * (NORMAL_OFFSET * 2.0 / size * half_width);
    ParallelReceiver r;
    vec3 axis_x = light.frame_x.xyz, axis_y = light.frame_y.xyz;
    r.uv = vec2(dot(axis_x, p) + light.frame_x.w, dot(axis_y, p) + light.frame_y.w) / half_width;
    r.depth = dot(light.frame_z.xyz, p) + light.frame_z.w;
    r.gradient = vec2(dot(n, axis_x), dot(n, axis_y)) / max(c, 0.05) * half_width;
#ifdef HAS_SOFT_LIGHT
    float spread = light.position.w / half_width;  // growth of the kernel in map units per unit of depth
    if (spread > 0.0) {
        vec2 spiral = spiral_start(noise);
        float search = spread * min(r.depth, 0.5 * half_width);
        float sum = 0.0, hits = 0.0;
        for (int k = 0; k < SEARCH_TAPS; ++k) {
            vec2 s = light_sample(k, SEARCH_TAPS, false, noise, spiral);
            float stored;
            if (parallel_blocked(light, r, floor(((r.uv + s * search) * 0.5 + 0.5) * size), stored)) {
                sum += stored;
                hits += 1.0;
            }
        }
        if (hits == 0.0 && search * size > 1.0) return 1.0;
        float kernel = spread * max(r.depth - sum / max(hits, 1.0), 0.0);
        if (hits > 0.0 && kernel * 0.5 * size > HARD_KERNEL) {
            float lit = 0.0;
            for (int k = 0; k < FILTER_TAPS; ++k) {
                vec2 s = light_sample(k, FILTER_TAPS, false, noise, spiral);
                float stored;
                lit += parallel_blocked(light, r, floor(((r.uv + s * kernel) * 0.5 + 0.5) * size), stored) ? 0.0 : 1.0;
            }
            return lit / float(FILTER_TAPS);
        }
    }
#endif
    vec2 at = (r.uv * 0.5 + 0.5) * size - 0.5;
    vec2 base = floor(at), f = at - base;
    float lit[4];
    for (int i = 0; i < 4; ++i) {
        float stored;
        lit[i] = parallel_blocked(light, r, base + vec2(i & 1, i >> 1), stored) ? 0.0 : 1.0;
    }
    return mix(mix(lit[0], lit[1], f.x), mix(lit[2], lit[3], f.x), f.y);
}
#endif

// Share of the light that relative point p with face normal n sees.
float visibility(Light light, vec3 p, vec3 n, float noise)
{
#ifdef HAS_PARALLEL_MAP
    if (int(light.tile.w) == PARALLEL_MAP) return parallel_visibility(light, p, n, noise);
#endif
#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
    return radial_visibility(light, p, n, noise);
#else
    return 1.0;
#endif
}
