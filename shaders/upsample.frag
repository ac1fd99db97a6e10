// Joint bilateral upsampling (Kopf et al. 2007): low-resolution indirect light, guided by full-resolution
// normals and by the distance from the receiver's plane (Xin et al. 2021, section 5.3). Where no low-resolution texel
// around shows a pixel's surface, too thin or at an edge, the pixel keeps the light that it had.
#include "numbers.glsl"
#include "camera.glsl"
#include "pick.glsl"
#include "history.glsl"

const float PLANE_SIGMA = 0.02;  // of the receiver's depth
const float FLOOR = 1e-5;        // keeps the texel most alike where none is on the same surface
const float SHOWN = 0.1;         // weight from which on the texels around show the surface
const float SKY = 1e-30;         // keeps what was filled in where no texel shows any

uniform sampler2D indirect_filled;
uniform sampler2D normal;
uniform sampler2D depth;
uniform vec2 ratio;  // full-resolution texels per low-resolution texel
#ifdef HAS_INDIRECT_PREV
uniform sampler2D motion;
uniform sampler2D indirect_prev;
uniform sampler2D normal_prev;
uniform sampler2D depth_prev;
uniform float longest;  // history in frames
uniform bool history_valid;
#endif

layout(location = 0) out vec4 out_indirect;

struct Receiver {
    vec3 normal;  // relative space
    vec3 slope;   // (x, y, 1) of an image position times this, times depth, is the distance along the normal
    float here;   // that distance of the receiver itself
    float inverse_sigma;
};

// Image position in [-1, 1] without jitter.
vec3 image_position(vec2 pixel)
{
    return vec3(pixel * (2.0 * image.zw) - (1.0 + lens.zw), 1.0);
}

// rgb: weighted light, a: weight of one low-resolution texel.
vec4 tap(ivec2 low, float closeness, Receiver r)
{
    low = clamp(low, ivec2(0), textureSize(indirect_filled, 0) - 1);
    ivec2 full = representative(low, ratio);
    float d = texelFetch(depth, full, 0).r;
    float plane = (dot(r.slope, image_position(vec2(full) + 0.5)) * d - r.here) * r.inverse_sigma;
    float facing = dot(r.normal, texelFetch(normal, full, 0).xyz);
    facing = isnan(facing) ? 0.0 : clamp(facing, 0.0, 1.0);
    facing *= facing;
    facing *= facing;
    float alike = (facing * facing + FLOOR) / (1.0 + plane * plane);
    return vec4(texelFetch(indirect_filled, low, 0).rgb, 1.0) * (closeness * (is_surface(d) ? alike : SKY));
}

#ifdef HAS_INDIRECT_PREV
// Light mixed with what the surface at a pixel had, the more the less of it is shown.
vec3 with_history(vec3 light, float shown, ivec2 texel, float d, Receiver r)
{
    vec2 slope = 2.0 * image.zw * r.slope.xy * d / r.here;
    vec3 moved = texelFetch(motion, texel, 0).xyz;
    ivec2 at = ivec2(floor(vec2(texel) + 0.5 - moved.xy * vec2(1.0, -1.0)));
    vec3 old = texelFetch(indirect_prev, at, 0).rgb;
    bool keep = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, textureSize(depth_prev, 0)))
        && same_surface(texelFetch(depth_prev, at, 0).r, d * moved.z, slope,
                        texelFetch(normal_prev, at, 0).xyz, r.normal)
        && is_finite(dot(old, vec3(1.0)));
    return keep ? mix(light, without_flash(old, light), (1.0 - 1.0 / longest) * (1.0 - shown)) : light;
}
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, texel, 0).r;
    vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
    vec3 slope = mat3(view_from_relative) * n * vec3(lens.xy, -1.0);
    Receiver r = Receiver(n, slope, dot(slope, image_position(gl_FragCoord.xy)) * d, 1.0 / (PLANE_SIGMA * d));
    vec2 at = gl_FragCoord.xy / ratio - 0.5;
    ivec2 base = ivec2(floor(at));
    vec2 f = at - vec2(base);
    vec4 sum = tap(base, (1.0 - f.x) * (1.0 - f.y), r) + tap(base + ivec2(1, 0), f.x * (1.0 - f.y), r)
        + tap(base + ivec2(0, 1), (1.0 - f.x) * f.y, r) + tap(base + ivec2(1, 1), f.x * f.y, r);
    // NaN in the light of any tap ends as 0 here.
    vec3 light = is_surface(d) && sum.a > 0.0 ? sanitize_radiance(sum.rgb / sum.a) : vec3(0.0);
#ifdef HAS_INDIRECT_PREV
    if (history_valid && is_surface(d) && sum.a < SHOWN) light = with_history(light, sum.a / SHOWN, texel, d, r);
#endif
    out_indirect = vec4(light, 1.0);
}
