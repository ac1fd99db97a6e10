// Integrals over the solid angle of a rectangle, as far as it is above the receiver's horizon: Lambert's
// polygon formula.
#include "numbers.glsl"

const float MIN_SQUARE = 1e-30;    // of a length, so that points without one give no NaN
const float MIN_SINE_SQUARE = 1e-12;  // of the angle between opposite directions, whose plane rounding decides

// Where the four edges, in the order of rect_form, enter and leave the half space above the horizon.
struct Clip {
    vec4 begin, end;      // of the part above, along the edge; equal where there is none
    vec4 leaves, enters;  // 1 where the edge crosses the horizon downwards, upwards
};

Clip clip_rect(vec3 center, vec3 u, vec3 v, vec3 n)
{
    float height = dot(center, n), rise_u = dot(u, n), rise_v = dot(v, n);
    vec4 from = height + vec4(-rise_u - rise_v, rise_u - rise_v, rise_u + rise_v, rise_v - rise_u);
    vec4 fall = from - from.yzwx;
    vec4 crossing = clamp(from / mix(fall, vec4(1.0), equal(fall, vec4(0.0))), 0.0, 1.0);
    bvec4 from_above = greaterThan(from, vec4(0.0)), to_above = from_above.yzwx;
    return Clip(mix(crossing, vec4(0.0), from_above), mix(crossing, vec4(1.0), to_above),
                vec4(from_above) * vec4(not(to_above)), vec4(not(from_above)) * vec4(to_above));
}

// Angle between the directions of a and a + along, times the unit normal of their plane. Angle / sine is a rational
// function of the cosine as in Hill and Heitz 2016, "Real-Time Area Lighting: a Journey from Research to Production",
// fitted to 6e-7; the cross product with the edge itself keeps the precision of small rectangles.
vec3 edge_form(vec3 a, vec3 along)
{
    vec3 b = a + along;
    float over_a = inversesqrt(max(dot(a, a), MIN_SQUARE)), over_b = inversesqrt(max(dot(b, b), MIN_SQUARE));
    vec3 c = cross(a * over_a, along * over_b);
    float cosine = dot(a * over_a, b * over_b), x = min(abs(cosine), 1.0);
    float ratio = (1.57079545 + (0.90581268 + 0.02603212 * x) * x) / (1.0 + (1.21323835 + 0.28940051 * x) * x);
    return c * (cosine > 0.0 ? ratio : PI * inversesqrt(max(dot(c, c), MIN_SINE_SQUARE)) - ratio);
}

// Integral of the direction l over the clipped rectangle's solid angle; towards the receiver where it faces the side of
// u x v. Any linear map of center, u and v keeps the clipping.
vec3 rect_form(vec3 center, vec3 u, vec3 v, Clip clip)
{
    vec3 corners[4] = vec3[4](center - u - v, center + u - v, center + u + v, center - u + v);
    vec3 edges[4] = vec3[4](2.0 * u, 2.0 * v, -2.0 * u, -2.0 * v);
    vec3 sum = vec3(0.0), leaving = vec3(0.0), entering = vec3(0.0);
    for (int i = 0; i < 4; ++i) {
        vec3 begin = corners[i] + clip.begin[i] * edges[i];
        sum += edge_form(begin, (clip.end[i] - clip.begin[i]) * edges[i]);
        leaving += clip.leaves[i] * (corners[i] + clip.end[i] * edges[i]);
        entering += clip.enters[i] * begin;
    }
    // The gap that clipping opens is closed along the horizon.
    return 0.5 * (sum + edge_form(leaving, entering - leaving));
}
