// GGX specular light of analytic lights. Lights with a size act through the point nearest to the mirrored ray
// (Karis 2013, "Real Shading in Unreal Engine 4"), with alpha widened to conserve energy.
#include "lights.glsl"
#include "ggx_lobe.glsl"

// Specular albedo for light from everywhere: Schlick's law at the angle of the view, with less of a rim where rough
// (Lagarde 2011, "Adopting a physically based shading model"); specular_roughness holds F0 and roughness.
vec3 environment_reflectance(vec4 specular_roughness, float n_v)
{
    if (max(max(specular_roughness.r, specular_roughness.g), specular_roughness.b) <= 0.0) return vec3(0.0);
    return specular_roughness.rgb + (max(vec3(1.0 - specular_roughness.a), specular_roughness.rgb) - specular_roughness.rgb) * pow(1.0 - n_v, 5.0);
}

// Radiance towards the viewer (at the origin of relative space) from point p; specular_roughness holds F0 and roughness.
vec3 ggx_specular(Light light, vec3 p, vec3 n, vec4 specular_roughness)
{
    if (max(max(specular_roughness.r, specular_roughness.g), specular_roughness.b) <= 0.0) return vec3(0.0);
    vec3 v = -normalize(p);
    vec3 mirrored = reflect(-v, n);
    float alpha = max(specular_roughness.a * specular_roughness.a, MIN_ALPHA);
    int kind = int(light.color.w);
    vec3 l = light.position.xyz;
    vec3 arriving = light.color.rgb;  // irradiance on a facing surface
    float widened = alpha;
    if (kind != DIRECTIONAL) {
        vec3 to_light = light.position.xyz - p;
        float size = light.position.w;
        if (kind == RECT) {
            vec3 facing = cross(light.u.xyz, light.v.xyz);
            float area = 4.0 * length(facing);
            float slope = dot(mirrored, facing);
            vec3 hit = mirrored * max(dot(to_light, facing) / (abs(slope) > 1e-6 ? slope : 1e-6), 0.0) - to_light;
            vec2 inside = clamp(vec2(dot(hit, light.u.xyz) / dot(light.u.xyz, light.u.xyz),
                                     dot(hit, light.v.xyz) / dot(light.v.xyz, light.v.xyz)), -1.0, 1.0);
            to_light += inside.x * light.u.xyz + inside.y * light.v.xyz;
            float tilt = -dot(normalize(to_light), normalize(facing));
            arriving *= area * (light.v.w > 0.5 ? abs(tilt) : max(tilt, 0.0));
            size = sqrt(area / PI);
        } else if (size > 0.0) {
            vec3 miss = dot(to_light, mirrored) * mirrored - to_light;
            to_light += miss * min(size / max(length(miss), 1e-6), 1.0);
        }
        float square = max(dot(to_light, to_light), 1e-12);
        l = to_light * inversesqrt(square);
        arriving /= square;
        widened = clamp(alpha + 0.5 * size * inversesqrt(square), alpha, 1.0);
#ifdef HAS_SPOT_LIGHT
        if (kind == SPOT) arriving *= spot_falloff(light, normalize(light.position.xyz - p));
#endif
    }
    float n_l = dot(n, l), n_v = max(dot(n, v), 1e-3);
    if (n_l <= 0.0) return vec3(0.0);
    vec3 h = normalize(l + v);
    float energy = (alpha / widened) * (alpha / widened);
    vec3 fresnel = specular_roughness.rgb + (1.0 - specular_roughness.rgb) * pow(1.0 - clamp(dot(h, v), 0.0, 1.0), 5.0);
    return arriving * n_l * energy * fresnel * ggx_lobe(clamp(dot(n, h), 0.0, 1.0), n_v, n_l, alpha);
}
