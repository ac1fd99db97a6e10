// Joint bilateral upsampling (Kopf et al. 2007): low-resolution demodulated light, guided by full-resolution
// normals and by the distance from the receiver's plane (Xin et al. 2021, section 5.3). Where no low-resolution texel
// around shows a pixel's surface, which is too thin or at an edge, the pixel keeps its light of earlier frames.
#include "numbers.glsl"
#include "camera.glsl"
#include "nearest_texel.glsl"
#include "history.glsl"

const float PLANE_SIGMA = 0.02;  // of the receiver's depth
const float MIN_WEIGHT = 1e-5;        // so that the most similar texel counts where none is on the same surface
const float SHOWN = 0.1;         // weight above which the texels around show the surface
const float SKY = 1e-30;         // so that filled-in light counts where no texel shows a surface

uniform sampler2D light_filled;
uniform sampler2D lowres_gbuffer;
uniform sampler2D normal;
uniform sampler2D depth;
uniform vec2 ratio;  // full-resolution texels per low-resolution texel
#ifdef HAS_INDIRECT_PREV
uniform sampler2D motion;         // w: inverse depth
uniform sampler2D indirect_prev;  // a: inverse depth
uniform sampler2D normal_prev;
uniform float max_frames;  // of history
uniform bool history_valid;
#endif

layout(location = 0) out vec4 out_light;

struct Receiver {
    vec3 normal;  // relative space
    vec3 slope;   // (x, y, 1) of an image position times this, times depth, is the distance along the normal
    float here;   // that distance of the receiver itself
    float inverse_sigma;
};

// Image position in [-1, 1] without jitter.
vec2 image_position(vec2 pixel)
{
    return pixel * (2.0 * image.zw) - (1.0 + lens.zw);
}

// What column and row of a low-resolution texel contribute to its distance along the normal, per unit of depth.
vec2 along_normal(ivec2 low, Receiver r)
{
    return r.slope.xy * image_position(vec2(nearest_texel(low, ratio)) + 0.5);
}

// rgb: weighted light, a: weight of one low-resolution texel.
vec4 tap(ivec2 low, float along, float closeness, Receiver r)
{
    vec4 surface = texelFetch(lowres_gbuffer, low, 0);
    float plane = ((along + r.slope.z) * surface.a - r.here) * r.inverse_sigma;
    float facing = max(dot(r.normal, surface.xyz), 0.0);
    facing *= facing;
    facing *= facing;
    float alike = (facing * facing + MIN_WEIGHT) / (1.0 + plane * plane);
    return vec4(texelFetch(light_filled, low, 0).rgb, 1.0) * (closeness * (surface.a > 0.0 ? alike : SKY));
}

#ifdef HAS_INDIRECT_PREV
// Light blended with the surface's previous light, the more the less the texels around show of it.
vec3 with_history(vec3 light, float shown, vec4 moved, Receiver r)
{
    ivec2 at = ivec2(floor(gl_FragCoord.xy - moved.xy * vec2(1.0, -1.0)));
    vec4 old = texelFetch(indirect_prev, at, 0);
    bool keep = history_valid && all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, textureSize(depth, 0)))
        && same_surface(old.a, moved.w / moved.z, plane_slope(r.normal, gl_FragCoord.xy),
                        texelFetch(normal_prev, at, 0).xyz, r.normal)
        && is_finite(dot(old.rgb, vec3(1.0)));
    return keep ? mix(light, without_flash(old.rgb, light), (1.0 - 1.0 / max_frames) * (1.0 - shown)) : light;
}
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy), last = textureSize(lowres_gbuffer, 0) - 1;
    float d = texelFetch(depth, texel, 0).r;
    vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
    vec3 slope = mat3(view_from_relative) * n * vec3(lens.xy, -1.0);
    float along = dot(slope, vec3(image_position(gl_FragCoord.xy), 1.0));
    Receiver r = Receiver(n, slope, along * d, 1.0 / (PLANE_SIGMA * d));
    vec2 at = gl_FragCoord.xy / ratio - 0.5, f = fract(at), g = 1.0 - f;
    ivec2 base = ivec2(floor(at)), a = clamp(base, ivec2(0), last), b = clamp(base + 1, ivec2(0), last);
    vec2 along_a = along_normal(a, r), along_b = along_normal(b, r);
    vec4 sum = tap(a, along_a.x + along_a.y, g.x * g.y, r)
        + tap(ivec2(b.x, a.y), along_b.x + along_a.y, f.x * g.y, r)
        + tap(ivec2(a.x, b.y), along_a.x + along_b.y, g.x * f.y, r)
        + tap(b, along_b.x + along_b.y, f.x * f.y, r);
    // NaN in the light of any tap ends as 0 here.
    vec3 light = is_surface(d) && sum.a > 0.0 ? sanitize_radiance(sum.rgb / sum.a) : vec3(0.0);
#ifdef HAS_INDIRECT_PREV
    vec4 moved = texelFetch(motion, texel, 0);
    if (is_surface(d) && sum.a < SHOWN) light = with_history(light, sum.a / SHOWN, moved, r);
    out_light = vec4(light, moved.w);
#else
    out_light = vec4(light, 1.0);
#endif
}
