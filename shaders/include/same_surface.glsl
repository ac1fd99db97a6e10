// Whether a texel of the frame before shows the surface that is expected there, by its depth and normal.
const float DEPTH_TOLERANCE = 0.05;  // relative
const float SAME_NORMAL = 0.9;       // cosine

bool same_surface(float depth_found, float depth_expected, vec3 normal_found, vec3 normal_expected)
{
    return is_surface(depth_found) && abs(depth_found - depth_expected) <= DEPTH_TOLERANCE * depth_expected
        && dot(normal_found, normal_expected) > SAME_NORMAL;
}
