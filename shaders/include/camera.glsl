// The camera of the frame. Relative space: world axes, the eye as origin.
layout(std140) uniform CameraBlock {
    mat4 view_from_relative;  // rotation only
    vec4 lens;                // half the image's size: at distance 1, in scene units if ORTHOGRAPHIC; jitter + center
    vec4 image;               // width, height, 1/width, 1/height of the frame in pixels, before it is upscaled
    vec4 center;              // xy: where the view axis meets the image, in clip units
};

// What a full-resolution pixel position shows, in camera space: its direction, with z = -1, and its point at a depth.
#ifdef ORTHOGRAPHIC
vec3 view_ray(vec2 pixel)
{
    return vec3(0.0, 0.0, -1.0);
}

vec3 view_point(vec2 pixel, float depth)
{
    return vec3((pixel * image.zw * 2.0 - 1.0 - lens.zw) * lens.xy, -depth);
}
#else
vec3 view_ray(vec2 pixel)
{
    vec2 ndc = pixel * image.zw * 2.0 - 1.0 - lens.zw;
    return vec3(ndc * lens.xy, -1.0);
}

vec3 view_point(vec2 pixel, float depth)
{
    return view_ray(pixel) * depth;
}
#endif

vec3 relative_from_view(vec3 v)
{
    return v * mat3(view_from_relative);  // transposed
}

// The direction in which the viewer sees a point of relative space, of any length.
vec3 along_view(vec3 p)
{
#if defined(ORTHOGRAPHIC) && !defined(GRID_CUBE)
    return relative_from_view(vec3(0.0, 0.0, -1.0));
#else
    return p;
#endif
}

// What tolerances of lengths are relative to: the depth, or where that says nothing of what a pixel shows, as much as the
// depth from which a field of view of 53 degrees shows the same.
float depth_scale(float depth)
{
#if defined(ORTHOGRAPHIC) && !defined(GRID_CUBE)
    return 2.0 * lens.y;
#else
    return depth;
#endif
}
