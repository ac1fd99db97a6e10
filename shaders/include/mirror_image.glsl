// Where the frame before showed what a smooth surface reflects: the point as far behind a mirror as what it shows is before it,
// closer for rough surfaces (Zimmer et al. 2015, "Path-space Motion Estimation and Decomposition for Robust Animation Filtering";
// the factor is that of Lagarde and de Rousiers 2014, "Moving Frostbite to PBR", section 4.9.3).
#include "projection.glsl"

uniform mat4 previous_from_relative;  // camera space of the frame before, from this frame's relative space
uniform vec4 previous_lens;           // half the image's size; where the view axis met it

struct MirrorImage {
    vec3 surface;  // where the surface was, camera space of the frame before
    vec2 moved;    // pixels that its image has moved by since
};

vec3 previous_point(vec2 pixel, float depth)
{
    return unproject(pixel, depth, previous_lens.xy, previous_lens.zw);
}

// Of a surface at p, relative space, of that depth, that has moved as the G-buffer's ``motion`` says, and shows what is ``reach``
// times its depth away.
MirrorImage mirror_image(vec3 p, float depth, vec3 motion, float reach, float roughness)
{
    float smoothness = 1.0 - clamp(roughness, 0.0, 1.0);
    vec3 behind = normalize(along_view(p)) * (min(reach, HALF_MAX) * depth * smoothness * (sqrt(smoothness) + roughness));
    vec3 view = mat3(view_from_relative) * p;
    vec2 pixel = project(view, lens.xy, center.xy).xy - motion.xy * vec2(1.0, -1.0);
    vec3 before = previous_point(pixel, depth * motion.z), image_before = before + mat3(previous_from_relative) * behind;
    vec2 image_now = project(view + mat3(view_from_relative) * behind, lens.xy, center.xy).xy;
    return MirrorImage(before, image_now - project(image_before, previous_lens.xy, previous_lens.zw).xy);
}
