// Constants, and the border control that keeps numbers numbers.
const float PI = 3.14159265359;
const float HALF_MAX = 65504.0;
const float MAX_DISTANCE = 1e18;  // distances from here on count as no surface

bool is_finite(float x)
{
    return !(isnan(x) || isinf(x));
}

float luminance(vec3 c)
{
    return dot(c, vec3(0.2126, 0.7152, 0.0722));
}

// Finite, non-negative, representable in half precision; NaN becomes 0. clamp() alone need not see NaN.
vec3 sanitize_radiance(vec3 c)
{
    return mix(clamp(c, 0.0, HALF_MAX), vec3(0.0), isnan(c));
}

// Number of a material, as half precision holds it; one in 2048 shares it.
float material_code(float number)
{
    return mod(number, 2048.0);
}

vec3 sanitize_albedo(vec3 c)
{
    return mix(clamp(c, 0.0, 1.0), vec3(0.0), isnan(c));
}

// Unit length, or 0 for what has no direction.
vec3 sanitize_normal(vec3 n)
{
    float square = dot(n, n);
    return square > 0.25 && square < 4.0 ? n * inversesqrt(square) : vec3(0.0);
}

// Depth 0 is sky; NaN, infinities and negative depths count as sky too.
bool is_surface(float depth)
{
    return depth > 0.0 && depth < MAX_DISTANCE;
}
