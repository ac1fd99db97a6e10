// Joint bilateral upsampling (Kopf et al. 2007): low-resolution indirect light, guided by full-resolution
// normals and by the distance from the receiver's plane (Xin et al. 2021, section 5.3).
#include "numbers.glsl"
#include "camera.glsl"
#include "pick.glsl"

const float PLANE_SIGMA = 0.02;  // of the receiver's depth
const float FLOOR = 1e-5;        // keeps the texel most alike where none is on the same surface

uniform sampler2D indirect_low;
uniform sampler2D normal;
uniform sampler2D depth;
uniform vec2 ratio;  // full-resolution texels per low-resolution texel

layout(location = 0) out vec4 out_indirect;

struct Receiver {
    vec3 normal;          // relative space
    vec3 view_normal;     // camera space, as point is
    vec3 point;
    float inverse_sigma;  // of the distance from the plane
};

// rgb: weighted light, a: weight of one low-resolution texel.
vec4 tap(ivec2 low, float closeness, Receiver r)
{
    low = clamp(low, ivec2(0), textureSize(indirect_low, 0) - 1);
    ivec2 full = representative(low, ratio);
    float d = texelFetch(depth, full, 0).r;
    vec3 p = view_ray(vec2(full) + 0.5) * d;
    float plane = dot(r.view_normal, p - r.point) * r.inverse_sigma;
    float facing = max(dot(r.normal, texelFetch(normal, full, 0).xyz), 0.0);
    float facing4 = facing * facing * facing * facing;
    plane *= plane;
    float alike = facing4 * facing4 / (1.0 + plane * plane) + FLOOR * (0.1 + facing) / (1.0 + plane);
    float weight = is_surface(d) && is_finite(alike) ? closeness * alike : 0.0;
    return vec4(sanitize_radiance(texelFetch(indirect_low, low, 0).rgb), 1.0) * weight;
}

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, texel, 0).r;
    vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
    Receiver r = Receiver(n, mat3(view_from_relative) * n, view_ray(gl_FragCoord.xy) * d, 1.0 / (PLANE_SIGMA * d));
    vec2 at = gl_FragCoord.xy / ratio - 0.5;
    ivec2 base = ivec2(floor(at));
    vec2 f = at - vec2(base);
    vec4 sum = tap(base, (1.0 - f.x) * (1.0 - f.y), r) + tap(base + ivec2(1, 0), f.x * (1.0 - f.y), r)
        + tap(base + ivec2(0, 1), (1.0 - f.x) * f.y, r) + tap(base + ivec2(1, 1), f.x * f.y, r);
    out_indirect = vec4(is_surface(d) && sum.a > 0.0 ? sanitize_radiance(sum.rgb / sum.a) : vec3(0.0), 1.0);
}
