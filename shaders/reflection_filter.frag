// Averages reflected light over 3x3 texels, a distance apart, of one surface, as far as the lobe spreads on the way to what it
// reflects and the frames gathered leave noise; mirrors only fill texels without a sample. Seen at a slant, a lobe is narrow across
// the plane of incidence: a half vector that tilts by x turns the reflection by 2x in that plane, and by 2x cos(angle of incidence)
// across it; a surface that bends by alpha turns it as far. Two passes, at distances 3 and 1; the last also spreads light to texels
// that show something else, for glossy surfaces thinner than a texel and at edges.
#include "numbers.glsl"
#include "grid.glsl"
#include "nearest_texel.glsl"
#include "reflection.glsl"

const float SPREAD = 2.0;            // of the lobe in the plane of incidence, in alphas
const float MAX_RADIUS = 6.0;        // texels, standard deviation
const float MIN_COSINE = 0.1;        // of the angle of incidence
const float HOLE_RADIUS = 1.5;       // of texels without a sample
const float NOISY_FRAMES = 16.0;     // after which the radius halves
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

// Texels that a texel's light may be averaged over.
float lobe_radius(ivec2 low, float roughness, float depth)
{
    float texels = SPREAD * lobe_texels(texelFetch(reflection_distance, low, 0).r, roughness, depth, ratio);
    return is_finite(texels) ? clamp(texels, 0.0, MAX_RADIUS) : 0.0;
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
    float roughness = roughness_at(low);
    float frames = here.a >= 1.0 && is_finite(here.a) ? here.a : 0.0;
    float shrink = 1.0 + frames / NOISY_FRAMES, radius = lobe_radius(low, roughness, surface.a);
    // On the screen, the plane of incidence lies along the normal.
    vec3 n = mat3(view_from_relative) * surface.xyz;
#ifdef ORTHOGRAPHIC
    vec2 axis = n.xy;
#else
    vec3 at_view = mat3(view_from_relative) * p;
    vec2 axis = n.xy - at_view.xy * (n.z / at_view.z);
#endif
    axis = dot(axis, axis) > 1e-8 ? normalize(axis) : vec2(1.0, 0.0);
    mat2 axes = mat2(axis, vec2(-axis.y, axis.x));
    float cosine = max(abs(dot(surface.xyz, normalize(along_view(p)))), MIN_COSINE);
    vec4 sum = vec4(0.0), others = vec4(0.0);
    float depths = 0.0;
    for (int i = 0; i < 9; ++i) {
        ivec2 offset = spacing * (ivec2(i % 3, i / 3) - 1), at = clamp(low + offset, ivec2(0), last);
        vec4 there = texelFetch(reflection_gbuffer, at, 0), light = texelFetch(light_low, at, 0);
        float away = dot(surface.xyz, surface_point(vec2(nearest_texel(at, ratio)) + 0.5, there.a) - p);
        float roughness_there = roughness_at(at), rougher = (roughness_there - roughness) / ROUGHNESS_SIGMA;
        // The smaller of both lobes, so that what is near stays sharp beside what is far.
        vec2 radii = min(radius, lobe_radius(at, roughness_there, there.a)) / shrink * vec2(1.0, cosine);
        radii = max(radii, frames > 0.0 ? 0.0 : HOLE_RADIUS);
        vec2 along = vec2(offset) * axes;
        vec3 bend = there.xyz - surface.xyz;
        float alpha = roughness * roughness / shrink, bent = frames > 0.0 ? 0.5 * dot(bend, bend) / max(alpha * alpha, 1e-5) : 0.0;
        float weight = exp(-dot(0.5 / max(radii * radii, 1e-3), along * along) - rougher * rougher - bent);
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
