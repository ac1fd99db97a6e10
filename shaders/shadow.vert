// Casters as seen from a light; positions are relative to the point that distances are measured from.
in vec3 in_position;
#ifdef ALPHA_MASK
in vec2 in_uv;
out vec2 uv;
#ifdef VERTEX_COLOR
in vec4 in_color;
out float opacity;
#endif
#endif

uniform mat4 relative_from_object;
uniform mat4 clip_from_relative;
out vec3 position;

void main()
{
    vec4 p = relative_from_object * vec4(in_position, 1.0);
    position = p.xyz;
    gl_Position = clip_from_relative * p;
#ifdef ALPHA_MASK
    uv = in_uv;
#ifdef VERTEX_COLOR
    opacity = in_color.a;
#endif
#endif
}
