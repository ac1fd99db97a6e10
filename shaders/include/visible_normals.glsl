// Directions of reflected rays by the visible normals of GGX (Heitz 2018, "Sampling the GGX Distribution of Visible Normals",
// section 3).
#include "ggx_lobe.glsl"

const float TRIM = 0.98;  // of the lobe, whose far tail would be speckles

// A normal in the frame of the surface that v sees, with probability in proportion to what it sees.
vec3 visible_normal(vec3 v, float alpha, vec2 u)
{
    vec3 stretched = normalize(vec3(alpha * v.xy, v.z));
    float sine = dot(stretched.xy, stretched.xy);
    vec3 first = sine > 1e-12 ? vec3(-stretched.y, stretched.x, 0.0) * inversesqrt(sine) : vec3(1.0, 0.0, 0.0);
    vec3 second = cross(stretched, first);
    float radius = sqrt(TRIM * u.x), angle = 2.0 * PI * u.y, upper = 0.5 * (1.0 + stretched.z);
    float a = radius * cos(angle), b = mix(sqrt(1.0 - a * a), radius * sin(angle), upper);
    vec3 h = a * first + b * second + sqrt(max(1.0 - a * a - b * b, 0.0)) * stretched;
    return normalize(vec3(alpha * h.xy, max(h.z, 1e-6)));
}

// Direction of a reflected ray, above the face.
vec3 reflected(vec3 v, vec3 n, vec3 face, float alpha, vec2 u)
{
    vec3 side = normalize(abs(n.z) < 0.9 ? vec3(-n.y, n.x, 0.0) : vec3(0.0, -n.z, n.y)), up = cross(n, side);
    vec3 h = visible_normal(vec3(dot(v, side), dot(v, up), max(dot(v, n), 1e-3)), alpha, u);
    vec3 l = reflect(-v, h.x * side + h.y * up + h.z * n);
    float height = dot(l, face);
    return normalize(height < 0.0 ? l - 2.0 * height * face : l);
}
