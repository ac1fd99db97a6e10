// The finished picture: linear radiance in scene units, and the display image by the sRGB transfer
// (IEC 61966-2-1) of clamp(exposure * x, 0, 1).
#include "numbers.glsl"

#ifdef HAS_TAA
uniform sampler2D taa;
#define SOURCE taa
#else
uniform sampler2D lit;
#define SOURCE lit
#endif
uniform float unscale;   // undoes the scene's power of two
uniform float exposure;

#ifdef WRITE_FINAL
layout(location = WRITE_FINAL) out vec4 out_final;
#endif
#ifdef WRITE_DISPLAY
layout(location = WRITE_DISPLAY) out vec4 out_display;
#endif

void main()
{
    vec3 c = sanitize_radiance(texelFetch(SOURCE, ivec2(gl_FragCoord.xy), 0).rgb) * unscale;
#ifdef WRITE_FINAL
    out_final = vec4(c, 1.0);
#endif
#ifdef WRITE_DISPLAY
    vec3 x = clamp(c * exposure, 0.0, 1.0);
    out_display = vec4(mix(12.92 * x, 1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, greaterThan(x, vec3(0.0031308))), 1.0);
#endif
}
