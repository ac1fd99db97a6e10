// Light between the surfels at the pixels that missed_pixels.frag found, as app/passes/missed_pixels.py finds it on the CPU.
#include "numbers.glsl"
#include "surfel_kernel.glsl"

uniform sampler2D missed_position;  // relative space; a: 1 + number of the pixel in its tile, or 0
uniform sampler2D missed_surface;   // normal, depth
uniform vec3 local_eye;             // in local space: world axes, the scene's centre as origin

layout(rgba32f, binding = 0) writeonly uniform image2D missed_light;

void main()
{
    ivec2 tile = ivec2(gl_WorkGroupID.xy);
    vec4 at = texelFetch(missed_position, tile, 0), light = vec4(0.0);
    if (at.a > 0.0 && is_finite(dot(at, vec4(1.0)))) {
        vec3 normal = texelFetch(missed_surface, tile, 0).xyz;
        light = vec4(sanitize_radiance(surfel_light_at(at.xyz + local_eye, normal).indirect), at.a);
    }
    if (gl_LocalInvocationIndex == 0u) imageStore(missed_light, tile, light);
}
