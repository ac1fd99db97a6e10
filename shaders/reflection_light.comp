// Light along the rays of reflection_trace.comp.
#include "ray_ends.glsl"

layout(rgba32f, binding = 0) writeonly uniform image2D reflection_traced;  // radiance; a: length, 0 where no ray was traced

void main()
{
    ivec2 texel = ivec2(gl_WorkGroupID.xy);
    vec4 light = vec4(light_of(texel, true, vec3(0.0)), texelFetch(end_albedo, texel, 0).a);
    if (gl_LocalInvocationIndex == 0u) imageStore(reflection_traced, texel, light);
}
