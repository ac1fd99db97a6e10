// How what a texel shows has moved, and whether it was visible in the previous frame.
const float DEPTH_TOLERANCE = 0.03;  // relative

uniform sampler2D motion;  // w: inverse depth
uniform sampler2D depth_prev;
uniform float near;  // distance of the near plane in scene units
#ifdef SKY
uniform mat3 previous_from_view;  // from this frame's camera space to the previous one's
uniform vec2 previous_lens;       // tangents of half its field of view

// Motion of the sky in pixels, y up: it is infinitely far away, so only the camera's rotation moves it.
vec2 sky_motion()
{
#ifdef ORTHOGRAPHIC
    return vec2(0.0);  // it has one colour
#endif
    vec3 previous = previous_from_view * view_ray(gl_FragCoord.xy + 0.5 * lens.zw * image.xy);
    if (previous.z >= 0.0) return vec2(1e9);  // was behind the camera
    vec2 at = (previous.xy / (-previous.z * previous_lens) * 0.5 + 0.5) * image.xy;
    return gl_FragCoord.xy - at;
}
#endif

// Motion of the nearest surface in and around the quad (z: inverse depth one frame ago, w: now), so that edges move with
// what is before them.
vec4 nearest_motion(ivec2 t, ivec2 outward)
{
    vec4 best = texelFetch(motion, t, 0), other = texelFetch(motion, t + outward, 0);
    best = other.w > best.w ? other : best;
    other = quad_swap_x(best);
    best = other.w > best.w ? other : best;
    other = quad_swap_y(best);
    best = other.w > best.w ? other : best;
#ifdef SKY
    if (best.w <= 0.0) return vec4(sky_motion(), 0.0, 0.0);
#endif
    return vec4(best.xy * vec2(1.0, -1.0), best.z > 0.0 ? best.w / best.z : 0.0, best.w);
}

// Smallest and largest inverse depth one frame ago in and around the quad at texel t.
vec2 depths_before(ivec2 t, ivec2 outward)
{
    ivec2 last = ivec2(image.xy) - 1;
    float here = inverse_depth(texelFetch(depth_prev, clamp(t, ivec2(0), last), 0).r, near);
    float beside = inverse_depth(texelFetch(depth_prev, clamp(t + outward, ivec2(0), last), 0).r, near);
    float low = min(here, beside), high = max(here, beside);
    low = min(low, quad_swap_x(low));
    low = min(low, quad_swap_y(low));
    high = max(high, quad_swap_x(high));
    high = max(high, quad_swap_y(high));
    return vec2(low, high);
}

bool is_inside(ivec2 t)
{
    return all(greaterThanEqual(t, ivec2(0))) && all(lessThanEqual(t, ivec2(image.xy) - 1));
}

// Whether a surface of the given inverse depth was visible one frame ago in or around the quad at texel t: between the
// nearest and the farthest there, so that jitter across an edge counts as seen.
bool was_visible(ivec2 t, ivec2 outward, float expected)
{
    vec2 depths = depths_before(t, outward);
    return expected >= depths.x * (1.0 - DEPTH_TOLERANCE) && expected <= depths.y * (1.0 + DEPTH_TOLERANCE)
        && is_inside(t);
}
