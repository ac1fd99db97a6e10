// Accumulates gathered light over frames: each texel follows its surface by motion and adds its rays to those of its
// history.
#include "lowres_history.glsl"

const float MAX_FLASH = 64.0;  // history counts if it is at most this many times brighter than what is there now

uniform sampler2D gathered_light_now;     // rgb: mean over rays, a: rays
uniform sampler2D gathered_distance_now;  // r: mean over rays
uniform sampler2D gathered_light_prev;
uniform sampler2D gathered_distance_prev;
uniform sampler2D interpolated_light;     // between the surfels, without noise
uniform float max_rays;  // of history

layout(location = 0) out vec4 out_gathered_light;
layout(location = 1) out float out_gathered_distance;

void add(ivec2 low, float closeness, inout vec4 light, inout float distance, inout float weight)
{
    vec4 old_light = texelFetch(gathered_light_prev, low, 0);
    float old_distance = texelFetch(gathered_distance_prev, low, 0).r;
    bool healthy = closeness > 0.0 && is_finite(dot(old_light, vec4(1.0)) + old_distance) && old_light.a >= 1.0;
    light += healthy ? max(old_light, 0.0) * closeness : vec4(0.0);
    distance += healthy ? max(old_distance, 0.0) * closeness : 0.0;
    weight += healthy ? closeness : 0.0;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
    vec4 light_now = texelFetch(gathered_light_now, low, 0);
    float distance_now = texelFetch(gathered_distance_now, low, 0).r;
    bool healthy_now = is_finite(dot(light_now, vec4(1.0)) + distance_now) && light_now.a >= 1.0;
    light_now = healthy_now ? max(light_now, 0.0) : vec4(0.0);
    distance_now = healthy_now ? max(distance_now, 0.0) : 0.0;
    Reprojection r = reproject(low);
    vec4 light = vec4(0.0);
    float distance = 0.0, weight = 0.0;
    add(r.base, r.weights.x, light, distance, weight);
    add(r.base + ivec2(1, 0), r.weights.y, light, distance, weight);
    add(r.base + ivec2(0, 1), r.weights.z, light, distance, weight);
    add(r.base + ivec2(1, 1), r.weights.w, light, distance, weight);
    vec3 expected = max(light_now.rgb, sanitize_radiance(texelFetch(interpolated_light, low, 0).rgb));
    float brightest = max(max(expected.r, expected.g), expected.b), total = max(max(light.r, light.g), light.b);
    bool is_flash = brightest > 0.0 && total > MAX_FLASH * brightest * weight;
    bool keep = weight > MIN_SHARE && !is_flash;
    float before = keep ? min(light.a, max(max_rays - light_now.a, 0.0)) : 0.0;  // rays, fewer where few texels agree
    float rays = before + light_now.a;
    float share = light_now.a / max(rays, 1.0);
    weight = max(weight, 1e-6);
    out_gathered_light = vec4(mix(light.rgb / weight, light_now.rgb, share), rays);
    out_gathered_distance = mix(distance / weight, distance_now, share);
}
