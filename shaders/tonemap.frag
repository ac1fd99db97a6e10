// The display image: the sRGB transfer (IEC 61966-2-1) of clamp(exposure * x, 0, 1).
#include "numbers.glsl"

#ifdef HAS_TAA
uniform sampler2D taa;
#define SOURCE taa
#else
uniform sampler2D lit;
#define SOURCE lit
#endif
uniform float exposure;  // with the scene's scale undone


layout(location = 0) out vec4 out_display;

void main()
{
    vec3 c = sanitize_radiance(texelFetch(SOURCE, ivec2(gl_FragCoord.xy), 0).rgb);
    vec3 x = min(c * exposure, 1.0);
    out_display = vec4(mix(12.92 * x, 1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, greaterThan(x, vec3(0.0031308))), 1.0);
}
