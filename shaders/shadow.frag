// Linear distance from the light: radial, or along the direction of parallel light (PARALLEL). For hard lights also
// the slope of the surface there: how much nearer it comes along the map's x and y (see hard_shadow.glsl).
#include "numbers.glsl"
#include "uv_sets.glsl"

in vec3 position;
#if defined(ALPHA_MASK) || defined(SEE_THROUGH)
uniform vec2 alpha;  // factor, cutoff
#ifdef ALBEDO_MAP
uniform sampler2D albedo_map;
uniform mat3 albedo_uv;
#endif
#ifdef VERTEX_COLOR
in vec4 color;
#endif
#endif
uniform mat3 frame;  // columns: half edges of the map at unit depth (of parallel light: their directions), and its axis

#ifdef WRITE_SHADOW_TRANSMITTANCE
uniform vec3 passing;  // share of light that passes what is covered, without maps and metals
uniform float faces;   // that share this: two of a volume
#ifdef METALLIC
uniform float metallic;
#ifdef METALLIC_ROUGHNESS_MAP
uniform sampler2D metallic_roughness_map;  // b: metallic
uniform mat3 metallic_roughness_uv;
#endif
#endif
#ifdef TRANSMISSION_MAP
uniform sampler2D transmission_map;        // r
uniform mat3 transmission_uv;
#endif
layout(location = WRITE_SHADOW_TRANSMITTANCE) out vec4 out_transmittance;
#else
layout(location = WRITE_SHADOW) out float out_distance;
#endif
#ifdef WRITE_SHADOW_SLOPE
layout(location = WRITE_SHADOW_SLOPE) out vec2 out_slope;

const float MAX_SLOPE = 6e4;  // which half precision holds

vec2 surface_slope()
{
    vec3 n = cross(dFdx(position), dFdy(position));
#ifdef PARALLEL
    float away = dot(n, frame[2]);
#else
    float away = dot(n, position) / dot(frame[2], position);
#endif
    vec2 slope = vec2(dot(n, frame[0]), dot(n, frame[1])) / (away == 0.0 ? 1.0 : away);
    return clamp(slope, -MAX_SLOPE, MAX_SLOPE);
}
#endif

void main()
{
#ifdef WRITE_SHADOW_SLOPE
    out_slope = surface_slope();  // before any discard, since it takes derivatives
#endif
#if defined(ALPHA_MASK) || defined(SEE_THROUGH)
    vec4 base = vec4(1.0, 1.0, 1.0, alpha.x);
#ifdef ALBEDO_MAP
    base *= texture(albedo_map, map_at(albedo_uv));
#endif
#ifdef VERTEX_COLOR
    base *= color;
#endif
#endif
#ifdef SEE_THROUGH
#ifdef BLENDED
    float coverage = clamp(base.a, 0.0, 1.0);
#else
    float coverage = 1.0;
#endif
    if (!(coverage > 0.0)) discard;
#endif
#if defined(ALPHA_MASK)
    if (!(base.a >= alpha.y)) discard;
#endif
#ifdef WRITE_SHADOW_TRANSMITTANCE
    vec3 share = passing * base.rgb;
#ifdef TRANSMISSION_MAP
    share *= texture(transmission_map, map_at(transmission_uv)).r;
#endif
#ifdef METALLIC
#ifdef METALLIC_ROUGHNESS_MAP
    share *= 1.0 - metallic * texture(metallic_roughness_map, map_at(metallic_roughness_uv)).b;
#else
    share *= 1.0 - metallic;
#endif
#endif
    share = pow(sanitize_albedo(share), vec3(1.0 / faces));
    out_transmittance = vec4(1.0 - coverage + coverage * sanitize_albedo(share), 1.0);
#else
#ifdef PARALLEL
    out_distance = dot(position, frame[2]);
#else
    out_distance = length(position);
#endif
#endif
}
