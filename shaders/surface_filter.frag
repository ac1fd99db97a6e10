// Averages values of 3x3 texels on the same surface by their weights. Two runs, over texels that are 1 and 3 apart, see 9x9
// (Dammertz et al. 2010, "Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering").
#include "numbers.glsl"
#include "grid.glsl"
#include "nearest_texel.glsl"

const float PLANE_SIGMA = 0.02;  // of the receiver's depth_scale

uniform sampler2D WEIGHTED;  // rgb: value times a, a: weight
uniform sampler2D lowres_gbuffer;
uniform vec2 ratio;       // full-resolution texels per low-resolution texel
uniform int spacing;      // texels between samples
uniform int rows = 3;     // no constant, so that the loop stays a loop

layout(location = 0) out vec4 out_mean;

struct Receiver {
    vec3 normal;
    float here;   // its distance along the normal
    float inverse_sigma;
};

// Adds one texel, as far as it shows the same surface.
void add(ivec2 low, Receiver r, inout vec4 sum, inout float total)
{
    low = clamp(low, ivec2(0), textureSize(lowres_gbuffer, 0) - 1);
    vec4 surface = texelFetch(lowres_gbuffer, low, 0), weighted = texelFetch(WEIGHTED, low, 0);
    vec2 pixel = vec2(nearest_texel(low, ratio)) + 0.5;
#ifdef ORTHOGRAPHIC
    float plane = (dot(r.normal, surface_point(pixel, surface.a)) - r.here) * r.inverse_sigma;
#else
    float plane = (dot(r.normal, surface_ray(pixel)) * surface.a - r.here) * r.inverse_sigma;
#endif
    float facing = max(dot(r.normal, surface.xyz), 0.0);
    facing *= facing;
    facing *= facing;
    float alike = facing * facing / (1.0 + plane * plane);
    bool counts = alike > 0.0 && is_surface(surface.a) && is_finite(dot(weighted, vec4(1.0)));
    sum += counts ? weighted * alike : vec4(0.0);
    total += counts ? alike : 0.0;
}

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec4 here = texelFetch(lowres_gbuffer, texel, 0);
    vec3 n = sanitize_normal(here.xyz);
    vec2 pixel = vec2(nearest_texel(texel, ratio)) + 0.5;
#ifdef ORTHOGRAPHIC
    float along = dot(n, surface_point(pixel, here.a));
#else
    float along = dot(n, surface_ray(pixel)) * here.a;
#endif
    Receiver r = Receiver(n, along, 1.0 / (PLANE_SIGMA * depth_scale(here.a)));
    vec4 sum = vec4(0.0);
    float total = 0.0;
    for (int y = 0; y < rows; ++y) {
        for (int x = -1; x <= 1; ++x) add(texel + ivec2(x, y - rows / 2) * spacing, r, sum, total);
    }
#ifdef DIVIDED
    out_mean = vec4(sum.a > 0.0 ? clamp(sum.rgb / sum.a, -HALF_MAX, HALF_MAX) : vec3(0.0), 1.0);
#else
    out_mean = total > 0.0 ? clamp(sum / total, vec4(vec3(-HALF_MAX), 0.0), vec4(HALF_MAX)) : vec4(0.0);
#endif
}
