// One reflected ray for each low-resolution texel of a smooth surface, and where the screen shows its end. The ray is marched
// in equal shares of the image (McGuire and Mara 2014, "Efficient GPU Screen-Space Ray Tracing").
#include "numbers.glsl"
#include "grid.glsl"
#include "projection.glsl"
#include "octahedral.glsl"
#include "nearest_texel.glsl"
#include "noise.glsl"
#include "visible_normals.glsl"
#include "reflection.glsl"

const float MIN_EPSILON = 0.05;     // of ray_epsilon, which covers the rounding of positions
const float START = 1.5;            // low-resolution texels, before which nothing is met
const float BIAS = 1e-3;            // of depth_scale, by which a ray is behind what it meets
const float MAX_OFF = 2.0;          // pixels, between a ray's end and the point that the image shows there
const float MIN_FACING = 0.05;      // cosine, of a surface to the eye
const float MAX_LENGTH = 1e3;       // of depth_scale
const float MAX_APPROACH = 0.98;    // of the depth, by which a ray may come towards the eye
const float ALONE = 1.0;            // what directions are thought to differ by between pixels where all around are elsewhere
const float UNKNOWN = -1.0;         // the same along an axis of the image where both are
const float SMOOTH = 0.05, CURVED = 0.1;  // radians, that directions turn by between pixels, from which rays stay where they are
const float LOBE_WIDTH = 0.5;       // of a lobe's slope, what one of its rays widens by in a unit of length

uniform sampler2D reflection_gbuffer;
uniform sampler2D normal;
uniform sampler2D depth;
uniform sampler2D albedo;
uniform sampler2D specular_roughness;
#ifdef STARTS_AT_OUTER  // rays start at outer surfaces, and end at those of the G-buffer
uniform sampler2D outer_reflection_gbuffer;
uniform sampler2D outer_normal;
uniform sampler2D outer_depth;
uniform sampler2D outer_albedo;
uniform sampler2D outer_specular_roughness;
#else
#define outer_reflection_gbuffer reflection_gbuffer
#define outer_normal normal
#define outer_depth depth
#define outer_albedo albedo
#define outer_specular_roughness specular_roughness
#endif
#ifdef HAS_PEEL0_DEPTH
uniform sampler2D peel0_depth;  // of the nearest layer of what is seen through
#endif
uniform vec2 ratio;          // full-resolution texels per low-resolution texel
uniform vec2 noise_offset;   // of the two noise patterns in this frame
uniform vec2 shift;          // pixels, from what a pixel shows to where its ray starts
uniform float scatter;       // of the lobe of sharp images, how much of it rays cover
uniform vec2 inside;         // where in a texel its ray starts, in [0, 1), so that frames cover it
uniform bool at_rest;        // whether rays also start at other surfaces than the one at a texel's centre
uniform float ray_epsilon;   // by which rays start off their surface at most, scene units
uniform int steps;           // of the march
uniform int refinements = 5; // halvings of the step that meets a surface; no constant, so that the loop stays a loop

// Relative space; a: 1 + number of the pixel in the texel, at rest; negative on another surface, 0 for none.
layout(location = WRITE_REFLECTION_ORIGIN) out vec4 out_origin;
layout(location = WRITE_REFLECTION_RAY) out vec4 out_ray;  // unit vector; a: length, 0 for no ray, or (SHARP_)NOT_SHOWN
layout(location = WRITE_REFLECTION_BEAM) out vec2 out_beam;  // width of a pixel's rays, scene units; its growth by unit length
#ifdef WRITE_REFLECTION_ALBEDO
layout(location = WRITE_REFLECTION_ALBEDO) out float out_albedo;  // luminance of the specular albedo where the ray starts
#endif

// Depth of what the march has interpolated over the image.
float marched_depth(float k)
{
#ifdef ORTHOGRAPHIC
    return k;
#else
    return 1.0 / k;
#endif
}

bool is_beyond(vec3 at, float there)
{
    return is_surface(there) && marched_depth(at.z) > there + BIAS * depth_scale(there);
}

bool is_behind(vec3 at)
{
    ivec2 low = clamp(ivec2(at.xy / ratio), ivec2(0), textureSize(reflection_gbuffer, 0) - 1);
    return is_beyond(at, texelFetch(reflection_gbuffer, low, 0).a);
}

#ifdef HAS_PEEL0_DEPTH
bool is_behind_layer(vec3 at)
{
    ivec2 texel = clamp(ivec2(at.xy), ivec2(0), textureSize(peel0_depth, 0) - 1);
    return is_beyond(at, texelFetch(peel0_depth, texel, 0).r);
}
#endif

bool is_shiny(vec4 reflectance)
{
    return ray_share(reflectance.a) > 0.0 && max(max(reflectance.r, reflectance.g), reflectance.b) > 0.0;
}

