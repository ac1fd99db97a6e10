// Casters as seen from a light; positions are relative to the point that distances are measured from.
#include "instance.glsl"

in vec3 in_position;
#ifdef UV
in vec2 in_uv;
out vec2 uv;
#endif
#ifdef SECOND_UV
in vec2 in_second_uv;
out vec2 second_uv;
#endif
#ifdef VERTEX_COLOR
in vec4 in_color;
out vec4 color;
#endif

uniform mat4 clip_from_relative;
out vec3 position;

void main()
{
    vec4 p = affine_matrix(in_relative_x, in_relative_y, in_relative_z) * vec4(in_position, 1.0);
    position = p.xyz;
    gl_Position = clip_from_relative * p;
#ifdef UV
    uv = in_uv;
#endif
#ifdef SECOND_UV
    second_uv = in_second_uv;
#endif
#ifdef VERTEX_COLOR
    color = in_color;
#endif
}
