// The display image: a tone map of exposure * x; without one, the sRGB transfer (IEC 61966-2-1) of clamp(x, 0, 1).
#include "numbers.glsl"
#ifdef TONEMAP_AGX
#include "agx.glsl"
#endif
#ifdef TONEMAP_PBR_NEUTRAL
#include "pbr_neutral.glsl"
#endif
#ifdef TONEMAP_ACES
#include "aces.glsl"
#endif

uniform sampler2D picture;  // the finished one
#ifdef HAS_AUTO_EXPOSURE
uniform sampler2D auto_exposure;
#endif
uniform float exposure;  // with the scene's scale undone, unless auto_exposure undoes it


layout(location = 0) out vec4 out_display;

vec3 srgb_encode(vec3 x)
{
    return mix(12.92 * x, 1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, greaterThan(x, vec3(0.0031308)));
}

void main()
{
    vec3 c = sanitize_radiance(texelFetch(picture, ivec2(gl_FragCoord.xy), 0).rgb);
    vec3 x = c * exposure;
#ifdef HAS_AUTO_EXPOSURE
    x *= texelFetch(auto_exposure, ivec2(0), 0).r;
#endif
    x = min(x, HALF_MAX);
#ifdef TONEMAP_AGX
    out_display = vec4(agx(x), 1.0);
#else
#ifdef TONEMAP_PBR_NEUTRAL
    x = pbr_neutral(x);
#endif
#ifdef TONEMAP_ACES
    x = aces(x);
#endif
    out_display = vec4(srgb_encode(min(x, 1.0)), 1.0);
#endif
}
