// YCoCg (Malvar and Sullivan 2003), and clipping to a box in it.
vec3 ycocg(vec3 c)
{
    return vec3(dot(c, vec3(0.25, 0.5, 0.25)), 0.5 * (c.r - c.b), dot(c, vec3(-0.25, 0.5, -0.25)));
}

vec3 rgb(vec3 c)
{
    float t = c.x - c.z;
    return vec3(t + c.y, c.x + c.z, t - c.y);
}

// Largest share of the way from the middle to c that stays in the box.
float clip_share(vec3 offset, vec3 half_size)
{
    vec3 ratio = abs(offset) / max(half_size, 1e-8);
    return 1.0 / max(1.0, max(ratio.x, max(ratio.y, ratio.z)));
}
