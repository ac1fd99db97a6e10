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

// From ``count`` of the four texels around; the others are not needed where nothing is traced.
vec3 upsampled(vec3 n, float d, int count, vec3 otherwise)
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
    return sum.a > 0.0 ? sum.rgb / sum.a : otherwise;
}
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
    light = mix(light, upsampled(n, d, share > 0.0 ? 4 : 1, light), share);
#endif
    float n_v = dot(n, -normalize(along_view(surface_ray(gl_FragCoord.xy))));
    return sanitize_radiance(specular_albedo(sanitize_albedo(reflectance.rgb), reflectance.a, n_v) * light);
}
