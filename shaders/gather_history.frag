// Accumulates gathered light over frames: each texel follows its surface by motion and adds its rays to those of its
// history. A frame traces rays from some texels only.
#include "lowres_history.glsl"

const float MAX_FLASH = 64.0;  // history counts if it is at most this many times brighter than what is there now
const float FIRST_RAYS = 1.0;  // that the light between the surfels counts as, where a surface comes into view

uniform sampler2D gathered_light_now;     // rgb: mean over rays, a: rays
uniform sampler2D gathered_surfels_now;   // rgb: light between the surfels, without noise, a: mean distance of rays
uniform sampler2D gathered_light_prev;
uniform sampler2D gathered_surfels_prev;
#ifdef WRITE_GATHERED_GRADIENT
uniform sampler2D gathered_gradient_now;  // of luminance by the surface's tilt, a: luminance
uniform sampler2D gathered_gradient_prev;
#endif
uniform float max_rays;  // of history

layout(location = 0) out vec4 out_gathered_light;
layout(location = 1) out vec4 out_gathered_surfels;
#ifdef WRITE_GATHERED_GRADIENT
layout(location = WRITE_GATHERED_GRADIENT) out vec4 out_gathered_gradient;
#endif

void add(ivec2 low, float closeness, inout vec4 light, inout vec4 surfels, inout vec4 gradient, inout float weight)
{
    vec4 old_light = texelFetch(gathered_light_prev, low, 0), old_surfels = texelFetch(gathered_surfels_prev, low, 0);
    bool healthy = closeness > 0.0 && is_finite(dot(old_light + old_surfels, vec4(1.0))) && old_light.a > 0.0;
    light += healthy ? max(old_light, 0.0) * closeness : vec4(0.0);
    surfels += healthy ? max(old_surfels, 0.0) * closeness : vec4(0.0);
    weight += healthy ? closeness : 0.0;
#ifdef WRITE_GATHERED_GRADIENT
    vec4 old_gradient = texelFetch(gathered_gradient_prev, low, 0);
    gradient += healthy && is_finite(dot(old_gradient, vec4(1.0))) ? old_gradient * closeness : vec4(0.0);
#endif
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
    vec4 light_now = texelFetch(gathered_light_now, low, 0), surfels_now = texelFetch(gathered_surfels_now, low, 0);
    bool looked_up = is_finite(dot(light_now + surfels_now, vec4(1.0)));
    light_now = looked_up ? max(light_now, 0.0) : vec4(0.0);
    surfels_now = looked_up ? max(surfels_now, 0.0) : vec4(0.0);
    bool traced = light_now.a >= 1.0;
    Reprojection r = reproject(low);
    vec4 light = vec4(0.0), surfels = vec4(0.0), gradient = vec4(0.0);
    float weight = 0.0;
    add(r.base, r.weights.x, light, surfels, gradient, weight);
    add(r.base + ivec2(1, 0), r.weights.y, light, surfels, gradient, weight);
    add(r.base + ivec2(0, 1), r.weights.z, light, surfels, gradient, weight);
    add(r.base + ivec2(1, 1), r.weights.w, light, surfels, gradient, weight);
    vec3 expected = max(light_now.rgb, surfels_now.rgb);
    float brightest = max(max(expected.r, expected.g), expected.b), total = max(max(light.r, light.g), light.b);
    bool is_flash = brightest > 0.0 && total > MAX_FLASH * brightest * weight;
    bool keep = weight > MIN_SHARE && !is_flash;
    if (!keep) {
        light = vec4(surfels_now.rgb, history_valid && surfels_now.a > 0.0 ? FIRST_RAYS : 0.0);
        surfels = surfels_now;
        gradient = vec4(0.0);
        weight = 1.0;
    }
    float before = min(light.a, max(max_rays - light_now.a, 0.0));  // rays, fewer where few texels agree
    float rays = before + light_now.a;
    float share = light_now.a / max(rays, 1e-6);
    weight = max(weight, 1e-6);
    out_gathered_light = vec4(mix(light.rgb / weight, light_now.rgb, share), rays);
    out_gathered_surfels.rgb = traced ? surfels_now.rgb : surfels.rgb / weight;
    out_gathered_surfels.a = mix(surfels.a / weight, surfels_now.a, share);
#ifdef WRITE_GATHERED_GRADIENT
    vec4 gradient_now = texelFetch(gathered_gradient_now, low, 0);
    gradient_now = looked_up && is_finite(dot(gradient_now, vec4(1.0))) ? gradient_now : vec4(0.0);
    out_gathered_gradient = mix(gradient / weight, gradient_now, share);
#endif
    if (rays <= 0.0) out_gathered_light = out_gathered_surfels = vec4(0.0);
}
