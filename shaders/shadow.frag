// Linear distance from the light: radial, or along the direction of parallel light (PARALLEL).
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
#ifdef PARALLEL
uniform vec3 axis;
#endif

layout(location = 0) out float out_distance;

void main()
{
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
    out_distance = dot(position, axis);
#else
    out_distance = length(position);
#endif
}
