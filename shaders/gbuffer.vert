// Object to clip space; everything the surface shader needs, in relative space.
#include "instance.glsl"

in vec3 in_position;
in vec3 in_normal;
#ifdef UV
in vec2 in_uv;
out vec2 uv;
#endif
#ifdef SECOND_UV
in vec2 in_second_uv;
out vec2 second_uv;
#endif
#ifdef TANGENT
in vec4 in_tangent;
out vec4 tangent;
#endif
#ifdef VERTEX_COLOR
in vec4 in_color;
out vec4 color;
#endif

// Rows of the matrix for normals; a: numbers of the instance and the material, and the instance's scale, which is
// negative if it is mirrored.
in vec4 in_normal_x, in_normal_y, in_normal_z;
uniform mat4 clip_from_relative;
uniform vec2 jitter;  // clip units

out vec3 position;
out vec3 normal;
flat out float scale;
#if defined(LABELS) || defined(SEE_THROUGH)
flat out vec2 labels;
#endif

#ifdef WRITE_MOTION
#ifdef DEFORMED
in vec3 in_previous_position;
#else
#define in_previous_position in_position
#endif
in vec4 in_previous_x, in_previous_y, in_previous_z;
uniform mat4 previous_clip;  // unjittered
out vec3 clip_now;           // x, y, depth; unjittered
out vec3 clip_before;
#ifdef ORTHOGRAPHIC
uniform vec2 far;            // now and one frame ago: z = 1 - depth / far
#endif
#endif

void main()
{
    mat4 relative_from_object = affine_matrix(in_relative_x, in_relative_y, in_relative_z);
    mat3 normal_from_object = transpose(mat3(in_normal_x.xyz, in_normal_y.xyz, in_normal_z.xyz));
    scale = in_normal_z.w;
#if defined(LABELS) || defined(SEE_THROUGH)
    labels = vec2(in_normal_x.w, in_normal_y.w);
#endif
    vec4 p = relative_from_object * vec4(in_position, 1.0);
    position = p.xyz;
    normal = normal_from_object * in_normal;
    normal *= inversesqrt(max(dot(normal, normal), 1e-30));  // interpolated at unit length; zero stays zero
#ifdef TANGENT
    tangent = vec4(mat3(relative_from_object) * in_tangent.xyz, in_tangent.w);
    tangent.xyz /= max(length(tangent.xyz), 1e-30);
#endif
    gl_Position = clip_from_relative * p;
#ifdef WRITE_MOTION
    mat4 previous_from_object = affine_matrix(in_previous_x, in_previous_y, in_previous_z);
    clip_now = vec3(gl_Position.xy - jitter * gl_Position.w, gl_Position.w);
#ifdef ORTHOGRAPHIC
    clip_now.z = (1.0 - gl_Position.z) * far.x;
    clip_before = (previous_clip * (previous_from_object * vec4(in_previous_position, 1.0))).xyz;
    clip_before.z = (1.0 - clip_before.z) * far.y;
#else
    clip_before = (previous_clip * (previous_from_object * vec4(in_previous_position, 1.0))).xyw;
#endif
#endif
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
