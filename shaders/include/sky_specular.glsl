// Unshadowed radiance of the environment within a specular lobe, prefiltered (Karis 2013, "Real Shading in Unreal Engine 4").
#include "octahedral.glsl"

uniform sampler2D sky_specular;  // octahedral maps of directions for evenly spaced roughnesses, from 0 on the left to 1

// Where most of a lobe's light comes from: between the mirrored view and the normal, which rough surfaces lean to
// (Lagarde and de Rousiers 2014, "Moving Frostbite to PBR", section 4.9.3). The eye is the origin.
vec3 dominant_direction(vec3 n, vec3 p, float roughness)
{
    float smoothness = 1.0 - roughness;
    return normalize(mix(n, reflect(normalize(along_view(p)), n), smoothness * (sqrt(smoothness) + roughness)));
}

vec3 unshadowed_sky_specular(vec3 direction, float roughness)
{
    ivec2 size = textureSize(sky_specular, 0);
    float levels = float(size.x / size.y), level = clamp(roughness, 0.0, 1.0) * (levels - 1.0), low = floor(level);
    // Half a texel from its edges a map would blend into the one beside it.
    vec2 at = clamp(octahedral_encode(direction) * 0.5 + 0.5, 0.5 / float(size.y), 1.0 - 0.5 / float(size.y));
    vec3 smoother = textureLod(sky_specular, vec2((low + at.x) / levels, at.y), 0.0).rgb;
    vec3 rougher = textureLod(sky_specular, vec2((min(low + 1.0, levels - 1.0) + at.x) / levels, at.y), 0.0).rgb;
    return mix(smoother, rougher, level - low);
}