// Where in its texel the ray starts: at rest at the first shiny pixel from ``inside`` on, so that what is thinner than a texel has
// one in each frame.
int start_of_ray(ivec2 low)
{
    ivec2 pixels = ivec2(ceil(ratio)), first = ivec2(inside * vec2(pixels)), size = textureSize(depth, 0);
    int count = at_rest ? pixels.x * pixels.y : 1, i = 0, number = 0;
    bool found = false;
    do {
        ivec2 pixel = (first + ivec2(i % pixels.x, i / pixels.x)) % pixels;
        number = pixel.y * pixels.x + pixel.x;
        found = is_shiny(texelFetch(outer_specular_roughness, numbered_texel(low, ratio, number, size), 0));
    } while (!found && ++i < count);
    return number;
}

// How the mirrored ray of a pixel differs in direction from that of the surface at p with that normal; a: 1 if it shows this too.
vec4 turn(ivec2 beside, vec3 p, vec3 n, float d)
{
    ivec2 pixel = clamp(beside, ivec2(0), textureSize(outer_depth, 0) - 1);
    float e = texelFetch(outer_depth, pixel, 0).r;
    vec3 q = surface_point(vec2(pixel) + 0.5, e), m = sanitize_normal(texelFetch(outer_normal, pixel, 0).xyz);
    bool same = pixel == beside && is_surface(e) && dot(m, m) > 0.5 && abs(dot(n, q - p)) <= PLANE_TOLERANCE * depth_scale(d);
    vec3 difference = reflect(normalize(along_view(q)), m) - reflect(normalize(along_view(p)), n);
    return same ? vec4(difference, 1.0) : vec4(0.0);
}

// How mirrored rays turn from pixel to pixel along an axis of the image; a: by how much on the mean, which bumps don't cancel,
// or UNKNOWN.
vec4 turned(ivec2 pixel, ivec2 axis, vec3 p, vec3 n, float d)
{
    vec4 after = turn(pixel + axis, p, n, d), before = turn(pixel - axis, p, n, d);
    float count = max(after.a + before.a, 1.0), sum = length(after.xyz) + length(before.xyz);
    return vec4(after.xyz - before.xyz, after.a + before.a > 0.0 ? sum : UNKNOWN) / count;
}

// Where the plane of the surface at p is seen elsewhere in the pixel.
vec3 beside(ivec2 pixel, vec3 p, vec3 face, float d)
{
    vec3 q = surface_point(vec2(pixel) + 0.5 + shift, d), along = normalize(along_view(q));
    float cosine = dot(face, along);
    return abs(cosine) > MIN_FACING ? q + along * dot(face, p - q) / cosine : p;
}

// Length at which the ray from p along l meets what the screen shows, or NOT_SHOWN, also where a layer that is seen through may
// be on the way: only traced rays are tinted.
float march(vec3 p, vec3 l, float jitter)
{
    vec3 view = mat3(view_from_relative) * p, along = mat3(view_from_relative) * l;
    float scale = depth_scale(-view.z), reach = MAX_LENGTH * scale;
    reach = along.z > 0.0 ? min(reach, MAX_APPROACH * -view.z / along.z) : reach;
    vec3 from = project(view, lens.xy, lens.zw), to = project(view + reach * along, lens.xy, lens.zw);
    vec2 moves = to.xy - from.xy, room = mix(from.xy, image.xy - from.xy, greaterThan(moves, vec2(0.0)));
    float border = min(min(room.x / max(abs(moves.x), 1e-6), room.y / max(abs(moves.y), 1e-6)), 1.0);
    float begin = START * ratio.x / max(length(moves), 1e-6);
    bool behind = false, crosses = false;
#ifdef HAS_PEEL0_DEPTH
    bool starts_behind = is_behind_layer(from);
#endif
    float before = begin, at = begin;
    int i = 0;
    do {
        float share = (float(i) + jitter) / float(steps);
        before = at;
        at = mix(begin, border, share * share);
        behind = is_behind(mix(from, to, at));
#ifdef HAS_PEEL0_DEPTH
        crosses = is_behind_layer(mix(from, to, at)) != starts_behind;
#endif
    } while (!behind && !crosses && ++i < steps);
    if (!behind || crosses || begin >= border) return NOT_SHOWN;
    for (int j = 0; j < refinements; ++j) {
        float middle = 0.5 * (before + at);
        bool is_hit = is_behind(mix(from, to, middle));
        at = is_hit ? middle : at;
        before = is_hit ? before : middle;
    }
#ifdef ORTHOGRAPHIC
    float t = at * reach;
#else
    float t = reach * at * to.z / ((1.0 - at) * from.z + at * to.z);
#endif
    ivec2 low = clamp(ivec2(mix(from, to, at).xy / ratio), ivec2(0), textureSize(reflection_gbuffer, 0) - 1);
    vec4 there = texelFetch(reflection_gbuffer, low, 0);
    float away = dot(there.xyz, surface_point(vec2(nearest_texel(low, ratio)) + 0.5, there.a) - (p + t * l));
    float facing = dot(there.xyz, l);
    if (!(facing < 0.0 && abs(away) <= PLANE_TOLERANCE * depth_scale(there.a))) return NOT_SHOWN;
    // Where it meets that surface's plane, the image must show this point at full resolution too.
    t += away / facing;
    vec3 end = p + t * l;
    vec2 position = project(mat3(view_from_relative) * end, lens.xy, lens.zw).xy;
    ivec2 pixel = ivec2(clamp(position, vec2(0.0), vec2(textureSize(depth, 0) - 1)));
    float d = texelFetch(depth, pixel, 0).r;
    vec3 shown = surface_point(vec2(pixel) + 0.5, d), n = sanitize_normal(texelFetch(normal, pixel, 0).xyz);
    vec4 reflectance = texelFetch(specular_roughness, pixel, 0);
    float facing_eye = max(-dot(n, normalize(along_view(shown))), MIN_FACING);
    bool meets = is_surface(d) && dot(n, l) < 0.0 && distance(end, shown) * facing_eye <= MAX_OFF * pixel_width(d)
        && !is_metallic(texelFetch(albedo, pixel, 0).rgb, reflectance.rgb)
        && !(onward_share(sanitize_albedo(reflectance.rgb), reflectance.a, -dot(n, l)) > 0.0);
    return meets && t > 0.0 ? t : NOT_SHOWN;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy), centre = nearest_texel(low, ratio);
    int number = start_of_ray(low);
    ivec2 full = numbered_texel(low, ratio, number, textureSize(depth, 0));
    vec4 surface = texelFetch(outer_reflection_gbuffer, low, 0);
    float d = texelFetch(outer_depth, full, 0).r;
    vec3 n = sanitize_normal(texelFetch(outer_normal, full, 0).xyz), p = surface_point(vec2(full) + 0.5, d);
    float away = dot(surface.xyz, p - surface_point(vec2(centre) + 0.5, surface.a));
    bool same = is_surface(surface.a) && is_surface(d) && dot(n, surface.xyz) >= SAME_NORMAL
        && abs(away) <= PLANE_TOLERANCE * depth_scale(surface.a);
    if (!same && !at_rest) {
        number = number_of_centre(ratio);
        full = centre;
        d = surface.a;
        n = surface.xyz;
        p = surface_point(vec2(centre) + 0.5, d);
        same = true;
    }
    vec4 reflectance = texelFetch(outer_specular_roughness, full, 0), at_centre = texelFetch(outer_specular_roughness, centre, 0);
    vec3 face = octahedral_decode(vec2(texelFetch(outer_normal, full, 0).a, texelFetch(outer_albedo, full, 0).a));
    bool reflects = is_surface(d) && dot(n, n) > 0.5 && is_finite(dot(face, face)) && is_shiny(reflectance);
