// Joint bilateral upsampling (Kopf et al. 2007): low-resolution indirect light, guided by full-resolution
// normals and by the distance from the receiver's plane (Xin et al. 2021, section 5.3).
#include "numbers.glsl"
#include "camera.glsl"
#include "pick.glsl"

const float PLANE_SIGMA = 0.02;  // of the receiver's depth
const float ENOUGH = 0.05;       // weight below which a wider ring is searched
const int RING = 4;              // low-resolution texels along the edge of the wider ring
const float FLOOR = 1e-6;

uniform sampler2D indirect_low;
uniform sampler2D normal;
uniform sampler2D depth;
uniform vec2 ratio;  // full-resolution texels per low-resolution texel

layout(location = 0) out vec4 out_indirect;

struct Receiver {
    vec3 normal;  // camera-relative, world axes
    vec3 point;
    float inverse_sigma;
};

// rgb: weighted light, a: weight of one low-resolution texel.
vec4 tap(ivec2 low, float closeness, Receiver r)
{
    low = clamp(low, ivec2(0), textureSize(indirect_low, 0) - 1);
    ivec2 full = representative(low, ratio);
    float d = texelFetch(depth, full, 0).r;
    if (!is_surface(d)) return vec4(0.0);
    vec3 n = texelFetch(normal, full, 0).xyz;
    vec3 p = view_ray(vec2(full) + 0.5) * d;
    float plane = dot(r.normal, p - r.point) * r.inverse_sigma;
    float facing = max(dot(relative_from_view(r.normal), n), 0.0);
    facing *= facing;
    facing *= facing;
    float weight = (closeness * facing * facing / (1.0 + plane * plane * plane * plane)) + FLOOR * closeness / (1.0 + abs(plane));
    if (!(weight > 0.0 && is_finite(weight))) return vec4(0.0);
    return vec4(sanitize_radiance(texelFetch(indirect_low, low, 0).rgb), 1.0) * weight;
}

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, texel, 0).r;
    out_indirect = vec4(0.0, 0.0, 0.0, 1.0);
    if (!is_surface(d)) return;

    vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
    Receiver r = Receiver(mat3(view_from_relative) * n, view_ray(gl_FragCoord.xy) * d, 1.0 / (PLANE_SIGMA * d));
    vec2 at = gl_FragCoord.xy / ratio - 0.5;
    ivec2 base = ivec2(floor(at));
    vec2 f = at - vec2(base);
    vec4 sum = tap(base, (1.0 - f.x) * (1.0 - f.y), r) + tap(base + ivec2(1, 0), f.x * (1.0 - f.y), r)
        + tap(base + ivec2(0, 1), (1.0 - f.x) * f.y, r) + tap(base + ivec2(1, 1), f.x * f.y, r);
    int wider = sum.a < ENOUGH ? RING * RING : 0;  // a loop, because software rasterisers never skip an if
    for (int k = 0; k < wider; ++k) {
        ivec2 offset = ivec2(k % RING, k / RING) - 1;
        vec2 away = vec2(offset) - f;
        sum += tap(base + offset, 0.1 * exp(-0.5 * dot(away, away)), r);
    }
    if (sum.a > 0.0) out_indirect.rgb = sanitize_radiance(sum.rgb / sum.a);
}
