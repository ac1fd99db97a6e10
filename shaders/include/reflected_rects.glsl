// Rectangles whose shadows are traced, as reflected rays meet them.
#include "lights.glsl"

const float NEAR_END = 0.01;  // of a ray's length, within which the surface that it meets may be the rectangle's own

// Radiance of the nearest rectangle that a ray from point p along unit vector l meets before its end at length t.
vec3 rects_along(vec3 p, vec3 l, float t)
{
    vec3 found = vec3(0.0);
    float nearest = t * (1.0 + NEAR_END);
    for (int i = RECTS_BEGIN; i < LIGHT_COUNT; ++i) {
        vec3 to = lights[i].position.xyz - p;
        float toward = dot(l, lights[i].frame_z.xyz);
        float s = dot(to, lights[i].frame_z.xyz) / (toward == 0.0 ? 1e-30 : toward);
        vec3 off = s * l - to;
        bool meets = rect_side(lights[i], to) != 0.0 && s > 0.0 && s < nearest
            && abs(dot(off, lights[i].frame_x.xyz)) < lights[i].frame_x.w && abs(dot(off, lights[i].frame_y.xyz)) < lights[i].frame_y.w;
        found = meets ? lights[i].color.rgb : found;
        nearest = meets ? s : nearest;
    }
    return found;
}
