// What surfaces reflect of indirect light: the light along reflected rays, upsampled as in upsample.frag, or for rough surfaces
// the diffuse light that arrives, times the lobe's albedo (the split sum of Karis 2013, "Real Shading in Unreal Engine 4").
#include "numbers.glsl"
#include "grid.glsl"
#include "joint_bilateral.glsl"
#include "reflection.glsl"
#include "specular_albedo.glsl"

uniform sampler2D normal;
uniform sampler2D depth;
uniform sampler2D specular_roughness;
uniform sampler2D indirect;
#ifdef HAS_REFLECTION_FILTERED
uniform sampler2D reflection_filtered;  // radiance; a: depth of its surface, 0 where no light is known
uniform vec2 ratio;  // full-resolution texels per low-resolution texel

const float ROUGHNESS_SIGMA = 0.1;
const float MIN_LIKENESS = 1e-3;  // so that the most similar texel counts

// Weighted by the distance from the receiver's plane, which parts surfaces that meet at an edge too, and by roughness.
vec4 tap(ivec2 low, float along, float closeness, float roughness, BilateralReceiver r)
{
    float rougher = (texelFetch(specular_roughness, nearest_texel(low, ratio), 0).a - roughness) / ROUGHNESS_SIGMA;
    float likeness = MIN_LIKENESS + 1.0 / (1.0 + rougher * rougher * rougher * rougher);
    vec4 light = texelFetch(reflection_filtered, low, 0);
#ifdef ORTHOGRAPHIC
    float plane = (along + r.slope.z * light.a - r.here) * r.inverse_sigma;
#else
    float plane = ((along + r.slope.z) * light.a - r.here) * r.inverse_sigma;
#endif
    bool counts = light.a > 0.0 && is_finite(dot(light, vec4(1.0))) && is_finite(likeness);
    return counts ? vec4(clamp(light.rgb, 0.0, HALF_MAX), 1.0) * ((closeness + MIN_WEIGHT) * likeness / (1.0 + plane * plane)) : vec4(0.0);
}

vec3 upsampled(vec3 n, float d, float roughness, vec3 otherwise)
{
    BilateralReceiver r = bilateral_receiver(gl_FragCoord.xy, n, d);
    Around t = texels_around(gl_FragCoord.xy, textureSize(reflection_filtered, 0), ratio, r);
    vec2 f = t.f, g = 1.0 - f;
    vec4 sum = tap(t.low, t.along_low.x + t.along_low.y, g.x * g.y, roughness, r)
        + tap(ivec2(t.high.x, t.low.y), t.along_high.x + t.along_low.y, f.x * g.y, roughness, r)
        + tap(ivec2(t.low.x, t.high.y), t.along_low.x + t.along_high.y, g.x * f.y, roughness, r)
        + tap(t.high, t.along_high.x + t.along_high.y, f.x * f.y, roughness, r);
    return sum.a > 0.0 ? sum.rgb / sum.a : otherwise;
}
#endif

layout(location = 0) out vec4 out_reflection;

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, texel, 0).r;
    vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
    vec4 reflectance = texelFetch(specular_roughness, texel, 0);
    vec3 light = sanitize_radiance(texelFetch(indirect, texel, 0).rgb);
#ifdef HAS_REFLECTION_FILTERED
    light = mix(light, upsampled(n, d, reflectance.a, light), ray_share(reflectance.a));
#endif
    float n_v = dot(n, -normalize(along_view(surface_point(gl_FragCoord.xy, d))));
    vec3 reflected = specular_albedo(sanitize_albedo(reflectance.rgb), reflectance.a, n_v) * light;
    out_reflection = is_surface(d) ? vec4(sanitize_radiance(reflected), 1.0) : vec4(0.0);
}
