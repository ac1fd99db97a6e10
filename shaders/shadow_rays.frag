// One shadow ray for each receiver: towards a point of a light with an area, or along a direction of the environment,
// chosen about as often as it contributes to the unshadowed light. Every second ray of a shiny surface says what its
// highlights see instead: it follows the specular lobe if it meets a rectangle there, or goes to a sphere whose highlight shows.
// What rays meet is found on the CPU, or here with RAYS_HERE, for all samples of a
// frame at once.
#include "numbers.glsl"
#include "grid.glsl"
#include "nearest_texel.glsl"
#include "light_sampling.glsl"
#include "sky_irradiance.glsl"
#ifdef SPECULAR_RAYS
#define LOBES_OF_SPHERES
#include "visible_normals.glsl"
#include "ggx.glsl"
#endif
#ifdef RAYS_HERE
#include "ray_scene.glsl"
#endif

const int BLOCK = 9;              // texels along the edge of a block whose rays share one sequence (Keller and Heidrich 2001,
                                  // "Interleaved Sampling"); the filter averages over as many
const int SKY_CANDIDATES = 4;     // of which one is chosen (Talbot, Cline and Egbert 2005, "Importance Resampling for Global Illumination")
const uvec3 RECURRENCE = uvec3(3518319155u, 2882110345u, 2360945575u);  // R3 of Roberts 2018, in 32-bit fixed point
const uvec2 SPECULAR_RECURRENCE = uvec2(3242174889u, 2447445414u);      // his R2
const float TO_UNIT = 1.0 / 4294967296.0;
const vec2 SKY_CELL_EXTENT = vec2(PI / 32.0);  // of azimuth and polar angle, as in environment.py
const float MIN_EPSILON = 0.05;   // of ray_epsilon, which covers the rounding of positions
const float MAX_WEIGHED = 256.0;  // largest light over its probability, in the largest light
const float MAX_SQUARE = 1e4;   // of a share
const int MAX_LESSONS = 8;      // samples that a guide learns by at once
const float SHORTENED = 0.999;  // so that rays end before what touches the light
const float PLANE_TOLERANCE = 0.01;  // of depth_scale, as in shadow_filter.frag
const float MIN_COSINE = 0.9;        // between normals of triangles
const vec2 PICK_WEIGHTS = vec2(97.0, 31.0);  // of two random numbers, whose sum without its whole part is a third one
const float MIN_HIGHLIGHT = 0.1;     // of spheres, in the light that a white surface would reflect diffusely; else rays are not spent on it

#ifdef GRID_SURFELS
uniform sampler2D light_sample_position;  // local space: world axes, the scene's centre as origin
uniform sampler2D light_sample_normal;    // 0: no sample
#else
uniform sampler2D albedo;
uniform sampler2D normal;
uniform sampler2D depth;
uniform vec2 ratio;          // texels of the G-buffer per receiver
#endif
#ifdef SPECULAR_RAYS
uniform sampler2D specular_roughness;
#endif
#ifdef HAS_SKY_STRATA
uniform sampler2D sky_strata;  // lower half: azimuth and polar angle where each begins; upper half: power in W/m²
#endif
#ifdef GUIDE_PARTS
uniform usampler2D sky_guide;  // a row for each tile of receivers, see app/gl/sky_guide.py: parts of the unit square that is
                               // spread over the strata; in the last texel which share of the sky's light is visible
#endif
#ifdef GUIDES_LIGHTS
uniform sampler2D light_guide;  // a row for each tile of receivers: the visible share of each light, and last what their rays bring
                                // without occlusion over their irradiance, 0 where they are not guided
#endif
#ifdef GUIDE_TILE
uniform int guide_columns;     // tiles in a row of the grid
#endif
#if defined(GRID_SURFELS) || defined(RAYS_HERE)
uniform vec3 local_eye;      // in local space
#endif
#ifdef RAYS_HERE
uniform int first_sample;    // of each receiver
uniform int sample_count;
int sample_index;
#else
uniform int sample_index;    // of each receiver
#endif
uniform float noise_phase;   // shifts the sequence, from the seed
uniform float ray_epsilon;   // by which rays start off their surface at most, scene units
uniform float sky_distance;  // length of a ray towards the environment, scene units

