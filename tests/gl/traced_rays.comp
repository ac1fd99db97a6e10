// Any rays through ray_surface.glsl, for tests.
layout(local_size_x = 64) in;
#include "ray_surface.glsl"
layout(std430, binding = 0) buffer Rays { vec4 rays[]; };  // origin, direction; becomes what they meet
uniform int count;

void main()
{
    int i = int(gl_GlobalInvocationID.x);
    if (i >= count) return;
    vec3 origin = rays[5 * i].xyz, along = rays[5 * i + 1].xyz;
    Hit hit = nearest_hit(origin, along);
    bool blocked = is_occluded(origin, along, true), without_proxies = is_occluded(origin, along, false);
    Surface s = Surface(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), 1.0);
    if (hit.body >= 0) s = surface_at(hit, origin, along, 0.0);
    rays[5 * i] = vec4(hit.body >= 0 ? hit.distance : -1.0, hit.body, blocked, without_proxies);
    rays[5 * i + 1] = vec4(s.position, 0.0);
    rays[5 * i + 2] = vec4(s.normal, 0.0);
    rays[5 * i + 3] = vec4(s.albedo, 0.0);
    rays[5 * i + 4] = vec4(s.emission, 0.0);
}
