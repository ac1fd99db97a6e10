// Outgoing diffuse radiance by direct light, and GGX specular light where a material has a specular lobe.
#include "numbers.glsl"
#include "octahedral.glsl"
#include "grid.glsl"
#include "shadow.glsl"
#include "shadow_ratio.glsl"
#include "sky_irradiance.glsl"
#include "sky_specular.glsl"
#include "ggx.glsl"

uniform sampler2D albedo;
uniform sampler2D normal;
uniform sampler2D depth;
#ifdef WRITE_SPECULAR
uniform sampler2D specular_roughness;
#endif

#ifdef HAS_ENVIRONMENT_DIFFUSE
uniform sampler2D environment_diffuse;   // irradiance / pi
#endif
#ifdef HAS_ENVIRONMENT_SPECULAR
uniform sampler2D environment_specular;  // without Fresnel's law
#endif

#ifdef WRITE_DIRECT
layout(location = WRITE_DIRECT) out vec4 out_direct;
#endif
#ifdef WRITE_SPECULAR
layout(location = WRITE_SPECULAR) out vec4 out_specular;
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, texel, 0).r;
    // Sky takes part, since the texels of a quad share their shadow taps; its light is masked below.
    vec3 diffuse = vec3(0.0), specular = vec3(0.0);
    vec4 surface = texelFetch(normal, texel, 0);
    vec4 base = texelFetch(albedo, texel, 0);
    vec3 n = sanitize_normal(surface.xyz);
    vec3 p = surface_ray(gl_FragCoord.xy) * d;
#ifdef WRITE_SPECULAR
    vec4 reflectance = texelFetch(specular_roughness, texel, 0);
    Lobe lobe = specular_lobe(p, n, reflectance);
    bool is_shiny = max(max(reflectance.r, reflectance.g), reflectance.b) > 0.0;
#endif
#ifdef HAS_SHADOW
    vec3 face = octahedral_decode(vec2(surface.a, base.a));
    QuadNoise noise = quad_noise();
    for (int i = 0; i < MAPPED_COUNT; ++i) {
        vec3 e = irradiance(lights[i], p, n);
        bool wanted = is_surface(d) && max(max(e.r, e.g), e.b) > 0.0;
        float v = visibility(lights[i], p, face, noise, wanted);
        v = wanted ? v : 0.0;
        diffuse += wanted ? v * e : vec3(0.0);
#ifdef WRITE_SPECULAR
        specular += wanted ? v * ggx_specular(lights[i], p, n, lobe) : vec3(0.0);
#endif
    }
#endif
#ifdef HAS_SHADOW_RATIO
    vec3 v = is_surface(d) ? traced_visibility(n, d) : vec3(0.0);
    vec3 traced = vec3(0.0), traced_specular = vec3(0.0);
    // Loops that take no step, not branches, since software rasterisers walk through both sides of each.
    int end = max(max(v.r, v.g), v.b) > 0.0 ? LIGHT_COUNT : MAPPED_COUNT;
    for (int i = MAPPED_COUNT; i < end; ++i) {
        vec3 e = irradiance(lights[i], p, n);
        traced += e;
#ifdef WRITE_SPECULAR
        int steps = is_shiny && max(max(e.r, e.g), e.b) > 0.0 ? 1 : 0;
        for (int k = 0; k < steps; ++k) traced_specular += ggx_specular(lights[i], p, n, lobe);
#endif
    }
#ifdef HAS_SKY_IRRADIANCE
    if (is_surface(d)) traced += unshadowed_sky_irradiance(n);
#endif
#if defined(HAS_SKY_SPECULAR) && defined(WRITE_SPECULAR)
    if (is_surface(d))
        traced_specular += environment_reflectance(reflectance, max(dot(n, -normalize(p)), 0.0))
            * unshadowed_sky_specular(dominant_direction(n, p, reflectance.a), reflectance.a);
#endif
    diffuse += v * traced;
    specular += v * traced_specular;
#endif
#ifdef HAS_ENVIRONMENT_DIFFUSE
    diffuse += PI * sanitize_radiance(texelFetch(environment_diffuse, texel, 0).rgb);
#endif
    diffuse *= sanitize_albedo(base.rgb) / PI;
#ifdef WRITE_DIRECT
    out_direct = vec4(sanitize_radiance(diffuse), 1.0);
#endif
#ifdef WRITE_SPECULAR
#ifdef HAS_ENVIRONMENT_SPECULAR
    if (is_surface(d))
        specular += environment_reflectance(reflectance, max(dot(n, -normalize(p)), 0.0))
            * sanitize_radiance(texelFetch(environment_specular, texel, 0).rgb);
#endif
    out_specular = vec4(sanitize_radiance(specular), 1.0);
#endif
}