#ifdef RAYS_HERE
layout(location = 0) out vec4 out_visible;     // rgb: mean irradiance of the samples that reach their light, a: samples
layout(location = 1) out vec4 out_unshadowed;  // rgb: mean irradiance of all samples, a: mean square of the visible share of one
#ifdef SPECULAR_RAYS
// r: mean luminance of the rectangles that specular rays reach, g: of all of them, b: its mean square, a: number of these rays
layout(location = 2) out vec4 out_specular;
#endif
#ifdef WRITE_LESSONS
// The sky's luminance for the first sample as its bits, and for each sample: whether it is one of diffuse light, 1 plus the part
// of the sky that it has arrived in, or 0, and half the bits of its luminance over that of the sky.
layout(location = WRITE_LESSONS) out uvec4 out_lessons_0;
layout(location = WRITE_LESSONS + 1) out uvec4 out_lessons_1;
layout(location = WRITE_LESSONS + 2) out uvec4 out_lessons_2;
#endif
#else
layout(location = 0) out vec4 out_origin;  // relative space
layout(location = 1) out vec4 out_vector;  // from there to the ray's end; a: 0: no ray, 1: passes light proxies, 2: meets all,
                                           // from 3 on: to the sky, and meets all; then 3 plus the part that the ray ends in;
                                           // -1: to the sky, but into the surface
layout(location = 2) out vec4 out_light;   // rgb: unshadowed irradiance of the sample, over its probability; a: for a specular
                                           // ray instead, the luminance of the rectangle that it is traced to
#ifdef GUIDE_TILE
layout(location = 3) out vec4 out_known;   // rgb: unshadowed irradiance that is known, less the sample's part of it; a: luminance
                                           // of the sky's
#endif
#ifdef GUIDES_LIGHTS
layout(location = 4) out vec2 out_lesson;  // light, -1: none; luminance of its irradiance over the chance that it was chosen
#endif
#endif

struct Receiver {
    ivec2 pixel;
    vec3 p;
    vec3 n;
    vec3 face;
    vec3 origin;  // of its rays: off the surface, and towards the eye, where nothing is in the way, also in a corner
    bool is_surface;
};

#ifdef GRID_SURFELS
Receiver receiver(ivec2 texel)
{
    vec3 p = texelFetch(light_sample_position, texel, 0).xyz - local_eye;
    vec3 n = texelFetch(light_sample_normal, texel, 0).xyz;
    return Receiver(texel, p, n, n, p + n * (MIN_EPSILON * ray_epsilon), dot(n, n) > 0.5);
}
#else
Receiver receiver_at(ivec2 pixel)
{
    float d = texelFetch(depth, pixel, 0).r;
    vec4 surface = texelFetch(normal, pixel, 0);
    vec3 n = sanitize_normal(surface.xyz);
    vec3 face = octahedral_decode(vec2(surface.a, texelFetch(albedo, pixel, 0).a));
    vec3 p = surface_point(vec2(pixel) + 0.5, d);
    // Half a pixel, within limits: what is nearer can't be seen to cast a shadow.
    float epsilon = clamp(0.5 * pixel_width(d), MIN_EPSILON * ray_epsilon, ray_epsilon);
    return Receiver(pixel, p, n, face, p + (face - normalize(along_view(p))) * epsilon, is_surface(d) && dot(n, n) > 0.5);
}

// Successive samples start at all pixels of a texel, as do those of neighbours, so that an edge of a shadow has no steps.
ivec2 pixel_of_sample(ivec2 texel)
{
    ivec2 side = ivec2(ceil(ratio));
    int pixels = side.x * side.y;
    // Rounds begin so that a pixel does not always have an even or an odd sample, only one of which may be specular.
    int pixel = (sample_index + sample_index / pixels * (1 + pixels % 2) + texel.x + side.x * texel.y) % pixels;
    vec2 inside = (vec2(pixel % side.x, pixel / side.x) + 0.5) / vec2(side);
    return texel_inside(texel, ratio, inside, textureSize(depth, 0));
}

// On the surface at the texel's centre, which its light is averaged and shown for.
Receiver receiver(ivec2 texel)
{
    Receiver centre = receiver_at(nearest_texel(texel, ratio)), other = receiver_at(pixel_of_sample(texel));
    float away = dot(centre.face, other.p - centre.p);
    bool is_alike = centre.is_surface && other.is_surface && dot(centre.face, other.face) >= MIN_COSINE
        && abs(away) <= PLANE_TOLERANCE * depth_scale(texelFetch(depth, centre.pixel, 0).r);
    if (is_alike) return other;
    return centre;
}
#endif

