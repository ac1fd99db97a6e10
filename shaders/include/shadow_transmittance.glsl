// What blended and transmissive surfaces leave of a light: the product of all of them in a texel of the light's map, for
// receivers behind the nearest of them.
#include "shadow_map.glsl"

const float OWN_TEXELS = 3.0;  // a surface does not shade what is nearer behind it, which may be itself

uniform sampler2D shadow_transmittance;
uniform sampler2D shadow_transmittance_depth;  // distance of the nearest of these surfaces

// How far before a receiver its own surface may be, as a share of its distance from the light or of half the map.
float own_width(Light light)
{
    return OWN_TEXELS * 2.0 / light.tile.z;
}

// Distance up to which a receiver is not behind what a texel of the atlas lets light pass.
float nearest_passed(ivec2 texel, float own)
{
    return texelFetch(shadow_transmittance_depth, texel, 0).r + own;
}

// What a texel of the atlas lets pass to a receiver, which may be behind it.
vec3 texel_transmittance(ivec2 texel, bool is_behind)
{
    return is_behind ? texelFetch(shadow_transmittance, texel, 0).rgb : vec3(1.0);
}

// At relative point p, of the middle of a light. Opaque surfaces hide what lies behind them from the map, so texels in
// which they shade p don't count: the light that passes there is not p's.
vec3 middle_transmittance(Light light, vec3 p)
{
    vec2 corner = light.tile.xy, fraction = vec2(0.5);
    float distance = 0.0, own = own_width(light);
#ifdef HAS_PARALLEL_MAP
    if (int(light.tile.w) == PARALLEL_MAP) {
        fraction = vec2(dot(light.frame_x.xyz, p) + light.frame_x.w, dot(light.frame_y.xyz, p) + light.frame_y.w)
            * (0.5 / light.u.x) + 0.5;
        distance = dot(light.frame_z.xyz, p) + light.frame_z.w;
        own *= light.u.x;
    }
#endif
#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
    if (int(light.tile.w) != PARALLEL_MAP) {
        vec3 q = p - light.position.xyz;
        fraction = map_fraction(light, q, corner);
        distance = length(q);
        own *= distance;
    }
#endif
    vec2 at = fraction * light.tile.z - 0.5, base = floor(at), f = at - base;
    vec4 sum = vec4(0.0), sum_of_all = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        ivec2 offset = ivec2(i % 2, i / 2);
        ivec2 t = ivec2(corner + clamp(base + vec2(offset), vec2(0.0), vec2(light.tile.z - 1.0)));
        vec2 closeness = mix(1.0 - f, f, vec2(offset));
        bool is_shaded = distance > texelFetch(shadow, t, 0).r + own;
        vec4 passing = closeness.x * closeness.y * vec4(texel_transmittance(t, distance > nearest_passed(t, own)), 1.0);
        sum_of_all += passing;
        sum += is_shaded ? vec4(0.0) : passing;
    }
    sum = sum.a > 0.0 ? sum : sum_of_all;
    return sum.rgb / sum.a;
}
