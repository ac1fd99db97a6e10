// Unit vectors as two numbers in [-1, 1] (Cigolle et al. 2014, "A Survey of Efficient Representations
// for Independent Unit Vectors").
const float SEAM = 5e-4;  // within half precision of the seam all codes lie on one side, or rounding would choose

vec2 octahedral_fold(vec2 e)
{
    return (1.0 - abs(e.yx)) * vec2(e.x >= -SEAM ? 1.0 : -1.0, e.y >= -SEAM ? 1.0 : -1.0);
}

vec2 octahedral_encode(vec3 n)
{
    vec2 e = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    return n.z >= 0.0 ? e : octahedral_fold(e);
}

vec3 octahedral_decode(vec2 e)
{
    vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
    if (n.z < 0.0) n.xy = octahedral_fold(e);
    return normalize(n);
}
