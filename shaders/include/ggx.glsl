// GGX specular light of analytic lights. Spheres, and discs of parallel light, act through the point nearest to the mirrored
// ray (Karis 2013, "Real Shading in Unreal Engine 4"), with alpha widened to conserve energy. Discs count as smaller by the lobe's
// half width, since a highlight fades from inside their edge on, and act through their centre if the lobe is wider.
#include "lights.glsl"
#include "ggx_lobe.glsl"
#if defined(HAS_RECT_LIGHT) && !defined(LOBES_OF_SPHERES)
#include "ltc.glsl"
#endif
#include "specular_albedo.glsl"

const float HALF_WIDTH = 0.64;  // of a lobe in alphas: the half vector's tangent at which it has half of its radiance

// The specular lobe of a texel, the same for all of its lights.
struct Lobe {
    vec3 f0;
    float alpha;
    vec3 v;             // towards the viewer
    float albedo;       // share of light from everywhere that is scattered once, without Fresnel's law
    vec3 compensation;  // factor of light that is scattered more than once
#if defined(HAS_RECT_LIGHT) && !defined(LOBES_OF_SPHERES)
    RectLobe rect;
#endif
};

// v: towards the viewer; specular_roughness holds F0 and roughness.
Lobe lobe_towards(vec3 v, vec3 n, vec4 specular_roughness)
{
    Lobe lobe;
    lobe.f0 = specular_roughness.rgb;
    lobe.alpha = max(specular_roughness.a * specular_roughness.a, MIN_ALPHA);
    lobe.v = v;
    lobe.albedo = lobe_albedo(specular_roughness.a, dot(n, lobe.v)).x;
    lobe.compensation = multiple_scattering(lobe.f0, lobe.albedo);
#if defined(HAS_RECT_LIGHT) && !defined(LOBES_OF_SPHERES)
    lobe.rect = rect_lobe(n, lobe.v, lobe.alpha);
#endif
    return lobe;
}

// Towards the eye, of the surface at relative point p.
Lobe specular_lobe(vec3 p, vec3 n, vec4 specular_roughness)
{
    return lobe_towards(-normalize(along_view(p)), n, specular_roughness);
}

#if defined(HAS_RECT_LIGHT) && !defined(LOBES_OF_SPHERES)
// Mean of Schlick's approximation over the lobe, with light that is scattered more than once.
vec3 rect_reflectance(Lobe lobe, RectLobe rect)
{
    return lobe.compensation * (lobe.f0 + (1.0 - lobe.f0) * rect.weights.w);
}
#endif

// Radiance towards the viewer from point p.
vec3 ggx_specular(Light light, vec3 p, vec3 n, Lobe lobe)
{
    if (max(max(lobe.f0.r, lobe.f0.g), lobe.f0.b) <= 0.0) return vec3(0.0);
    int kind = int(light.color.w);
    vec3 arriving = light.color.rgb;  // irradiance on a facing surface
#if defined(HAS_RECT_LIGHT) && !defined(LOBES_OF_SPHERES)
    if (kind == RECT) {
        float share = min(rect_specular(light, p, n, lobe.rect), lobe.albedo);
        return arriving * rect_reflectance(lobe, lobe.rect) * share;
    }
#endif
    vec3 to_light = light.position.xyz - (kind == DIRECTIONAL ? vec3(0.0) : p);
    float size = light.position.w, most = 1e30;  // most: share of arriving light that may be reflected
    float reach = kind == DIRECTIONAL ? max(size - HALF_WIDTH * lobe.alpha, 0.0) : size;
    if (size > 0.0) {
        vec3 mirrored = reflect(-lobe.v, n);
        vec3 miss = dot(to_light, mirrored) * mirrored - to_light;
        to_light += miss * min(reach / max(length(miss), 1e-6), 1.0);
    }
    float square = max(dot(to_light, to_light), 1e-12);
    vec3 l = to_light * inversesqrt(square);
    float widened = clamp(lobe.alpha + 0.5 * reach * inversesqrt(square), lobe.alpha, 1.0);
    float far = kind == DIRECTIONAL ? 1.0 + size * size : square;  // its squared distance, where its radius is size
    if (size > 0.0) most = lobe.albedo * far / (PI * size * size);  // as of the light's radiance from everywhere
    if (kind != DIRECTIONAL) arriving /= square;
#ifdef HAS_SPOT_LIGHT
    if (kind == SPOT) arriving *= spot_falloff(light, normalize(light.position.xyz - p));
#endif
    float n_l = dot(n, l), n_v = max(dot(n, lobe.v), 1e-3);
    if (n_l <= 0.0) return vec3(0.0);
    vec3 h = normalize(l + lobe.v);
    float energy = (lobe.alpha / widened) * (lobe.alpha / widened);
    vec3 fresnel = lobe.f0 + (1.0 - lobe.f0) * pow(1.0 - clamp(dot(h, lobe.v), 0.0, 1.0), 5.0);
    float share = n_l * energy * ggx_lobe(clamp(dot(n, h), 0.0, 1.0), n_v, n_l, lobe.alpha);
    return arriving * min(share, most) * lobe.compensation * fresnel;
}
