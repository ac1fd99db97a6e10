// Averages reflected light over 3x3 texels, a distance apart, of one surface, as far as the lobe spreads on the way to what it
// reflects and the frames gathered leave noise; mirrors only fill texels without a sample. Two passes, at distances 3 and 1;
// the last also spreads light to texels that show something else, for glossy surfaces thinner than a texel and at edges.
#include "numbers.glsl"
#include "grid.glsl"
#include "nearest_texel.glsl"
#include "reflection.glsl"

const float SPREAD = 1.0;            // slope of the lobe's edge, in alphas
const float MAX_RADIUS = 4.0;        // texels, standard deviation
const float HOLE_RADIUS = 1.5;       // of texels without a sample
const float NOISY_FRAMES = 8.0;      // after which the radius halves
const float MAX_FRAMES = 8.0;        // that a texel counts for

uniform sampler2D light_low;                // radiance; a: frames
#ifdef HAS_REFLECTION_ORIGIN
uniform sampler2D reflection_origin;    // a: 0 where nothing reflects
#endif
uniform sampler2D reflection_distance;  // length of the rays / depth
uniform sampler2D reflection_gbuffer;
uniform sampler2D specular_roughness;
uniform vec2 ratio;   // full-resolution texels per low-resolution texel
uniform int spacing;  // texels

layout(location = 0) out vec4 out_light;  // radiance; a: frames, or the surface's depth if it is the last pass

float roughness_at(ivec2 low)
{
    return clamp(texelFetch(specular_roughness, nearest_texel(low, ratio), 0).a, 0.0, 1.0);
}

// Whether the texel has something to average.
bool is_needed(ivec2 low, ivec2 last)
{
#ifdef HAS_REFLECTION_ORIGIN
    return texelFetch(reflection_origin, low, 0).a != 0.0;
#else
    bool needed = false;
    for (int i = 0; i < 9; ++i)
        needed = needed || texelFetch(light_low, clamp(low + spacing * (ivec2(i % 3, i / 3) - 1), ivec2(0), last), 0).a > 0.0;
    return needed;
#endif
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy), last = textureSize(reflection_gbuffer, 0) - 1;
#ifdef FAST_PATH  // done where nothing is averaged, which is most texels
    out_light = vec4(0.0);
    gl_FragDepth = is_needed(low, last) ? 0.0 : 1.0;
#else
    vec4 surface = texelFetch(reflection_gbuffer, low, 0), here = texelFetch(light_low, low, 0);
    vec3 p = surface_point(vec2(nearest_texel(low, ratio)) + 0.5, surface.a);
    float roughness = roughness_at(low), distance = texelFetch(reflection_distance, low, 0).r;
    float frames = here.a >= 1.0 && is_finite(here.a) ? here.a : 0.0;
    // Texels that the lobe spreads over: its width at the end of the ray, seen from as far as its image is.
    float texels = distance / (1.0 + distance) * roughness * roughness * SPREAD * image.y / (2.0 * lens.y * ratio.y);
#ifdef ORTHOGRAPHIC
    texels *= surface.a;
#endif
    float radius = min(is_finite(texels) ? max(texels, 0.0) / (1.0 + frames / NOISY_FRAMES) : 0.0, MAX_RADIUS);
    radius = frames > 0.0 ? radius : max(radius, HOLE_RADIUS);
    float falloff = 0.5 / max(radius * radius, 1e-3);
    vec4 sum = vec4(0.0), others = vec4(0.0);
    float depths = 0.0;
    for (int i = 0; i < 9; ++i) {
        ivec2 offset = spacing * (ivec2(i % 3, i / 3) - 1), at = clamp(low + offset, ivec2(0), last);
        vec4 there = texelFetch(reflection_gbuffer, at, 0), light = texelFetch(light_low, at, 0);
        float away = dot(surface.xyz, surface_point(vec2(nearest_texel(at, ratio)) + 0.5, there.a) - p);
        float rougher = (roughness_at(at) - roughness) / ROUGHNESS_SIGMA;
        float weight = exp(-falloff * float(offset.x * offset.x + offset.y * offset.y) - rougher * rougher);
        bool known = is_surface(there.a) && is_finite(dot(light, vec4(1.0))) && light.a > 0.0;
        bool counts = known && is_finite(weight) && abs(away) <= PLANE_TOLERANCE * depth_scale(surface.a)
            && dot(surface.xyz, there.xyz) >= SAME_NORMAL;
        sum += counts ? vec4(clamp(light.rgb, 0.0, HALF_MAX), 1.0) * (weight * min(light.a, MAX_FRAMES)) : vec4(0.0);
        depths += known ? there.a : 0.0;
        others += known ? vec4(clamp(light.rgb, 0.0, HALF_MAX), 1.0) : vec4(0.0);
    }
    bool known = sum.a > 0.0 && is_surface(surface.a);
#ifdef WRITE_REFLECTION_FILTERED
    vec4 spread = others.a > 0.0 ? vec4(others.rgb, depths) / others.a : vec4(0.0);
    out_light = known ? vec4(sum.rgb / sum.a, surface.a) : spread;
#else
    // A texel that was empty stays a little so, which the second pass fills better.
    out_light = known ? vec4(sum.rgb / sum.a, max(frames, min(sum.a, 1.0))) : vec4(0.0);
#endif
#endif
}