#ifdef FAST_PATH  // done where no ray starts
    out_origin = vec4(0.0, 0.0, 0.0, is_surface(surface.a) && is_shiny(at_centre) ? 1.0 : 0.0);
    out_ray = vec4(0.0);
    out_beam = vec2(0.0);
#ifdef WRITE_REFLECTION_ALBEDO
    out_albedo = 0.0;
#endif
    gl_FragDepth = reflects ? 0.0 : 1.0;
#else
    vec2 mirrored = vec2(low.y, textureSize(reflection_gbuffer, 0).x - low.x);
    vec2 u = fract(vec2(texel_noise(vec2(low)), texel_noise(mirrored)) + noise_offset);
    vec3 v = -normalize(along_view(p));
#ifdef WRITE_REFLECTION_ALBEDO
    out_albedo = luminance(specular_albedo(sanitize_albedo(reflectance.rgb), reflectance.a, dot(n, v)));
#endif
    float alpha = reflectance.a * reflectance.a, sharpness = image_sharpness(reflectance.a, d, ratio);
    vec3 l = reflected(v, n, face, alpha, vec2(u.x * mix(1.0, scatter, sharpness), u.y));
    vec4 across = turned(full, ivec2(1, 0), p, n, d), upwards = turned(full, ivec2(0, 1), p, n, d);
    bool is_known = min(across.a, upwards.a) >= 0.0;
    float most = max(across.a, upwards.a), turns = is_known ? 0.5 * (across.a + upwards.a) : most >= 0.0 ? most : ALONE;
    float smoothness = is_known && dot(face, v) > MIN_FACING ? 1.0 - smoothstep(SMOOTH, CURVED, turns) : 0.0;
    p += smoothness * (beside(full, p, face, d) - p);
    l += smoothness * (across.xyz * shift.x + upwards.xyz * shift.y);
    l = normalize(l - 2.0 * min(dot(l, face), 0.0) * face);
    // Half a pixel, within limits, off the surface and towards the eye, where nothing is in the way, also in a corner.
    vec3 origin = p + (face + v) * clamp(0.5 * pixel_width(d), MIN_EPSILON * ray_epsilon, ray_epsilon);
    out_origin = vec4(origin, float(1 + number) * (same ? 1.0 : -1.0));
    float t = march(origin, l, fract(u.x + u.y));
    out_ray = vec4(l, t == NOT_SHOWN && sharpness > 0.0 ? SHARP_NOT_SHOWN : t);
    // Ray cones (Akenine-Möller et al. 2019, "Texture Level of Detail Strategies for Real-Time Ray Tracing"), and a share of the
    // lobe, of which one ray is one of many.
    out_beam = vec2(pixel_width(d), turns + LOBE_WIDTH * alpha);
#endif
}
