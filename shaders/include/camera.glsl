// The camera of the frame. Relative space: world axes, the eye as origin.
layout(std140) uniform CameraBlock {
    mat4 view_from_relative;  // rotation only
    vec4 lens;                // tangents of half the field of view, jitter in clip units
    vec4 image;               // width, height, 1/width, 1/height of the output in pixels
};

// Direction through a full-resolution pixel position, camera space, z = -1.
vec3 view_ray(vec2 pixel)
{
    vec2 ndc = pixel * image.zw * 2.0 - 1.0 - lens.zw;
    return vec3(ndc * lens.xy, -1.0);
}

vec3 relative_from_view(vec3 v)
{
    return v * mat3(view_from_relative);  // transposed
}
