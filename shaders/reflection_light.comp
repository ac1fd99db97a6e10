// Light along the rays of reflection_trace.comp, also from where they go on, where lengths are negative.
#include "ray_ends.glsl"

layout(rgba32f, binding = 0) writeonly uniform image2D reflection_traced;  // radiance; a: length, 0 where no ray was traced

uniform sampler2D end_highlights;  // radiance: four texels for each end

vec3 highlights_at(ivec2 end)
{
    ivec2 quad = 2 * end;
    return 0.25 * (texelFetch(end_highlights, quad, 0).rgb + texelFetch(end_highlights, quad + ivec2(1, 0), 0).rgb
                   + texelFetch(end_highlights, quad + ivec2(0, 1), 0).rgb + texelFetch(end_highlights, quad + 1, 0).rgb);
}

void main()
{
    ivec2 texel = ivec2(gl_WorkGroupID.xy);
    ivec2 beyond = texel + ivec2(0, textureSize(end_albedo, 0).y / 2);
    vec3 light = light_of(texel, true, vec3(0.0)) + light_of(beyond, true, vec3(0.0));
    light += highlights_at(texel) + highlights_at(beyond);
    if (gl_LocalInvocationIndex == 0u) imageStore(reflection_traced, texel, vec4(light, texelFetch(end_albedo, texel, 0).a));
}
