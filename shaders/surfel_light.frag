// Irradiance / π by direct light at the light samples of world surfels, and with lobes at the ends of rays what highlights of lights
// with shadow maps add. The four texels of a quad show one sample.
#define LOBES_OF_SPHERES
#include "numbers.glsl"
#include "camera.glsl"
#include "shadow.glsl"
#include "ggx.glsl"

uniform sampler2D light_sample_position;  // local space: world axes, the scene's centre as origin
uniform sampler2D light_sample_normal;    // 0: no sample
uniform sampler2D light_sample_visibility;  // share of the traced lights that reaches a sample
uniform vec3 local_eye;
#ifdef HAS_LOBES
const float MIN_LOBE_ROUGHNESS = 0.3;  // rays that meet sharper highlights by chance would be dots

uniform sampler2D light_sample_lobe;  // F0; roughness
uniform sampler2D light_sample_view;  // unit vector towards the viewer; a: share of the lobe that is wanted

layout(location = 1) out vec4 highlights;  // radiance, less what the same light would be as diffuse light
#endif

layout(location = 0) out vec4 light;

void main()
{
    ivec2 sample_texel = ivec2(gl_FragCoord.xy) / 2;
    vec3 p = texelFetch(light_sample_position, sample_texel, 0).xyz - local_eye;
    vec3 n = texelFetch(light_sample_normal, sample_texel, 0).xyz;
    bool used = dot(n, n) > 0.5;
    vec3 sum = vec3(0.0);
#ifdef HAS_LOBES
    vec4 reflectance = texelFetch(light_sample_lobe, sample_texel, 0), view = texelFetch(light_sample_view, sample_texel, 0);
    Lobe lobe = lobe_towards(view.xyz, n, vec4(reflectance.rgb, max(reflectance.a, MIN_LOBE_ROUGHNESS)));
    vec3 specular = vec3(0.0), replaced = vec3(0.0);
#endif
#ifdef HAS_SHADOW
    QuadNoise noise = quad_noise();
    for (int i = 0; i < MAPPED_COUNT; ++i) {
        vec3 e = irradiance(lights[i], p, n);
        bool wanted = used && max(max(e.r, e.g), e.b) > 0.0;
        vec3 v = arriving_share(lights[i], p, n, noise, wanted);
        sum += wanted ? v * e : vec3(0.0);
#ifdef HAS_LOBES
        bool reflects = wanted && int(lights[i].color.w) != RECT;
        specular += reflects ? v * ggx_specular(lights[i], p, n, lobe) : vec3(0.0);
        replaced += reflects ? v * e : vec3(0.0);
#endif
    }
#endif
#ifdef HAS_LOBES
    replaced *= specular_albedo(reflectance.rgb, reflectance.a, MEAN_COSINE) / PI;
    highlights = vec4(view.a * (sanitize_radiance(specular) - sanitize_radiance(replaced)), 1.0);
#endif
    vec3 traced = vec3(0.0);
    for (int i = MAPPED_COUNT; i < LIGHT_COUNT; ++i) traced += used ? traced_irradiance(lights[i], p, n) : vec3(0.0);
    if (MAPPED_COUNT < LIGHT_COUNT) sum += clamp(texelFetch(light_sample_visibility, sample_texel, 0).rgb, 0.0, 1.0) * traced;
    light = vec4(sanitize_radiance(sum / PI), 1.0);
}
