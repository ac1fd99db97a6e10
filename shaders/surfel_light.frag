// Irradiance / π by direct light at the light samples of world surfels. The four texels of a quad show one sample.
#include "numbers.glsl"
#include "shadow.glsl"

uniform sampler2D light_sample_position;  // local space: world axes, the scene's centre as origin
uniform sampler2D light_sample_normal;    // 0: no sample
uniform sampler2D light_sample_visibility;  // share of the traced lights that reaches a sample
uniform vec3 local_eye;

out vec4 light;

void main()
{
    ivec2 sample_texel = ivec2(gl_FragCoord.xy) / 2;
    vec3 p = texelFetch(light_sample_position, sample_texel, 0).xyz - local_eye;
    vec3 n = texelFetch(light_sample_normal, sample_texel, 0).xyz;
    bool used = dot(n, n) > 0.5;
    vec3 sum = vec3(0.0);
#ifdef HAS_SHADOW
    QuadNoise noise = quad_noise();
    for (int i = 0; i < MAPPED_COUNT; ++i) {
        vec3 e = irradiance(lights[i], p, n);
        bool wanted = used && max(max(e.r, e.g), e.b) > 0.0;
        vec3 v = arriving_share(lights[i], p, n, noise, wanted);
        sum += wanted ? v * e : vec3(0.0);
    }
#endif
    vec3 traced = vec3(0.0);
    for (int i = MAPPED_COUNT; i < LIGHT_COUNT; ++i) traced += used ? irradiance(lights[i], p, n) : vec3(0.0);
    if (MAPPED_COUNT < LIGHT_COUNT) sum += clamp(texelFetch(light_sample_visibility, sample_texel, 0).rgb, 0.0, 1.0) * traced;
    light = vec4(sanitize_radiance(sum / PI), 1.0);
}
