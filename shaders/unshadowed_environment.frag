// The environment's light on surfaces without occlusion, from a few directions that represent all of it: coarse
// diffuse and GGX specular shading, demodulated (Suppan et al., "Neural Direct Illumination").
#include "channels.glsl"
#include "nearest_texel.glsl"
#include "ggx_lobe.glsl"

uniform vec4 directions[DIRECTIONS];  // world axes; w: radius of what each stands for, as an angle
uniform vec3 powers[DIRECTIONS];      // radiance times solid angle
uniform vec2 ratio;                   // full-resolution texels per low-resolution texel

#ifdef WRITE_DIFFUSE
layout(location = WRITE_DIFFUSE) out vec4 out_diffuse;    // irradiance / pi
#endif
#ifdef WRITE_SPECULAR
layout(location = WRITE_SPECULAR) out vec4 out_specular;  // radiance that the lobe gathers, without the Fresnel term
#endif

void main()
{
    ivec2 full = nearest_texel(ivec2(gl_FragCoord.xy), ratio);
    vec3 n = channel_normal_world_xyz(full), v = -normalize(surface_ray(centre(full)));
    float roughness = channel_roughness(full), n_v = max(dot(n, v), 1e-3);
    vec3 diffuse = vec3(0.0), specular = vec3(0.0);
    for (int i = 0; i < DIRECTIONS; ++i) {
        vec3 l = directions[i].xyz;
        float n_l = dot(n, l);
        if (n_l <= 0.0) continue;
        diffuse += n_l * powers[i];
#ifdef WRITE_SPECULAR
        // Wide enough to reach from one direction to the next; of sums without gaps, this one erred least.
        float alpha = min(length(vec2(max(roughness * roughness, MIN_ALPHA), directions[i].w)), 1.0);
        specular += n_l * ggx_lobe(clamp(dot(n, normalize(l + v)), 0.0, 1.0), n_v, n_l, alpha) * powers[i];
#endif
    }
#ifdef WRITE_DIFFUSE
    out_diffuse = vec4(sanitize_radiance(diffuse / PI), 1.0);
#endif
#ifdef WRITE_SPECULAR
    out_specular = vec4(sanitize_radiance(specular), 1.0);
#endif
}
