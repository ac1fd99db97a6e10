// Adds the light that the rays of gather_trace.comp have met to that of the samples before. Final gathering: Reichert 1992, "A
// Two-Pass Radiosity Method Driven by Lights and Viewer Position"; where rays end nearby, by second rays (Christensen 1999,
// "Faster Photon Map Global Illumination").
#include "grid.glsl"
#include "nearest_texel.glsl"
#include "ray_ends.glsl"
#include "gather_turns.glsl"

uniform vec2 ratio;              // texels of the G-buffer per texel of the grid
uniform vec3 local_eye;          // in local space: world axes, the scene's centre as origin
uniform int samples_before;      // of each texel
uniform int sample_count;        // of each texel

layout(rgba32f, binding = 0) uniform image2D gathered_light;    // a: rays; while samples are added, their sum
layout(rgba32f, binding = 1) uniform image2D gathered_surfels;  // rgb: light between the surfels; a: mean length of rays, likewise
#ifdef HAS_BUMPS
layout(rgba32f, binding = 2) uniform image2D gathered_gradient;  // of luminance by the surface's tilt, a: luminance; likewise

const float LEAST_COSINE = 0.1;  // as in app/surfels/final_gather.py

// What a ray of that light adds (Ward and Heckbert 1992, "Irradiance Gradients", section 3.1).
vec4 rotation_gradient(vec3 light, vec3 to_end, vec3 n)
{
    vec3 along = to_end * inversesqrt(max(dot(to_end, to_end), 1e-30));
    float cosine = dot(along, n);
    return luminance(light) * vec4((along - cosine * n) / max(cosine, LEAST_COSINE), 1.0);
}
#endif

void main()
{
    ivec2 texel = ivec2(gl_WorkGroupID.xy), size = textureSize(surfaces, 0);
    vec4 surface = texelFetch(surfaces, texel, 0), light = vec4(0.0), between = vec4(0.0), gradient = vec4(0.0);
    if (is_wanted(texel, surface)) {
        vec3 p = surface_point(vec2(nearest_texel(texel, ratio)) + 0.5, abs(surface.a)) + local_eye;
        if (samples_before == 0) {
            between.rgb = surfel_light_at(p, surface.xyz).indirect;
        } else {
            light = imageLoad(gathered_light, texel);
            between = imageLoad(gathered_surfels, texel);
#ifdef HAS_BUMPS
            gradient = imageLoad(gathered_gradient, texel);
#endif
        }
        bool traced = has_turn(texel), is_last = samples_before + 1 == sample_count;
        float share = is_last ? 1.0 / float(sample_count) : 1.0, near = texelFetch(end_albedo, texel, 0).a;
        if (traced) {
            vec3 further = near < 1.0 ? light_of(texel + ivec2(0, size.y), true, vec3(0.0)) : vec3(0.0);
            vec3 met = light_of(texel, near >= 1.0, further);
            light.rgb = (light.rgb + met) * share;
            light.a = float(sample_count);
#ifdef HAS_BUMPS
            gradient = (gradient + rotation_gradient(met, texelFetch(end_position, texel, 0).xyz - p, surface.xyz)) * share;
#endif
        }
        between.a = traced ? (between.a + near) * share : 1.0;
    }
    if (gl_LocalInvocationIndex == 0u) {
        imageStore(gathered_light, texel, light);
        imageStore(gathered_surfels, texel, between);
#ifdef HAS_BUMPS
        imageStore(gathered_gradient, texel, gradient);
#endif
    }
}
