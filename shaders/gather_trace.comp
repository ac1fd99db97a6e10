// One ray from each texel of the grid of gathered light, and where it ends nearby, a second one from there, as
// app/surfels/final_gather.py traces them on the CPU. Light at the rays' ends is drawn between this and gather_resolve.comp.
layout(local_size_x = 8, local_size_y = 8) in;

#include "numbers.glsl"
#include "grid.glsl"
#include "nearest_texel.glsl"
#include "store_ray_ends.glsl"
#include "gather_turns.glsl"

const uvec2 RECURRENCE = uvec2(3242174889u, 2447445414u);  // R2 of Roberts 2018, in 32-bit fixed point
const float TO_UNIT = 1.0 / 16777216.0;

uniform usampler2D starts;     // of each texel's sequence, in 32-bit fixed point
uniform uvec2 phase;           // shifts all sequences
uniform int sample_index;      // of each texel's sequence
uniform vec2 ratio;            // texels of the G-buffer per texel of the grid
uniform vec3 local_eye;        // in local space: world axes, the scene's centre as origin
uniform float ray_epsilon;     // by which rays start off their surface, scene units
uniform float reach;           // from which on light between surfels does at a ray's end, scene units

// A direction whose density is proportional to its cosine with n, for u in [0, 1)².
vec3 cosine_direction(vec3 n, vec2 u)
{
    vec3 tangent = normalize(abs(n.x) > 0.9 ? vec3(-n.z, 0.0, n.x) : vec3(0.0, n.z, -n.y));
    float angle = 2.0 * PI * u.y;
    vec2 across = sqrt(u.x) * vec2(cos(angle), sin(angle));
    return across.x * tangent + across.y * cross(n, tangent) + sqrt(1.0 - u.x) * n;
}

// Numbers as good as independent of these (pcg2d of Jarzynski and Olano 2020, "Hash Functions for GPU Rendering").
uvec2 hash(uvec2 v)
{
    v = v * 1664525u + 1013904223u;
    v.x += v.y * 1664525u;
    v.y += v.x * 1664525u;
    v ^= v >> 16u;
    v.x += v.y * 1664525u;
    v.y += v.x * 1664525u;
    return v ^ (v >> 16u);
}

// Stores ends of first rays in the lower half of the images, with lengths over reach and at most 1, and those of second rays
// in the upper half.
void main()
{
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(surfaces, 0);
    if (texel.x >= size.x || texel.y >= size.y) return;
    vec4 surface = texelFetch(surfaces, texel, 0);
    Surface first = NO_SURFACE, second = NO_SURFACE;
    float near = 1.0;
    if (is_wanted(texel, surface) && has_turn(texel)) {
        vec3 p = surface_point(vec2(nearest_texel(texel, ratio)) + 0.5, abs(surface.a));
        vec3 origin = p + local_eye + (surface.xyz - normalize(along_view(p))) * ray_epsilon;
        uvec2 bits = texelFetch(starts, texel, 0).xy + phase + RECURRENCE * uint(sample_index);
        vec3 along = cosine_direction(surface.xyz, vec2(bits >> 8u) * TO_UNIT);
        Hit hit = nearest_hit(origin, along);
        if (hit.body >= 0) {
            first = surface_at(hit, origin, along, 0.0);
            near = min(hit.distance / reach, 1.0);
        }
        if (near < 1.0) {
            origin = first.position + ray_epsilon * first.normal;
            along = cosine_direction(first.normal, vec2(hash(bits) >> 8u) * TO_UNIT);
            hit = nearest_hit(origin, along);
            if (hit.body >= 0) second = surface_at(hit, origin, along, 0.0);
        }
    }
    store_ray_end(texel, first, near, vec3(0.0));
    store_ray_end(texel + ivec2(0, size.y), second, 1.0, vec3(0.0));
}
