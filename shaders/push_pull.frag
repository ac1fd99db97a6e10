// Fills the sky of low-resolution light from the surfaces around it, by pull-push (Gortler et al. 1996, "The
// Lumigraph"), for surfaces that upsampling finds between texels that all show the sky.
#include "numbers.glsl"

uniform sampler2D light_low;
uniform sampler2D lowres_gbuffer;
uniform sampler2D pyramid;

layout(location = 0) out vec4 out_light;

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
    bool surface = is_surface(texelFetch(lowres_gbuffer, low, 0).a);
    vec2 at = gl_FragCoord.xy / vec2(textureSize(light_low, 0));
    vec4 found = surface ? vec4(texelFetch(light_low, low, 0).rgb, 1.0) : vec4(0.0);
    int levels = surface ? 0 : textureQueryLevels(pyramid);
    for (int level = 1; level < levels; ++level) found += (1.0 - found.a) * textureLod(pyramid, at, float(level));
    out_light = vec4(sanitize_radiance(found.rgb / max(found.a, 1e-6)), 1.0);
}
