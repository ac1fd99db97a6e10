// Directional albedo of the GGX lobe, with the light that it scatters more than once (Turquin 2019, "Practical multiple
// scattering compensation for microfacet models"). scripts/fit_specular_albedo.py fits the constants: the lobe's albedo
// errs by at most 0.8 % of itself, what Schlick's term adds by 0.007.
#include "ggx_lobe.glsl"

const float MEAN_COSINE = 2.0 / 3.0;   // between a normal and the light that arrives from everywhere
const float MIN_ALBEDO_COSINE = 1e-3;  // of the viewing angle, as in the fit
const vec4 ALBEDO_0 = vec4(0.0714, 0.8686, 3.8181, -0.6607);  // by powers of alpha
const vec4 ALBEDO_1 = vec4(1.0981, -5.9803, -13.6567, -2.9335);
const vec4 ALBEDO_2 = vec4(-1.4322, 10.3178, 51.7082, 19.1513);
const vec4 ALBEDO_3 = vec4(-0.9956, -4.1705, -73.4694, -66.5392);
const vec4 ALBEDO_4 = vec4(1.2612, -0.5732, 24.0084, 75.1198);
const vec4 FRESNEL_0 = vec4(0.9994, -1.2398, 2.1184, -0.8626);  // by powers of the roughness
const vec4 FRESNEL_1 = vec4(-0.0619, 3.5864, -14.6455, 14.5119);
const vec4 FRESNEL_2 = vec4(0.0791, -2.9028, 22.8373, -4.2034);

// x: share of light from everywhere that the lobe reflects without a Fresnel term and once, E; y: mean of Schlick's
// (1 - v·h)^5 over what it reflects.
vec2 lobe_albedo(float roughness, float n_v)
{
    float r = is_finite(roughness) ? clamp(roughness, 0.0, 1.0) : 1.0, alpha = max(r * r, MIN_ALPHA);
    float cosine = clamp(n_v, MIN_ALBEDO_COSINE, 1.0), t = cosine / (cosine + alpha), grazing = 1.0 - cosine;
    vec4 of_alpha = vec4(1.0, alpha, alpha * alpha, alpha * alpha * alpha), of_roughness = vec4(1.0, r, r * r, r * r * r);
    vec4 lost = t * (ALBEDO_0 + t * (ALBEDO_1 + t * (ALBEDO_2 + t * (ALBEDO_3 + t * ALBEDO_4))));
    vec4 fresnel = FRESNEL_0 + t * (FRESNEL_1 + t * FRESNEL_2);
    float spread = grazing * grazing / (1.0 + 4.0 * alpha);
    return clamp(vec2(1.0 - dot(lost, of_alpha), spread * spread * grazing * dot(fresnel, of_roughness)), 0.0, 1.0);
}

// What the lobe reflects once, times this, is what it reflects; E as above.
vec3 multiple_scattering(vec3 f0, float albedo)
{
    return 1.0 + f0 * (1.0 / albedo - 1.0);
}

// Mean Fresnel term over what a lobe of lobe_albedo reflects once, with light that is scattered more than once. An F0 of 0
// means no reflection.
vec3 reflectance_of(vec3 f0, vec2 lobe)
{
    bool reflects = max(max(f0.r, f0.g), f0.b) > 0.0;
    return reflects ? (f0 + (1.0 - f0) * lobe.y) * multiple_scattering(f0, lobe.x) : vec3(0.0);
}

// Factor of light that the lobe without a Fresnel term reflects once towards a viewer at cosine n_v.
vec3 lobe_reflectance(vec3 f0, float roughness, float n_v)
{
    return reflectance_of(f0, lobe_albedo(roughness, n_v));
}

// Share of light from everywhere that the lobe reflects towards a viewer at cosine n_v.
vec3 specular_albedo(vec3 f0, float roughness, float n_v)
{
    vec2 lobe = lobe_albedo(roughness, n_v);
    return lobe.x * reflectance_of(f0, lobe);
}
