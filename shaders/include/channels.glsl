// What networks may read, one function a channel, at texel t of the grid. Lengths are in extent units.
#include "numbers.glsl"
#include "grid.glsl"

#ifdef HAS_ALBEDO
uniform sampler2D albedo;
#endif
#ifdef HAS_NORMAL
uniform sampler2D normal;
#endif
#ifdef HAS_DEPTH
uniform sampler2D depth;
#endif
#ifdef HAS_DIRECT
uniform sampler2D direct;
#endif
#ifdef HAS_EMISSION
uniform sampler2D emission;
#endif
#ifdef HAS_SPECULAR_ROUGHNESS
uniform sampler2D specular_roughness;
#endif
#ifdef HAS_BACKGROUND
uniform sampler2D background;
#endif
uniform float extent;     // extent units per scene unit
uniform vec2 texel_span;  // size of one texel of the tensor, in texels of the G-buffer

vec2 centre(ivec2 t)
{
    return vec2(t) + 0.5;
}

#if defined(WITHOUT_LAMPS) && defined(HAS_EMISSION)
uniform float least_glow;  // above which what an analytic light stands for emits more than it reflects

bool is_lamp(ivec2 t)
{
    vec4 emitted = texelFetch(emission, t, 0);
    return emitted.a == 0.0 && max(max(emitted.r, emitted.g), emitted.b) > least_glow;
}
#endif

#ifdef HAS_DEPTH
float surface_depth(ivec2 t)
{
    float d = texelFetch(depth, t, 0).r;
#if defined(WITHOUT_LAMPS) && defined(HAS_EMISSION)
    if (is_lamp(t)) return 0.0;
#endif
    return is_surface(d) ? d : 0.0;
}

float channel_depth(ivec2 t)
{
    return min(surface_depth(t) * extent, HALF_MAX);
}

vec3 channel_position_view_xyz(ivec2 t)
{
#if defined(ORTHOGRAPHIC) && !defined(GRID_CUBE)
    vec3 p = view_point(centre(t), surface_depth(t)) * extent;
#else
    vec3 p = mat3(view_from_relative) * (surface_ray(centre(t)) * (surface_depth(t) * extent));
#endif
    return clamp(p, -HALF_MAX, HALF_MAX);
}

// Of the texel seen from the eye, exact to second order; on the screen cos³ / d², with the lens's tangents.
float channel_solid_angle(ivec2 t)
{
    if (surface_depth(t) <= 0.0) return 0.0;
#ifdef GRID_CUBE
    vec2 uv = fract(centre(t) / float(CUBE_SIZE)) * 2.0 - 1.0;
    float side = 2.0 / float(CUBE_SIZE);
    float area = side * side * texel_span.x * texel_span.y;
    float square = 1.0 + dot(uv, uv);
#elif defined(ORTHOGRAPHIC)
    vec3 ray = view_point(centre(t), surface_depth(t)) / surface_depth(t);  // of what faces the camera
    float area = 4.0 * lens.x * lens.y * image.z * image.w * texel_span.x * texel_span.y
        / (surface_depth(t) * surface_depth(t));
    float square = dot(ray, ray);
#else
    vec3 ray = view_ray(centre(t));
    float area = 4.0 * lens.x * lens.y * image.z * image.w * texel_span.x * texel_span.y;
    float square = dot(ray, ray);
#endif
    return area / (square * sqrt(square));
}
#endif

#ifdef HAS_NORMAL
vec3 channel_normal_world_xyz(ivec2 t)
{
#ifdef HAS_DEPTH
    if (surface_depth(t) <= 0.0) return vec3(0.0);
#endif
    return sanitize_normal(texelFetch(normal, t, 0).xyz);
}

vec3 channel_normal_view_xyz(ivec2 t)
{
    return mat3(view_from_relative) * channel_normal_world_xyz(t);
}
#endif

#ifdef HAS_ALBEDO
vec3 channel_albedo_rgb(ivec2 t)
{
    return sanitize_albedo(texelFetch(albedo, t, 0).rgb);
}
#endif

#ifdef HAS_DIRECT
vec3 channel_direct_rgb(ivec2 t)
{
    return sanitize_radiance(texelFetch(direct, t, 0).rgb);
}
#endif

vec3 channel_emission_rgb(ivec2 t)
{
#ifdef HAS_EMISSION
    return sanitize_radiance(texelFetch(emission, t, 0).rgb);
#else
    return vec3(0.0);
#endif
}

#ifdef HAS_DIRECT
// Emitters that are analytic lights already (a = 0) don't light a second time.
vec3 channel_radiance_rgb(ivec2 t)
{
    vec3 sum = channel_direct_rgb(t);
#ifdef HAS_EMISSION
    if (texelFetch(emission, t, 0).a > 0.5) sum += channel_emission_rgb(t);
#endif
    return sum;
}
#endif

#ifdef HAS_DIRECT
vec3 channel_surface_and_sky_radiance_rgb(ivec2 t)
{
    vec3 sum = channel_direct_rgb(t) + channel_emission_rgb(t);
#ifdef HAS_BACKGROUND
    sum += sanitize_radiance(texelFetch(background, t, 0).rgb);
#endif
    return min(sum, HALF_MAX);
}
#endif

float channel_roughness(ivec2 t)
{
#ifdef HAS_SPECULAR_ROUGHNESS
    float r = texelFetch(specular_roughness, t, 0).a;
    return is_finite(r) ? clamp(r, 0.0, 1.0) : 1.0;
#else
    return 1.0;
#endif
}

// Whether the direction of the texel lies inside the main camera's image.
float channel_on_screen(ivec2 t)
{
    vec3 v = mat3(view_from_relative) * surface_ray(centre(t));
#ifdef ORTHOGRAPHIC
    return 0.0;  // a direction does not say where a point lies in the image
#else
    return v.z < 0.0 && all(lessThanEqual(abs(v.xy - v.z * center.xy * lens.xy), -v.z * lens.xy)) ? 1.0 : 0.0;
#endif
}
