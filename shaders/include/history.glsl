// What of the frame before may be kept.
const float DEPTH_TOLERANCE = 0.05;  // relative
const float SAME_NORMAL = 0.9;       // cosine
const float BRIGHTEST = 4.0;         // history counts as at most this many times what is now, or a flash would linger

// Whether a texel shows the surface that is expected there, by its depth and normal. ``slope``: how much of itself
// 1 / depth changes from one pixel to the next; two frames, each jittered, are up to a pixel apart.
bool same_surface(float depth_found, float depth_expected, vec2 slope, vec3 normal_found, vec3 normal_expected)
{
    float tolerance = DEPTH_TOLERANCE + abs(slope.x) + abs(slope.y);
    return is_surface(depth_found) && abs(depth_found - depth_expected) <= tolerance * depth_expected
        && dot(normal_found, normal_expected) > SAME_NORMAL;
}

vec3 without_flash(vec3 history, vec3 now)
{
    return clamp(history, 0.0, BRIGHTEST * max(max(now.r, now.g), now.b));
}
