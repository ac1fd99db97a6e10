// The light at the ends of reflected rays: what the screen shows there, if it does, or what was found where they were traced.
// What the screen shows there counts as diffuse: its highlights are those of another viewer.
#include "numbers.glsl"
#include "grid.glsl"
#include "projection.glsl"
#include "reflection.glsl"

const float MIN_RATIO = 1e-4;        // of a ray's length to the depth where it starts
const float MAX_WIDTH = 64.0;        // pixels, of a beam of which the image is averaged
const float TAP_OFFSET = 0.3;        // of that width, of two taps beside the middle, along one diagonal or the other

uniform sampler2D reflection_origin;  // relative space; a: negative on another surface than the texel's
uniform sampler2D reflection_ray;     // direction; a: length if the screen shows the end
uniform sampler2D reflection_beam;    // width of a pixel's rays where they start, scene units; its growth by unit length
// Radiance; a: length, negative where a ray passes glass or goes on, 0 for none. It replaces what the screen shows.
uniform sampler2D reflection_traced;
uniform sampler2D normal;
uniform sampler2D depth;
uniform sampler2D direct;
uniform sampler2D albedo;
uniform sampler2D indirect;
uniform sampler2D specular_roughness;
#ifdef HAS_OCCLUSION
uniform sampler2D occlusion;
#endif
#ifdef HAS_EMISSION
uniform sampler2D emission;           // a: 0 on what stands for an analytic light, whose reflection is direct light
#endif

layout(location = 0) out vec4 out_now;  // radiance; a: length / depth where it starts, 0 for none, < 0 on another surface

// Whether the light there is a number, and indirect light none that a network made of others. What one ray of a still brings
// stays for many frames.
bool is_known(ivec2 texel)
{
    vec3 arriving = texelFetch(indirect, texel, 0).rgb, sum = texelFetch(direct, texel, 0).rgb + arriving;
#ifdef HAS_EMISSION
    sum += texelFetch(emission, texel, 0).rgb;
#endif
    return is_finite(dot(sum, vec3(1.0))) && all(lessThan(arriving, vec3(HALF_MAX)));
}

vec3 sent_by(ivec2 texel)
{
    vec3 arriving = sanitize_radiance(texelFetch(indirect, texel, 0).rgb);
    vec3 diffuse = sanitize_albedo(texelFetch(albedo, texel, 0).rgb) * arriving;
#ifdef HAS_OCCLUSION
    diffuse *= texelFetch(occlusion, texel, 0).r;
#endif
    vec3 sum = sanitize_radiance(texelFetch(direct, texel, 0).rgb) + diffuse
        + sanitize_albedo(texelFetch(specular_roughness, texel, 0).rgb) * arriving;
#ifdef HAS_EMISSION
    vec4 emitted = texelFetch(emission, texel, 0);
    sum += emitted.a > 0.5 ? sanitize_radiance(emitted.rgb) : vec3(0.0);
#endif
    return sum;
}

// The same of a beam that is so many pixels wide: the mean of what they show of the plane around ``end`` with that normal.
vec3 sent_by_around(ivec2 texel, float width, vec3 end, vec3 n)
{
    vec4 sum = vec4(sent_by(texel), 1.0);
    vec2 offset = TAP_OFFSET * min(width, MAX_WIDTH) * vec2(1.0, (int(gl_FragCoord.x) + int(gl_FragCoord.y)) % 2 * 2 - 1);
    int i = width > 1.0 ? 0 : 2;
    while (i < 2) {
        ivec2 tap = clamp(ivec2(floor(vec2(texel) + 0.5 + offset)), ivec2(0), textureSize(depth, 0) - 1);
        float d = texelFetch(depth, tap, 0).r, height = dot(n, surface_point(vec2(tap) + 0.5, d) - end);
        bool counts = is_surface(d) && is_known(tap) && abs(height) <= PLANE_TOLERANCE * depth_scale(d)
            && !is_metallic(texelFetch(albedo, tap, 0).rgb, texelFetch(specular_roughness, tap, 0).rgb);
        sum += counts ? vec4(sent_by(tap), 1.0) : vec4(0.0);
        offset = -offset;
        ++i;
    }
    return sum.rgb / sum.a;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
    vec4 ray = texelFetch(reflection_ray, low, 0);
#ifdef FAST_PATH  // done where no ray starts
    out_now = vec4(0.0);
    gl_FragDepth = ray.a == 0.0 ? 1.0 : 0.0;
#else
    vec4 traced = texelFetch(reflection_traced, low, 0);
    vec4 origin = texelFetch(reflection_origin, low, 0);
    float here = -(mat3(view_from_relative) * origin.xyz).z;
    bool is_traced = traced.a != 0.0 && is_finite(traced.a), is_shown = !is_traced && ray.a > 0.0 && is_finite(ray.a);
    float t = is_shown ? ray.a : is_traced ? abs(traced.a) : 0.0;
    vec3 end = origin.xyz + t * ray.xyz;
    vec3 view = mat3(view_from_relative) * end;
    ivec2 texel = ivec2(floor(project(view, lens.xy, lens.zw).xy));
    bool inside = -view.z > 0.0 && all(greaterThanEqual(texel, ivec2(0))) && all(lessThan(texel, textureSize(depth, 0)));
    texel = inside ? texel : ivec2(0);
    float d = texelFetch(depth, texel, 0).r;
    vec3 n = sanitize_normal(texelFetch(normal, texel, 0).xyz);
    float away = dot(n, end - surface_point(vec2(texel) + 0.5, d));
    bool seen = inside && is_surface(d) && dot(n, ray.xyz) < 0.0
        && (is_shown || (traced.a > 0.0 && abs(away) <= PLANE_TOLERANCE * depth_scale(d)
            && !is_metallic(texelFetch(albedo, texel, 0).rgb, texelFetch(specular_roughness, texel, 0).rgb)));
    vec2 beam = texelFetch(reflection_beam, low, 0).xy;
    float width = (beam.x + beam.y * t) / pixel_width(d);
    vec3 light = seen ? sent_by_around(texel, width, end, n) : is_traced ? sanitize_radiance(traced.rgb) : vec3(0.0);
    bool counts = is_surface(here) && (seen ? is_known(texel) : is_traced && is_finite(dot(traced.rgb, vec3(1.0))));
    out_now = counts ? vec4(min(light, HALF_MAX), sign(origin.a) * clamp(t / here, MIN_RATIO, HALF_MAX)) : vec4(0.0);
#endif
}
