// Indirect light of one bounce from what the screen shows, by "Screen Space Indirect Lighting with Visibility
// Bitmask" (Therrien, Levesque and Gilet 2023): a walk over the image in one direction looks at half a plane through
// the eye and the receiver; what it meets fills sectors of that half-plane, and lights by those that were empty.
// Different from the paper: sectors are equal shares of the cosine-weighted integral (as in Jimenez et al. 2016,
// "Practical Realtime Strategies for Accurate Indirect Occlusion"), so that constant radiance all around gives itself;
// a sample stands for its whole stretch of the walk, so that few steps leave no gaps; and a texel walks in one
// direction only, since ssgi_filter gathers those of its neighbours.
#include "numbers.glsl"
#include "grid.glsl"
#include "noise.glsl"
#include "nearest_texel.glsl"

const float THICKNESS = 0.1;  // of everything, away from the eye, relative to its depth_scale
const float CREASE = 0.01;    // relative to depth_scale: surfaces join unless one lies farther than this behind the other
const float MAX_DEPTH_RATIO = 2.0;  // between a stretch's ends and its sample
const float SECTORS = 32.0;

uniform sampler2D lowres_gbuffer;
uniform sampler2D ssgi_radiance;
uniform vec2 ratio;      // full-resolution texels per low-resolution texel
uniform vec2 noise_offset;  // of the two noise patterns in this frame
uniform int steps = 16;  // no constant, so that the loop stays a loop

layout(location = WRITE_SSGI_WALKS) out vec4 out_walk;  // rgb: light times a, a: weight of the half-plane

// Places in the half-plane are relative to the receiver: x along the walk, y towards the eye.
struct HalfPlane {
    vec2 normal;    // the receiver's, projected and normalised
    float inverse;  // 1 / integral over all directions above the receiver
};

// The part, 0 to 1, of what the receiver sees in the half-plane that lies between the direction to the eye and the one
// to a place: over angles t from the former, with the normal at n, the integral of cos(t - n) sin t.
float part_before(HalfPlane h, vec2 place)
{
    vec2 to = place * inversesqrt(max(dot(place, place), 1e-30));  // sine, cosine
    float integral = 0.5 * (to.x * (to.x * h.normal.y - to.y * h.normal.x) + acos(clamp(to.y, -1.0, 1.0)) * h.normal.x);
    return dot(to, h.normal) > 0.0 ? clamp(integral * h.inverse, 0.0, 1.0) : 1.0;
}

// Sectors up to a part; noise rounds it, so that thin surfaces count right on average.
uint sectors_before(float part, float noise)
{
    float count = floor(part * SECTORS + noise);
    return count < SECTORS ? (1u << uint(count)) - 1u : 0xffffffffu;
}

