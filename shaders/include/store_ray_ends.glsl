// Where rays end, for ray_ends.glsl.
#include "ray_surface.glsl"

layout(rgba32f, binding = 0) writeonly uniform image2D end_position;  // local space
layout(rgba32f, binding = 1) writeonly uniform image2D end_normal;    // 0: none
layout(rgba32f, binding = 2) writeonly uniform image2D end_albedo;    // a: the ray's length
layout(rgba32f, binding = 3) writeonly uniform image2D end_emission;

const Surface NO_SURFACE = Surface(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0));

void store_ray_end(ivec2 texel, Surface s, float ray_length)
{
    imageStore(end_position, texel, vec4(s.position, 0.0));
    imageStore(end_normal, texel, vec4(s.normal, 0.0));
    imageStore(end_albedo, texel, vec4(s.albedo, ray_length));
    imageStore(end_emission, texel, vec4(s.emission, 0.0));
}
