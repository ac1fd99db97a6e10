// What temporal upsampling needs to know of each texel of the frame: the mean and the deviation of the radiance around it,
// how it has moved, and whether it was visible one frame ago.
#include "numbers.glsl"
#include "camera.glsl"
#include "inverse_depth.glsl"
#include "quad.glsl"
#include "ycocg.glsl"
#include "neighbourhood.glsl"
#include "reprojection.glsl"
#include "still.glsl"

const float SETTLED_FRAMES = 16.0;  // that mean and deviation span: one frame alone may miss what is thinner than a texel

uniform sampler2D guide_mean_prev;
uniform sampler2D guide_deviation_prev;
uniform bool history_valid;

layout(location = WRITE_GUIDE_MEAN) out vec4 out_mean;            // rgb: in YCoCg, a: frames
layout(location = WRITE_GUIDE_DEVIATION) out vec4 out_deviation;  // rgb: in YCoCg
layout(location = WRITE_GUIDE_MOTION) out vec4 out_motion;        // xy: pixels of the frame, y up; z: 1 if it was visible

// Whether a surface of the given inverse depth was visible, as ``was_visible``; but what is nearer than all that was seen
// was missed between texels, not hidden.
bool was_uncovered(ivec2 t, ivec2 outward, float expected)
{
    return expected >= depths_before(t, outward).x * (1.0 - DEPTH_TOLERANCE) && is_inside(t);
}

void main()
{
    ivec2 last = ivec2(image.xy) - 1, t = min(ivec2(gl_FragCoord.xy), last);
    ivec2 outward = clamp(t - ivec2(quad_side()), ivec2(0), last) - t;
    vec4 moved = nearest_motion(t, outward);
    vec3 mean, variance;
    neighbourhood(t, outward, ycocg(current(t)), mean, variance);

    bool finite = is_finite(moved.x + moved.y);
    vec2 back = finite ? -moved.xy : vec2(1e9);
    ivec2 before = t + ivec2(floor(back + 0.5));
#ifdef SETTLED
    bool unmoved = is_still(moved.xy) && abs(moved.z - moved.w) <= DEPTH_TOLERANCE * moved.w;
#else
    const bool unmoved = false;
#endif
    bool visible = unmoved || was_uncovered(before, outward, moved.z);

    vec4 mean_before = texelFetch(guide_mean_prev, t, 0);
    vec3 deviation_before = texelFetch(guide_deviation_prev, t, 0).rgb;
    bool healthy = is_finite(dot(mean_before, vec4(1.0)) + dot(deviation_before, vec3(1.0))) && mean_before.a >= 1.0;
    float frames = unmoved && healthy && history_valid ? min(mean_before.a + 1.0, SETTLED_FRAMES) : 1.0;
    if (frames > 1.0) {
        float part = 1.0 / frames;
        vec3 change = mean - mean_before.rgb;
        variance = mix(deviation_before * deviation_before, variance + (1.0 - part) * change * change, part);
        mean = mix(mean_before.rgb, mean, part);
    }
    out_mean = vec4(mean, frames);
    out_deviation = vec4(sqrt(variance), 0.0);
    out_motion = vec4(moved.xy, visible && finite ? 1.0 : 0.0, 0.0);
}
