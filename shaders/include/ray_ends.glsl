// Light that surfaces where rays end send back along these.
#include "numbers.glsl"
#include "surfel_kernel.glsl"

// a of the position, the normal and the emission: what the albedo for direct light has more.
uniform sampler2D end_position;  // local space
uniform sampler2D end_normal;    // 0: none
uniform sampler2D end_albedo;    // a: the ray's length
uniform sampler2D end_emission;
uniform sampler2D end_light;     // irradiance / π by mapped lights: four texels for each
#ifdef HAS_TRACED_LIGHT
uniform sampler2D end_traced;    // irradiance by traced lights
#endif

// The mean over the four texels of an end.
vec3 mean_of_quad(sampler2D drawn, ivec2 end)
{
    ivec2 quad = 2 * end;
    return 0.25 * (texelFetch(drawn, quad, 0).rgb + texelFetch(drawn, quad + ivec2(1, 0), 0).rgb
                   + texelFetch(drawn, quad + ivec2(0, 1), 0).rgb + texelFetch(drawn, quad + 1, 0).rgb);
}

vec3 direct_at(ivec2 end)
{
    vec3 light = mean_of_quad(end_light, end);
#ifdef HAS_TRACED_LIGHT
    light += texelFetch(end_traced, end, 0).rgb / PI;
#endif
    return light;
}

// Light that an end reflects and emits; ``own`` is the indirect light that arrives at it where surfels are not asked.
vec3 light_of(ivec2 end, bool asks_surfels, vec3 own)
{
    vec4 normal = texelFetch(end_normal, end, 0), emitted = texelFetch(end_emission, end, 0);
    if (dot(normal.xyz, normal.xyz) < 0.5) return emitted.rgb;
    vec4 position = texelFetch(end_position, end, 0);
    SurfelLight between = surfel_light_at(position.xyz, normal.xyz);
    vec3 direct = direct_at(end), arrives = direct + between.sky + (asks_surfels ? between.indirect : own);
    return emitted.rgb + texelFetch(end_albedo, end, 0).rgb * arrives + vec3(position.a, normal.a, emitted.a) * direct;
}
