// The two grids that surfaces are seen on: the screen, and the six views around the camera (GRID_CUBE).
#include "camera.glsl"
#include "cube.glsl"

#ifdef GRID_CUBE
// Distance is along the ray, so the ray has unit length.
vec3 surface_ray(vec2 pixel)
{
    float n = float(CUBE_SIZE);
    int face = int(pixel.x / n);
    vec2 uv = vec2(pixel.x - float(face) * n, pixel.y) / n * 2.0 - 1.0;
    CubeFace f = cube_face(face);
    vec3 ray = normalize(f.forward + uv.x * f.right + uv.y * f.up);
#ifdef CUBE_CAMERA_AXES
    ray = relative_from_view(ray);
#endif
    return ray;
}

vec3 surface_point(vec2 pixel, float depth)
{
    return surface_ray(pixel) * depth;
}
#else
// Depth is along -z of the camera, so the ray has z = -1 there.
vec3 surface_ray(vec2 pixel)
{
    return relative_from_view(view_ray(pixel));
}

vec3 surface_point(vec2 pixel, float depth)
{
#ifdef ORTHOGRAPHIC
    return relative_from_view(view_point(pixel, depth));
#else
    return surface_ray(pixel) * depth;
#endif
}
#endif

// Of a pixel or of a texel of the cube, in scene units.
float pixel_width(float depth)
{
#ifdef GRID_CUBE
    return 2.0 / float(CUBE_SIZE) * depth;
#elif defined(ORTHOGRAPHIC)
    return 2.0 * lens.y * image.w;
#else
    return 2.0 * lens.y * image.w * depth;
#endif
}
