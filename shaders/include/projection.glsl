// Where the camera shows points of camera space.
#include "camera.glsl"

// Pixel position without jitter, and 1 / depth, which is linear on the image; the depth if ORTHOGRAPHIC.
vec3 project(vec3 view, vec2 half_size, vec2 image_center)
{
#ifdef ORTHOGRAPHIC
    return vec3((view.xy / half_size + image_center + 1.0) * 0.5 * image.xy, -view.z);
#else
    return vec3((view.xy / (-view.z * half_size) + image_center + 1.0) * 0.5 * image.xy, -1.0 / view.z);
#endif
}

// The camera-space point that a pixel position shows at a depth, without jitter.
vec3 unproject(vec2 pixel, float depth, vec2 half_size, vec2 image_center)
{
    vec2 plane = (pixel * image.zw * 2.0 - 1.0 - image_center) * half_size;
#ifdef ORTHOGRAPHIC
    return vec3(plane, -depth);
#else
    return vec3(plane, -1.0) * depth;
#endif
}