// Whether place a is closer to the direction to the eye than b.
bool is_before(vec2 a, vec2 b)
{
    return a.x * b.y < a.y * b.x;
}

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy), last = textureSize(lowres_gbuffer, 0) - 1;
    vec4 here = texelFetch(lowres_gbuffer, texel, 0);
    float d = is_surface(here.a) ? here.a : 1.0;
    vec3 n = sanitize_normal(here.xyz);
    vec2 pixel = vec2(nearest_texel(texel, ratio)) + 0.5;
    vec3 view = view_ray(pixel), ray = relative_from_view(view), p = surface_point(pixel, d);

    // The walk's direction, uniform around the direction to the eye.
    float noise = fract(texel_noise(vec2(texel)) + noise_offset.x);
    float jitter = fract(texel_noise(vec2(texel.y, last.x - texel.x)) + noise_offset.y), rounding = fract(noise + jitter);
    vec3 to_eye = -normalize(view), side = normalize(vec3(view.z, 0.0, -view.x));
    vec3 along = cos(2.0 * PI * noise) * side + sin(2.0 * PI * noise) * cross(to_eye, side);
    vec2 walk = normalize((along.xy + view.xy * along.z) / lens.xy * image.xy);
    vec2 borders = mix(pixel, image.xy - pixel, greaterThan(walk, vec2(0.0))) / max(abs(walk), 1e-6);
    float reach = min(borders.x, borders.y);

    // The ray to the point x pixels along the walk is ray + x * bend; if ORTHOGRAPHIC, it is ray, from x * bend on.
    vec3 bend_view = vec3(walk * image.zw * lens.xy * 2.0, 0.0), bend = relative_from_view(bend_view);
    vec2 slope = vec2(dot(bend_view, along), dot(bend_view, to_eye));
    float eye = length(view);

    vec2 projected = vec2(dot(n, relative_from_view(along)), max(dot(n, relative_from_view(to_eye)), 1e-3));
    float shortened = length(projected);
    HalfPlane h = HalfPlane(projected / shortened, 0.0);
    float whole = 0.5 * (h.normal.y + acos(clamp(-h.normal.x, -1.0, 1.0)) * h.normal.x);
    h.inverse = 1.0 / max(whole, 1e-5);

    uint filled = 0u;
    vec3 sum = vec3(0.0);
    // The surface before, at first the receiver's own: point, normal, and place where its stretch ends.
    vec3 old_point = p, old_normal = n;
    vec2 old_end = vec2(h.normal.y, -h.normal.x);
    bool old_surface = true;
    float start = 0.0;
    for (int i = 0; i < steps; ++i) {
        float at = (float(i) + jitter) / float(steps), end = i + 1 < steps ? at + 0.5 / float(steps) : 1.0;
        vec2 stretch = vec2(start, min(reach * end * end, reach));
        ivec2 t = clamp(ivec2((pixel + walk * (reach * at * at)) / ratio), ivec2(0), last);
        vec4 there = texelFetch(lowres_gbuffer, t, 0);
        vec3 light = texelFetch(ssgi_radiance, t, 0).rgb;
        vec3 point = surface_point(vec2(nearest_texel(t, ratio)) + 0.5, there.a);

        // Depths where the sample's plane crosses the ends of its stretch.
        float plane = dot(there.xyz, point);
#ifdef ORTHOGRAPHIC
        vec2 depths = d + (dot(there.xyz, point - p) - dot(there.xyz, bend) * stretch) / min(dot(there.xyz, ray), -1e-20);
        depths = clamp(depths, there.a - depth_scale(there.a), there.a + depth_scale(there.a));
        vec2 begin = vec2(0.0, d - depths.x) + stretch.x * slope, finish = vec2(0.0, d - depths.y) + stretch.y * slope;
#else
        vec2 facing = dot(there.xyz, ray) + dot(there.xyz, bend) * stretch;
        vec2 depths = plane < 0.0 ? plane / min(facing, -1e-20) : vec2(there.a);
        depths = clamp(depths, there.a / MAX_DEPTH_RATIO, there.a * MAX_DEPTH_RATIO);
        vec2 begin = vec2(0.0, eye * (d - depths.x)) + depths.x * stretch.x * slope;
        vec2 finish = vec2(0.0, eye * (d - depths.y)) + depths.y * stretch.y * slope;
#endif
        // Surfaces that meet leave no gap.
        vec3 chord = point - old_point;
        bool joined = old_surface && max(dot(there.xyz, chord), -dot(old_normal, chord)) <= CREASE * depth_scale(there.a);
        begin = joined ? old_end : begin;

        // Both ends have a front and a back; all sectors between the outermost of the four are filled.
        vec2 thick = vec2(0.0, THICKNESS * depth_scale(there.a));
        vec2 begin_back = joined && i == 0 ? begin : begin - thick, finish_back = finish - thick;
        float nearest = part_before(h, is_before(begin, finish) ? begin : finish);
        float farthest = part_before(h, is_before(begin_back, finish_back) ? finish_back : begin_back);
        uint sectors = sectors_before(farthest, rounding) & ~sectors_before(nearest, rounding) & ~filled;
        sectors = there.a > 0.0 ? sectors : 0u;
        filled |= sectors;
        sum += dot(there.xyz, point - p) < 0.0 ? light * float(bitCount(sectors)) : vec3(0.0);

        old_point = point;
        old_normal = there.xyz;
        old_end = finish;
        old_surface = there.a > 0.0;
        start = stretch.y;
    }
    float weight = shortened * whole;
    out_walk = is_surface(here.a) ? vec4(sanitize_radiance(sum * (weight / SECTORS)), weight) : vec4(0.0);
}
