// Where rays end, for ray_ends.glsl.
#include "ray_surface.glsl"

// As ray_ends.glsl describes them.
layout(rgba32f, binding = 0) writeonly uniform image2D end_position;
layout(rgba32f, binding = 1) writeonly uniform image2D end_normal;
layout(rgba32f, binding = 2) writeonly uniform image2D end_albedo;
layout(rgba32f, binding = 3) writeonly uniform image2D end_emission;

const Surface NO_SURFACE = Surface(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), 1.0);

// more_direct: what the albedo for direct light has more.
void store_ray_end(ivec2 texel, Surface s, float ray_length, vec3 more_direct)
{
    imageStore(end_position, texel, vec4(s.position, more_direct.r));
    imageStore(end_normal, texel, vec4(s.normal, more_direct.g));
    imageStore(end_albedo, texel, vec4(s.albedo, ray_length));
    imageStore(end_emission, texel, vec4(s.emission, more_direct.b));
}
