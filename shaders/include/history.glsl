// What of the frame before may be kept.
const float DEPTH_TOLERANCE = 0.05;  // relative
const float SAME_NORMAL = 0.9;       // cosine
const float MAX_BRIGHTENING = 4.0;         // history counts as at most this many times what is now, or a flash would linger

// How much of itself 1 / depth changes from one pixel to the next on the plane through a pixel at a depth; normal in
// relative space.
vec2 plane_slope(vec3 normal, vec2 pixel, float depth)
{
    vec3 facing = mat3(view_from_relative) * normal;
#ifdef ORTHOGRAPHIC
    facing.xy /= depth;
#endif
    return 2.0 * image.zw * lens.xy * facing.xy / dot(facing, view_ray(pixel));
}

// Whether a texel shows the surface that is expected there, by its inverse depth and normal. Two frames, each jittered, are
// up to a pixel apart. ``slope``: see ``plane_slope``.
bool same_surface(float found, float expected, vec2 slope, vec3 normal_found, vec3 normal_expected)
{
    float tolerance = DEPTH_TOLERANCE + abs(slope.x) + abs(slope.y);
    return found > 0.0 && expected < MAX_DISTANCE && abs(found - expected) <= tolerance * expected
        && dot(normal_found, normal_expected) > SAME_NORMAL;
}

vec3 without_flash(vec3 history, vec3 now)
{
    return clamp(history, 0.0, MAX_BRIGHTENING * max(max(now.r, now.g), now.b));
}
