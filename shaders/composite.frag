// Everything that reaches the camera: direct + albedo * occlusion * indirect + emission + specular + reflection, and the background.
#include "numbers.glsl"
#ifdef HAS_SPECULAR_ROUGHNESS
#include "reflected_light.glsl"
#endif

uniform sampler2D direct;
#ifdef HAS_INDIRECT
uniform sampler2D indirect;
uniform sampler2D albedo;
#endif
#ifdef HAS_OCCLUSION
uniform sampler2D occlusion;
#endif
#ifdef HAS_EMISSION
uniform sampler2D emission;
#endif
#ifdef HAS_SPECULAR
uniform sampler2D specular;
#endif
#ifdef HAS_OUTER_REFLECTION
uniform sampler2D outer_reflection;  // a: 0 for a clear coat, 1 for a layer of what is seen through
#endif
#ifdef HAS_BACKGROUND
uniform sampler2D background;
#endif

layout(location = 0) out vec4 out_lit;

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 sum = sanitize_radiance(texelFetch(direct, texel, 0).rgb);
#ifdef HAS_INDIRECT
    vec3 arriving = sanitize_radiance(texelFetch(indirect, texel, 0).rgb);
#ifdef HAS_SPECULAR_ROUGHNESS
    sum += reflected_light(texel, arriving);
#endif
#ifdef HAS_OCCLUSION
    arriving *= texelFetch(occlusion, texel, 0).r;
#endif
    sum += sanitize_albedo(texelFetch(albedo, texel, 0).rgb) * arriving;
#endif
#ifdef HAS_EMISSION
    sum += sanitize_radiance(texelFetch(emission, texel, 0).rgb);
#endif
#ifdef HAS_SPECULAR
    sum += sanitize_radiance(texelFetch(specular, texel, 0).rgb);
#endif
#ifdef HAS_OUTER_REFLECTION
    vec4 of_coat = texelFetch(outer_reflection, texel, 0);
    sum += of_coat.a < 0.5 ? sanitize_radiance(of_coat.rgb) : vec3(0.0);
#endif
#ifdef HAS_BACKGROUND
    sum += sanitize_radiance(texelFetch(background, texel, 0).rgb);
#endif
    out_lit = vec4(min(sum, HALF_MAX), 1.0);
}
