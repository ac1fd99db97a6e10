// Indirect specular light on its own: what composite.frag adds, or OF_OUTER surfaces.
#include "numbers.glsl"
#include "reflected_light.glsl"

uniform sampler2D indirect;
#ifdef OF_OUTER
uniform sampler2D albedo;  // share of the pixel that reflects; 1 for a layer of what is seen through, 0 for a clear coat
#endif
#ifdef HAS_OUTER_REFLECTION
uniform sampler2D outer_reflection;
#endif

layout(location = 0) out vec4 out_reflection;  // a: 0 for a clear coat, else 1

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 arriving = sanitize_radiance(texelFetch(indirect, texel, 0).rgb);
    float share = 1.0, kind = 1.0;
#ifdef OF_OUTER
    vec4 outer = texelFetch(albedo, texel, 0);
    share = sanitize_albedo(outer.rrr).x;
    kind = outer.g;
    arriving *= 1.0 - kind;  // at a layer it is not known, only at what is behind
#endif
    vec3 light = share * reflected_light(texel, arriving);
#ifdef HAS_OUTER_REFLECTION
    light += sanitize_radiance(texelFetch(outer_reflection, texel, 0).rgb);
#endif
    out_reflection = vec4(min(light, HALF_MAX), kind);
}
