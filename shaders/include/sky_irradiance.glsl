// Unshadowed irradiance of the environment.
#include "octahedral.glsl"

uniform sampler2D sky_irradiance;  // over the octahedral map of normals

vec3 unshadowed_sky_irradiance(vec3 n)
{
    return textureLod(sky_irradiance, octahedral_encode(n) * 0.5 + 0.5, 0.0).rgb;
}
