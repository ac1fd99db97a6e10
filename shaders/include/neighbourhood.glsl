// The radiance around a texel.
uniform sampler2D lit;

vec3 current(ivec2 t)
{
    return sanitize_radiance(texelFetch(lit, t, 0).rgb);
}

// Mean and variance of the 3x3 neighbourhood in YCoCg. Each texel of a quad fetches its own corner of the quad's 4x4
// surroundings, and they hand each other what is theirs, relative to the quad's mean: squares of bright light cancel.
void neighbourhood(ivec2 t, ivec2 outward, vec3 own, out vec3 mean, out vec3 variance)
{
    vec3 origin = 0.25 * quad_sum(own);
    own -= origin;
    vec3 beside = ycocg(current(t + ivec2(outward.x, 0))) - origin;
    vec3 above = ycocg(current(t + ivec2(0, outward.y))) - origin;
    vec3 corner = ycocg(current(t + outward)) - origin;
    vec3 inner = quad_swap_x(own), inner_above = quad_swap_x(above);
    vec3 row = own + beside + inner, row2 = own * own + beside * beside + inner * inner;
    mean = row + above + corner + inner_above + quad_swap_y(row);
    vec3 square = row2 + above * above + corner * corner + inner_above * inner_above + quad_swap_y(row2);
    mean /= 9.0;
    variance = max(square / 9.0 - mean * mean, 0.0);
    mean += origin;
}
