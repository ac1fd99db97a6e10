// What surfaces reflect of indirect light: the light along reflected rays, upsampled as in upsample.frag, or for rough surfaces
// the diffuse light that arrives, times the lobe's albedo (the split sum of Karis 2013, "Real Shading in Unreal Engine 4").
#include "numbers.glsl"
#include "grid.glsl"
#include "joint_bilateral.glsl"
#include "reflection.glsl"
#include "specular_albedo.glsl"

uniform sampler2D normal;
uniform sampler2D specular_roughness;
#ifdef HAS_REFLECTION_FILTERED
uniform sampler2D depth;
uniform sampler2D reflection_filtered;  // radiance; a: depth of its surface, 0 where no light is known
uniform vec2 ratio;  // full-resolution texels per low-resolution texel
#ifdef AT_REST
const float SAME_NORMAL = 0.9;        // cosine
const float MIN_LOBE = 5e-3;          // radians
const float ENOUGH = 16.0;            // samples that averaged light counts as where no others are needed
const float ROUGHNESS_OF_ONE = 0.05;  // at which one sample of a pixel's own counts as much as all light that is averaged

uniform sampler2D reflection_detail;  // radiance; a: number of samples
#endif

// Weighted by the distance from the receiver's plane, which parts surfaces that meet at an edge too.
vec4 tap(ivec2 low, float along, float closeness, BilateralReceiver r)
{
    vec4 light = texelFetch(reflection_filtered, low, 0);
#ifdef ORTHOGRAPHIC
    float plane = (along + r.slope.z * light.a - r.here) * r.inverse_sigma;
#else
    float plane = ((along + r.slope.z) * light.a - r.here) * r.inverse_sigma;
#endif
    bool counts = light.a > 0.0 && is_finite(dot(light, vec4(1.0)));
    return counts ? vec4(clamp(light.rgb, 0.0, HALF_MAX), 1.0) * ((closeness + MIN_WEIGHT) / (1.0 + plane * plane)) : vec4(0.0);
}

// Radiance from ``count`` of the four texels around; the others are not needed where nothing is traced. a: how far these show
// the same surface.
vec4 upsampled(vec3 n, float d, int count, vec3 otherwise)
{
    BilateralReceiver r = bilateral_receiver(gl_FragCoord.xy, n, d);
    Around t = texels_around(gl_FragCoord.xy, textureSize(reflection_filtered, 0), ratio, r);
    vec4 sum = vec4(0.0);
    int i = 0;
    do {
        bvec2 second = bvec2(i % 2 == 1, i > 1);
        vec2 along = mix(t.along_low, t.along_high, second), close = mix(1.0 - t.f, t.f, second);
        sum += tap(ivec2(second.x ? t.high.x : t.low.x, second.y ? t.high.y : t.low.y), along.x + along.y, close.x * close.y, r);
    } while (++i < count);
    return sum.a > 0.0 ? vec4(sum.rgb / sum.a, min(sum.a, 1.0)) : vec4(otherwise, 0.0);
}

#ifdef AT_REST
vec3 normal_at(ivec2 texel)
{
    return sanitize_normal(texelFetch(normal, clamp(texel, ivec2(0), textureSize(normal, 0) - 1), 0).xyz);
}

// How much the normal changes within a low-resolution texel, in radians.
float bend(ivec2 texel, vec3 n)
{
    ivec2 reach = ivec2(0.5 * ratio + 0.5);
    return max(max(distance(n, normal_at(texel - ivec2(reach.x, 0))), distance(n, normal_at(texel + ivec2(reach.x, 0)))),
               max(distance(n, normal_at(texel - ivec2(0, reach.y))), distance(n, normal_at(texel + ivec2(0, reach.y)))));
}

// With the light of rays from the pixel and those around, which counts the more, the smoother the surface is, and the more it
// bends.
vec3 detailed(ivec2 texel, vec3 n, float roughness, vec4 averaged)
{
    float blur = roughness / ROUGHNESS_OF_ONE, bends = 0.5 * bend(texel, n) / max(roughness * roughness, MIN_LOBE);
    float flatness = 1.0 / (1.0 + bends * bends), known = averaged.a * blur * blur * flatness * flatness;
    vec4 sum = vec4(averaged.rgb, 1.0) * max(known, 1e-6);
    // A loop that need not begin takes no time, unlike a branch, which some drivers run for all.
    int i = ray_share(roughness) > 0.0 && known < ENOUGH ? 0 : 9;
    for (; i < 9; ++i) {
        ivec2 offset = ivec2(i % 3, i / 3) - 1, at = clamp(texel + offset, ivec2(0), textureSize(reflection_detail, 0) - 1);
        vec4 detail = texelFetch(reflection_detail, at, 0);
        float falloff = exp(-float(offset.x * offset.x + offset.y * offset.y) / max(blur * blur, 1e-3));
        bool counts = detail.a >= 1.0 && is_finite(dot(detail, vec4(1.0)))
            && dot(n, normal_at(at)) > SAME_NORMAL;
        sum += counts ? vec4(clamp(detail.rgb, 0.0, HALF_MAX), 1.0) * (detail.a * falloff) : vec4(0.0);
    }
    return sum.rgb / sum.a;
}
#endif
#endif

// Radiance; arriving: the diffuse light that arrives at the texel, irradiance / pi.
vec3 reflected_light(ivec2 texel, vec3 arriving)
{
    vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
    vec4 reflectance = texelFetch(specular_roughness, texel, 0);  // 0 where nothing is seen
    vec3 light = arriving;
#ifdef HAS_REFLECTION_FILTERED
    float share = ray_share(reflectance.a);
    float d = texelFetch(depth, texel, 0).r;
    vec4 averaged = upsampled(n, d, share > 0.0 ? 4 : 1, light);
#ifdef AT_REST
    averaged.rgb = detailed(texel, n, reflectance.a, averaged);
#endif
    light = mix(light, averaged.rgb, share);
#endif
    float n_v = dot(n, -normalize(along_view(surface_ray(gl_FragCoord.xy))));
    return sanitize_radiance(specular_albedo(sanitize_albedo(reflectance.rgb), reflectance.a, n_v) * light);
}
