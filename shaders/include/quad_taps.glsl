// The four low-resolution texels around a quad. If its texels show one plane, each of them fetches one of the four, and
// they share them.
#include "joint_bilateral.glsl"
#include "quad.glsl"

const float MAX_OVERHANG = 0.17;    // of a texel of the quad beyond the four, in low-resolution texels
const float MAX_DIFFERENCE = 0.1;   // of the quad's normals, and of its planes in PLANE_SIGMA

struct QuadTap {
    ivec2 low;       // the texel's own one of the four
    vec2 closeness;  // of the texel to the column and the row of that one
    bool is_inside;  // whether the texel lies between the four
};

QuadTap quad_tap(ivec2 size, vec2 ratio)
{
    vec2 side = quad_side(), at = gl_FragCoord.xy / ratio - 0.5, base = floor(at + 0.5 * side / ratio), f = at - base;
    vec2 inside = clamp(f, 0.0, 1.0);
    ivec2 low = clamp(ivec2(base + 0.5 - 0.5 * side), ivec2(0), size - 1);
    return QuadTap(low, mix(inside, 1.0 - inside, 0.5 + 0.5 * side), all(lessThan(abs(f - inside), vec2(MAX_OVERHANG))));
}

// Whether the texel shows the same plane as those beside it.
bool shows_plane_of_quad(BilateralReceiver r)
{
    vec4 plane = vec4(r.normal, r.here), scale = vec4(vec3(1.0), r.inverse_sigma);
    vec4 dx = dFdxFine(plane) * scale, dy = dFdyFine(plane) * scale;
    return dot(dx, dx) + dot(dy, dy) < MAX_DIFFERENCE * MAX_DIFFERENCE;
}

// Interpolates what the texels of the quad have fetched.
vec4 interpolate_taps(vec4 own, vec2 closeness)
{
    vec4 row = mix(quad_swap_x(own), own, closeness.x);
    return mix(quad_swap_y(row), row, closeness.y);
}