// A hash of three numbers (pcg3d of Jarzynski and Olano 2020, "Hash Functions for GPU Rendering").
uvec3 hash(uvec3 v)
{
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> 16u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

// The next three numbers of a receiver's sequence. Those of a block start evenly spread, those of two blocks anywhere.
vec3 sequence(ivec2 texel)
{
    uvec2 cell = uvec2(texel) % uint(BLOCK);
    // A step without a factor in common with the block spreads neighbours over the starts.
    uint lane = ((cell.x * uint(BLOCK) + cell.y) * 31u) % uint(BLOCK * BLOCK);
    uvec3 start = hash(uvec3(uvec2(texel) / uint(BLOCK), uint(noise_phase * 65536.0))) + RECURRENCE.zxy * lane;
    return vec3((RECURRENCE * uint(sample_index) + start) >> 8u) * (256.0 * TO_UNIT);
}

#ifdef GUIDE_TILE
int guide_row(ivec2 texel)
{
    return texel.y / GUIDE_TILE * guide_columns + texel.x / GUIDE_TILE;
}
#endif

#ifdef HAS_SKY_STRATA
// A point of the unit square that is spread over the strata.
struct SkyPoint {
    vec2 at;
    float density;  // over that of points spread evenly
};

#ifdef GUIDE_PARTS
const int PART_COUNT = GUIDE_PARTS * GUIDE_PARTS;
const float EVEN_SHARE = 1.0 / float(SKY_CANDIDATES);  // of the candidates, which find what the guide doesn't know

// The part of the environment that a point of the unit square is in.
int part_of(vec2 at)
{
    ivec2 part = min(ivec2(at * float(GUIDE_PARTS)), GUIDE_PARTS - 1);
    return part.y * GUIDE_PARTS + part.x;
}

bool guides_to_sky(ivec2 texel)
{
    return texelFetch(sky_guide, ivec2(PART_COUNT, guide_row(texel)), 0).r != 0u;
}

float visible_share(ivec2 texel)
{
    return uintBitsToFloat(texelFetch(sky_guide, ivec2(PART_COUNT + GUIDE_ENTRIES, guide_row(texel)), 0).r);
}

// One of the candidates is spread evenly, the others are guided.
SkyPoint sky_point(ivec2 texel, vec2 s, int candidate)
{
    int row = guide_row(texel);
    float along = s.x * float(GUIDE_ENTRIES);
    uint entry = texelFetch(sky_guide, ivec2(PART_COUNT + int(along), row), 0).r;
    if (entry == 0u) return SkyPoint(s, 1.0);
    int part = candidate == 0 ? part_of(s) : int(entry & 1023u);
    vec2 within = vec2((float((entry >> 10u) & 2047u) + fract(along)) / float(entry >> 21u), s.y);
    vec2 at = candidate == 0 ? s : (vec2(part % GUIDE_PARTS, part / GUIDE_PARTS) + within) / float(GUIDE_PARTS);
    float entries = float(texelFetch(sky_guide, ivec2(part, row), 0).r);
    return SkyPoint(at, mix(entries * float(PART_COUNT) / float(GUIDE_ENTRIES), 1.0, EVEN_SHARE));
}
#else
SkyPoint sky_point(ivec2 texel, vec2 s, int candidate)
{
    return SkyPoint(s, 1.0);
}
#endif

// A direction of the environment for s in [0, 1)²: one of four, from points in opposite quarters of the unit square, that is
// chosen by pick in [0, 1), in proportion to its unshadowed light.
LightSample sample_sky(ivec2 texel, vec3 n, vec2 s, float pick, out vec2 chosen_at)
{
    ivec2 strata = textureSize(sky_strata, 0) / ivec2(1, 2);
    LightSample chosen = LightSample(n * sky_distance, vec3(0.0), true);
    float total = 0.0, chosen_target = 0.0;
    chosen_at = vec2(0.0);
    for (int i = 0; i < SKY_CANDIDATES; ++i) {
        SkyPoint point = sky_point(texel, fract(s + 0.5 * vec2(i & 1, i >> 1)), i);
        vec2 at = point.at * vec2(strata);
        ivec2 stratum = min(ivec2(at), strata - 1);
        vec2 angles = texelFetch(sky_strata, stratum, 0).xy + (at - vec2(stratum)) * SKY_CELL_EXTENT;
        vec3 direction = vec3(sin(angles.y) * sin(angles.x), cos(angles.y), -sin(angles.y) * cos(angles.x));
        vec3 light = texelFetch(sky_strata, stratum + ivec2(0, strata.y), 0).rgb
            * (float(strata.x * strata.y) * max(dot(direction, n), 0.0));
        float target = luminance(light);
        bool take = replaces(target, total, pick);
        chosen.vector = take ? direction * sky_distance : chosen.vector;
        chosen.light = take ? light / point.density : chosen.light;
        chosen_target = take ? target : chosen_target;
        chosen_at = take ? point.at : chosen_at;
    }
    chosen.light *= total / (float(SKY_CANDIDATES) * max(chosen_target, LUMINANCE_FLOOR));
    return chosen;
}
#endif

#ifdef SPECULAR_RAYS
// What replaces samples of diffuse light must not depend on their numbers, so it has a sequence of its own.
vec2 specular_sequence(ivec2 texel)
{
    uvec2 start = hash(uvec3(uvec2(texel), uint(noise_phase * 65536.0) + 1u)).xy;
    return vec2((SPECULAR_RECURRENCE * uint(sample_index) + start) >> 8u) * (256.0 * TO_UNIT);
}

#ifdef HAS_TRACED_SPHERE
// A point of one of the spheres, chosen as often as it contributes to the highlights of all, which light is.
LightSample sample_highlight(Receiver r, Lobe lobe, vec2 s, float diffuse)
{
    float total = 0.0, choice = s.x;
    int chosen = MAPPED_COUNT, i = MAPPED_COUNT;
    do {
        bool take = replaces(luminance(ggx_specular(lights[i], r.p, r.n, lobe)), total, choice);
        chosen = take ? i : chosen;
    } while (++i < RECTS_BEGIN);
    LightSample ray = sample_light(lights[chosen], r.p, r.n, vec2(choice, s.y));
    ray.light = vec3(total > MIN_HIGHLIGHT / PI * diffuse ? total : 0.0);
    return ray;
}
#endif

#ifdef HAS_TRACED_RECT
// The nearest rectangle that a reflected ray would meet; light is what is reflected of its radiance. With images, which may be seen
// through each other, it is any of those that the ray would meet, as often as it is part of the light of all.
LightSample sample_mirrored(Receiver r, Lobe lobe, vec2 s)
{
    float reach = 1e30;
    vec3 along = reflected(lobe.v, r.n, r.face, lobe.alpha, s), light = vec3(0.0);
    bool meets_proxies = false;
#ifdef HAS_LIGHT_IMAGES
    float total = 0.0, pick = fract(dot(s, PICK_WEIGHTS));
#endif
    int i = RECTS_BEGIN;
    do {
        vec3 to_light = lights[i].position.xyz - r.p;
        float speed = dot(along, lights[i].frame_z.xyz);
        float t = dot(to_light, lights[i].frame_z.xyz) / (speed == 0.0 ? 1e-30 : speed);
        vec3 at = along * t - to_light;
        vec2 beyond = abs(vec2(dot(at, lights[i].frame_x.xyz), dot(at, lights[i].frame_y.xyz)))
            - vec2(lights[i].frame_x.w, lights[i].frame_y.w);
        bool meets = t > 0.0 && rect_side(lights[i], to_light) != 0.0 && max(beyond.x, beyond.y) < 0.0;
#ifdef HAS_LIGHT_IMAGES
        vec3 radiance = lights[i].color.rgb * image_at(lights[i], at, RAY_LEVEL);
        bool takes = replaces(meets ? luminance(radiance) : 0.0, total, pick);
        meets_proxies = takes ? image_layer(lights[i]) >= 0.0 : meets_proxies;
        reach = takes ? t : reach;
        light += meets ? radiance : vec3(0.0);
#else
        bool takes = meets && t < reach;
        reach = takes ? t : reach;
        light = takes ? lights[i].color.rgb : light;
#endif
    } while (++i < LIGHT_COUNT);
    light *= lobe.albedo * lobe.compensation * lobe.f0;
    return LightSample(along * reach, light, meets_proxies);
}
#endif
#endif

struct ShadowRay {
    vec4 vector;  // as out_vector
    vec4 light;   // as out_light
    vec4 known;   // as out_known
    vec2 lesson;  // as out_lesson
};

ShadowRay shadow_ray(ivec2 texel, Receiver r)
{
    vec3 s = sequence(texel);

    // One source in proportion to its unshadowed light: each replaces the one before it with its share of the sum so far.
    float total = 0.0, part = 0.0, choice = s.x, arriving = 0.0;
    int chosen = -1;
    vec3 of_lights = vec3(0.0), of_chosen = vec3(0.0);
#ifdef HAS_TRACED_LIGHT
    int i = LIGHT_COUNT;
#ifdef GUIDES_LIGHTS
    int row = guide_row(texel);
#endif
    do {
        vec3 light = traced_irradiance(lights[--i], r.p, r.n);
        float brightness = luminance(light), target = brightness;
#ifdef GUIDES_LIGHTS
        target *= texelFetch(light_guide, ivec2(i, row), 0).r;
#endif
        of_lights += light;
        arriving += brightness;
        bool take = replaces(target, total, choice);
        chosen = take ? i : chosen;
        part = take ? target : part;
        of_chosen = take ? light : of_chosen;
    } while (i > MAPPED_COUNT);
#endif
    bool to_sky = false;
#ifdef HAS_SKY_STRATA
    vec3 unshadowed = unshadowed_sky_irradiance(r.n);
    float sky = luminance(unshadowed);
#ifdef GUIDE_PARTS
    float whole_sky = sky;
    sky *= visible_share(texel);
#endif
    arriving += sky;
    to_sky = replaces(sky, total, choice);
    part = to_sky ? sky : part;
#endif
    LightSample ray = LightSample(r.n, vec3(0.0), false);
#ifdef HAS_TRACED_LIGHT
    if (chosen >= 0 && !to_sky) ray = sample_light(lights[chosen], r.p, r.n, s.yz);
#endif
#ifdef HAS_SKY_STRATA
    vec2 at = vec2(0.0);
    if (to_sky) ray = sample_sky(texel, r.n, s.yz, choice, at);
#endif
    float inverse_chance = total / max(part, LUMINANCE_FLOOR);
    ray.light *= inverse_chance;
    bool wanted = r.is_surface && total > 0.0 && max(max(ray.light.r, ray.light.g), ray.light.b) > 0.0
        && is_finite(dot(ray.light, vec3(1.0)) + dot(ray.vector, vec3(1.0)));
    // A ray into the surface meets it at once.
    bool free = dot(ray.vector, r.face) > 0.0;
    float kind = ray.meets_proxies ? 2.0 : 1.0, none = 0.0;
#ifdef GUIDE_PARTS
    kind = to_sky ? 3.0 + float(part_of(at)) : kind;
    none = to_sky ? -1.0 : 0.0;
#endif
    ShadowRay result = ShadowRay(
        vec4((ray.vector + r.p - r.origin) * SHORTENED, wanted && free ? kind : none),
        wanted ? vec4(min(ray.light, MAX_WEIGHED * HALF_MAX), 0.0) : vec4(0.0),
        vec4(0.0), vec2(-1.0, 0.0));
    // Guided samples say little of what is hidden, so what is known stands for them.
#ifdef GUIDES_LIGHTS
    float guided = texelFetch(light_guide, ivec2(LIGHT_COUNT, row), 0).r;
    vec3 from_light = to_sky ? vec3(0.0) : result.light.rgb;
    if (r.is_surface && guided > 0.0) result.known.rgb += guided * of_lights - from_light;
    if (r.is_surface && chosen >= 0 && !to_sky)
        result.lesson = vec2(chosen, min(luminance(of_chosen) * inverse_chance, MAX_WEIGHED * HALF_MAX));
#endif
#ifdef GUIDE_PARTS
    vec3 from_sky = to_sky ? result.light.rgb : vec3(0.0);
    if (r.is_surface) result.known += vec4(guides_to_sky(texel) ? unshadowed - from_sky : vec3(0.0), whole_sky);
#endif
#ifdef SPECULAR_RAYS
    Lobe lobe = specular_lobe(r.p, r.n, texelFetch(specular_roughness, r.pixel, 0));
    vec2 of_specular = specular_sequence(texel);
    LightSample highlight = LightSample(r.n, vec3(0.0), false);
#ifdef HAS_TRACED_SPHERE
    highlight = sample_highlight(r, lobe, of_specular, arriving);
#endif
#ifdef HAS_TRACED_RECT
    LightSample mirrored = sample_mirrored(r, lobe, of_specular);
    if (luminance(mirrored.light) > 0.0) highlight = mirrored;
#endif
    float brightness = luminance(highlight.light);
    bool has_turn = ((sample_index + texel.x + texel.y) & 1) == 1;
    if (has_turn && r.is_surface && brightness > 0.0 && is_finite(dot(highlight.vector, vec3(1.0)) + brightness)) {
        bool is_clear = dot(highlight.vector, r.face) > 0.0;
        result.vector = vec4((highlight.vector + r.p - r.origin) * SHORTENED, !is_clear ? 0.0 : highlight.meets_proxies ? 2.0 : 1.0);
        result.light = vec4(vec3(0.0), min(brightness, HALF_MAX));
        result.lesson.x = -1.0;
        result.known.rgb = vec3(0.0);
    }
#endif
    return result;
}

#ifdef RAYS_HERE
float visibility(Receiver r, vec4 vector)
{
    return vector.a > 0.0 && !is_occluded(r.origin + local_eye, vector.xyz, vector.a > 1.0) ? 1.0 : 0.0;
}
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
#ifdef RAYS_HERE
    vec4 visible = vec4(0.0), unshadowed = vec4(0.0);
    float first_sky = 0.0, specular_rays = 0.0, specular_square = 0.0, square = 0.0;
    uint lessons[MAX_LESSONS];
    for (int i = 0; i < MAX_LESSONS; ++i) lessons[i] = 0u;
    for (sample_index = first_sample; sample_index < first_sample + sample_count; ++sample_index) {
        Receiver r = receiver(texel);
        ShadowRay ray = shadow_ray(texel, r);
        float seen = visibility(r, ray.vector), kind = ray.vector.a, brightness = luminance(ray.light.rgb);
        visible += ray.light * seen;
        unshadowed += ray.light + vec4(ray.known.rgb, 0.0);
        square += brightness * brightness * seen;
        specular_rays += ray.light.a > 0.0 ? 1.0 : 0.0;
        specular_square += ray.light.a * ray.light.a;
        first_sky = sample_index == first_sample ? ray.known.a : first_sky;
        uint part = seen > 0.0 && kind >= 3.0 ? uint(kind) - 2u : 0u;
        lessons[min(sample_index - first_sample, MAX_LESSONS - 1)] = (ray.light.a == 0.0 ? 1u << 31u : 0u) | part << 16u
            | packHalf2x16(vec2(min(brightness / max(first_sky, LUMINANCE_FLOOR), HALF_MAX), 0.0));
    }
    float samples = float(sample_count) - specular_rays, inverse = 1.0 / max(samples, 1.0);
    float mean = max(luminance(unshadowed.rgb) * inverse, LUMINANCE_FLOOR);
    out_visible = vec4(visible.rgb * inverse, samples);
    out_unshadowed = vec4(unshadowed.rgb * inverse, min(square * inverse / mean / mean, MAX_SQUARE));
#ifdef SPECULAR_RAYS
    out_specular = vec4(vec3(visible.a, unshadowed.a, specular_square) / max(specular_rays, 1.0), specular_rays);
#endif
#ifdef WRITE_LESSONS
    out_lessons_0 = uvec4(floatBitsToUint(first_sky), lessons[0], lessons[1], lessons[2]);
    out_lessons_1 = uvec4(lessons[3], lessons[4], lessons[5], lessons[6]);
    out_lessons_2 = uvec4(lessons[7], 0u, 0u, 0u);
#endif
#else
    Receiver r = receiver(texel);
    ShadowRay ray = shadow_ray(texel, r);
    out_origin = vec4(r.origin, 0.0);
    out_vector = ray.vector;
    out_light = ray.light;
#ifdef GUIDE_TILE
    out_known = ray.known;
#endif
#ifdef GUIDES_LIGHTS
    out_lesson = ray.lesson;
#endif
#endif
}
