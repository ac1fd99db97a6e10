// Light along the rays of reflection_trace.comp, also from where they go on, where lengths are negative.
#include "ray_ends.glsl"

layout(rgba32f, binding = 0) writeonly uniform image2D reflection_traced;  // radiance; a: length, 0 where no ray was traced

uniform sampler2D end_highlights;  // radiance: four texels for each end

void main()
{
    ivec2 texel = ivec2(gl_WorkGroupID.xy);
    ivec2 beyond = texel + ivec2(0, textureSize(end_albedo, 0).y / 2);
    vec3 light = light_of(texel, true, vec3(0.0)) + light_of(beyond, true, vec3(0.0));
    light += mean_of_quad(end_highlights, texel) + mean_of_quad(end_highlights, beyond);
    if (gl_LocalInvocationIndex == 0u) imageStore(reflection_traced, texel, vec4(light, texelFetch(end_albedo, texel, 0).a));
}
