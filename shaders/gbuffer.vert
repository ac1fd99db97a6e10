// Object to clip space; everything the surface shader needs, in relative space.
in vec3 in_position;
in vec3 in_normal;
#if defined(ALBEDO_MAP) || defined(EMISSION_MAP)
in vec2 in_uv;
out vec2 uv;
#endif
#ifdef VERTEX_COLOR
in vec4 in_color;
out vec4 color;
#endif

uniform mat4 relative_from_object;
uniform mat3 normal_from_object;
uniform mat4 clip_from_relative;
uniform vec2 jitter;  // clip units

out vec3 position;
out vec3 normal;

#ifdef WRITE_MOTION
uniform mat4 previous_from_object;
uniform mat4 previous_clip;  // unjittered
out vec3 clip_now;           // x, y, w; unjittered
out vec3 clip_before;
#endif

void main()
{
    vec4 p = relative_from_object * vec4(in_position, 1.0);
    position = p.xyz;
    normal = normal_from_object * in_normal;
    gl_Position = clip_from_relative * p;
#ifdef WRITE_MOTION
    clip_now = vec3(gl_Position.xy - jitter * gl_Position.w, gl_Position.w);
    clip_before = (previous_clip * (previous_from_object * vec4(in_position, 1.0))).xyw;
#endif
#if defined(ALBEDO_MAP) || defined(EMISSION_MAP)
    uv = in_uv;
#endif
#ifdef VERTEX_COLOR
    color = in_color;
#endif
}
