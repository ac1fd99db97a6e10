// Linear distance from the light: radial, or along the direction of parallel light (PARALLEL). For hard lights also
// the slope of the surface there: how much nearer it comes along the map's x and y (see hard_shadow.glsl).
in vec3 position;
#ifdef ALPHA_MASK
in vec2 uv;
uniform vec2 alpha;  // factor, cutoff
#ifdef ALBEDO_MAP
uniform sampler2D albedo_map;
uniform mat3 albedo_uv;
#endif
#ifdef VERTEX_COLOR
in float opacity;
#endif
#endif
uniform mat3 frame;  // columns: half edges of the map at unit depth (of parallel light: their directions), and its axis

layout(location = WRITE_SHADOW) out float out_distance;
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
#ifdef ALPHA_MASK
    float a = alpha.x;
#ifdef ALBEDO_MAP
    a *= texture(albedo_map, (albedo_uv * vec3(uv, 1.0)).xy).a;
#endif
#ifdef VERTEX_COLOR
    a *= opacity;
#endif
    if (!(a >= alpha.y)) discard;
#endif
#ifdef PARALLEL
    out_distance = dot(position, frame[2]);
#else
    out_distance = length(position);
#endif
}
