// Texels are shaded in quads of 2x2, which can hand each other values through fine derivatives. Not for use
// where the texels of a quad may part ways.

const float FLAT = 0.01;  // squared sine of an angle within which texels lie on a plane

// +1 on the left (bottom) half of the quad, -1 on the right (top).
vec2 quad_side()
{
    return 1.0 - 2.0 * mod(floor(gl_FragCoord.xy), 2.0);
}

// Index 0 to 3 of the texel in its quad.
float quad_lane()
{
    vec2 side = quad_side();
    return 1.5 - 0.5 * side.x - side.y;
}

float quad_swap_x(float x)
{
    return x + dFdxFine(x) * quad_side().x;
}

float quad_swap_y(float x)
{
    return x + dFdyFine(x) * quad_side().y;
}

vec3 quad_swap_x(vec3 x)
{
    return x + dFdxFine(x) * quad_side().x;
}

vec3 quad_swap_y(vec3 x)
{
    return x + dFdyFine(x) * quad_side().y;
}

vec4 quad_swap_x(vec4 x)
{
    return x + dFdxFine(x) * quad_side().x;
}

vec4 quad_swap_y(vec4 x)
{
    return x + dFdyFine(x) * quad_side().y;
}

vec3 quad_sum(vec3 x)
{
    x += quad_swap_x(x);
    return x + quad_swap_y(x);
}

float quad_sum(float x)
{
    return quad_sum(vec3(x)).x;
}

vec3 quad_max(vec3 x)
{
    x = max(x, quad_swap_x(x));
    return max(x, quad_swap_y(x));
}

// Whether it is true in all four texels.
bool quad_all(bool x)
{
    return quad_sum(x ? 1.0 : 0.0) > 3.5;
}

bool quad_any(bool x)
{
    return quad_sum(x ? 1.0 : 0.0) > 0.5;
}

// Whether the texels beside point p, and above or below it, show a plane with unit normal n; not where all show one point.
bool is_on_plane(vec3 p, vec3 n)
{
    vec3 dx = dFdxFine(p), dy = dFdyFine(p);
    float up_x = dot(n, dx), up_y = dot(n, dy);
    return up_x * up_x < FLAT * dot(dx, dx) && up_y * up_y < FLAT * dot(dy, dy);
}
