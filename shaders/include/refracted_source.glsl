// Where the light comes from that passes a layer. Through a volume of glass the ray is refracted where it enters and where it
// leaves, and followed on the screen: inside to the nearest back, outside to what the picture shows (after Wyman 2005, "An
// approximate image-space approach for interactive refraction").
#include "numbers.glsl"
#include "camera.glsl"
#include "projection.glsl"
#include "grid.glsl"
#include "noise.glsl"

const int VOLUME_STEPS = 16;       // of a ray through a volume
const int HALVINGS = 5;            // of a step that meets something
const int MAX_HITS = 2;            // of such steps
const float PASSED = 0.2;          // of the volume's depth, behind which a ray has passed something
const float CROSSING = 0.25;       // of that distance, up to which it meets a surface after all halvings
const float LEAVES = 2.0;          // share of the way of a ray that meets nothing
const int EXIT_STEPS = 28;         // from a layer to where a ray leaves the volume; they grow from a pixel's width
const float EXIT_HEIGHTS = 2.0;    // of the image, that they reach at least,
const float EXIT_DEPTHS = 4.0;     // and times as far as the volume is deep at the pixel
const int EXIT_HALVINGS = 6;
const float MIN_STEEP = 0.02;      // cosine of a ray to the normal of a plane that it is said to meet
const int OUTSIDE_STEPS = 24;      // likewise of what has left it
const float OUTSIDE_REACH = 64.0;  // times depth_scale
const int OUTSIDE_HALVINGS = 8;
const float MAX_GRAZING = 4.0;     // depth behind what a step crosses, in lengths of the step
const float OUTSIDE_CROSSING = 0.03;
const float MIN_FORWARD = 0.05;    // along the view, of directions that the picture shows
const float MAX_BESIDE = 0.05;     // of the image's size, up to which its edge stands for what is beside it
const float WITHIN = 0.95;         // share of the way through a volume on which a ray meets things in it, not what it stands on
const float TOUCHING = 0.05;       // of a volume's depth, within which what is behind touches it
const float FAR = 1e4;             // times depth_scale

#ifdef HAS_EXIT
uniform sampler2D exit;        // of the volume behind the layer: normal in camera space, away from the viewer; a: depth
uniform sampler2D volume;      // extinction times depth_scale
#ifdef HAS_NEXT_DEPTH
uniform sampler2D next_depth;  // of the layer behind
#endif
#endif

vec2 inside_image(vec2 pixel) { return clamp(pixel, vec2(0.5), image.xy - 0.5); }

ivec2 texel_at(vec2 pixel) { return ivec2(inside_image(pixel)); }

// Where the light comes from that passes a layer at depth d.
struct Source {
    vec2 pixel;      // may be outside the image
    float nearest;   // depth; what is nearer is not seen there
    vec3 tint;       // share that the volume lets pass
    bool is_known;   // whether the pixel shows it
    vec3 along;      // direction of what it does not show, in camera space
};

#ifdef HAS_EXIT
// Depth of the layer at a texel if it is no volume and behind nearest: a thing beside the glass, not before it; else 0.
float depth_beside(ivec2 texel, float nearest)
{
    float there = texelFetch(depth, texel, 0).r;
    return is_surface(there) && there > nearest && texelFetch(exit, texel, 0).a <= 0.0 ? there : 0.0;
}

// Of what is seen behind a layer at a pixel, another layer or what is opaque, as far as it is farther than nearest.
float depth_behind(vec2 pixel, float nearest)
{
    ivec2 t = texel_at(pixel);
    float there = texelFetch(opaque_depth, t, 0).r;
    there = is_surface(there) && there > nearest ? there : FAR * depth_scale(nearest);
#ifdef HAS_NEXT_DEPTH
    float next = texelFetch(next_depth, t, 0).r;
    there = is_surface(next) && next > nearest ? next : there;
#endif
    float beside = depth_beside(t, nearest);
    return beside > 0.0 ? beside : there;
}

// Of the ray through a volume, which starts at depth d, after a share s of its way on the screen.

float depth_inside(float d, float thick, float s)
{
#ifdef ORTHOGRAPHIC
    return d + s * thick;
#else
    return d * (d + thick) / mix(d + thick, d, s);
#endif
}

// Share of the way on screen through a volume from depth d, to a point ``aside`` and ``thick`` deeper, after which the ray
// meets a surface; LEAVES if it meets nothing.
float share_inside(float d, vec2 aside, float thick)
{
    float before = (texel_noise(gl_FragCoord.xy) - 1.0) / float(VOLUME_STEPS);
    float step_end = 0.0, met = 0.0, slack = 0.0, behind_it = 0.0;
    int halvings = 0;
    bool crosses = false;
    for (int i = 0; i < VOLUME_STEPS + 1 + MAX_HITS * HALVINGS && before < 1.0 && !crosses && thick > 0.0; ++i) {
        bool halves = halvings > 0;
        float s = halves ? 0.5 * (before + met) : min(before + 1.0 / float(VOLUME_STEPS), 1.0);
        float z = depth_inside(d, thick, s), there = depth_behind(gl_FragCoord.xy + s * aside, d);
        slack = halves ? slack : max(PASSED * thick, z - depth_inside(d, thick, before));
        bool meets = there < z && z - there < slack;
        halvings = halves ? halvings - 1 : meets ? HALVINGS : 0;
        step_end = halves ? step_end : s;
        met = meets ? s : met;
        behind_it = meets ? z - there : behind_it;
        before = meets ? before : s;
        // Behind an outline the distance to what the ray passes stays; where it crosses a surface, it shrinks.
        bool is_last = halves && halvings == 0;
        crosses = is_last && behind_it < CROSSING * slack;
        before = is_last ? step_end : before;
    }
    return crosses ? met : LEAVES;
}

// Also of points beside the image.
vec2 pixel_of(vec3 at)
{
    return project(at, lens.xy, lens.zw).xy;
}

// Whether a ray that has entered a volume at the layer is still inside at a point.
bool is_inside(vec3 at)
{
    return -at.z > 0.0 && -at.z < texelFetch(exit, texel_at(pixel_of(at)), 0).a;
}

// Factor between steps that grow from first to last.
float stride(float first, float last, int steps)
{
    return exp2(log2(max(last / first, 2.0)) / float(steps - 1));
}

// Length of a ray from the layer to where it leaves the volume, whose back is ``deep`` behind the layer at its pixel.
float length_inside(vec3 at, vec3 along, float deep)
{
    float inside = 0.0, outside = pixel_width(-at.z);
    float growth = stride(outside, max(EXIT_HEIGHTS * image.y * outside, EXIT_DEPTHS * deep), EXIT_STEPS);
    int i = 0;
    do {
        bool goes_on = is_inside(at + outside * along);
        inside = goes_on ? outside : inside;
        outside = goes_on ? growth * outside : outside;
        i = goes_on ? i + 1 : EXIT_STEPS;
    } while (i < EXIT_STEPS);
    for (int k = 0; k < EXIT_HALVINGS; ++k) {
        float middle = 0.5 * (inside + outside);
        bool goes_on = is_inside(at + middle * along);
        inside = goes_on ? middle : inside;
        outside = goes_on ? outside : middle;
    }
    // Depths of texels are steps; the planes through them are not.
    ivec2 texel = texel_at(pixel_of(at + inside * along));
    vec4 back = texelFetch(exit, texel, 0);
    float steep = dot(back.xyz, along);
    float way = dot(back.xyz, view_point(vec2(texel) + 0.5, back.a) - at) / max(steep, MIN_STEEP);
    return steep > MIN_STEEP ? clamp(way, 0.0, 2.0 * outside) : inside;
}

// Normal of the back, away from the viewer, between the four texels around a pixel.
vec3 back_normal(vec2 pixel)
{
    vec2 first = floor(pixel - 0.5), part = pixel - 0.5 - first;
    vec3 sum = vec3(0.0);
    for (int i = 0; i < 4; ++i) {
        vec2 corner = vec2(i & 1, i >> 1), weight = mix(1.0 - part, part, corner);
        vec4 back = texelFetch(exit, texel_at(first + corner + 0.5), 0);
        sum += back.a > 0.0 ? weight.x * weight.y * back.xyz : vec3(0.0);
    }
    return sum * inversesqrt(max(dot(sum, sum), 1e-30));
}

// What a ray sees that leaves a volume at a point, behind nearest; what is nearer than gap behind that point touches it.
Source seen_outside(vec3 at, vec3 along, float nearest, float gap)
{
    Source source = Source(pixel_of(at), nearest, vec3(1.0), true, along);
#ifdef HAS_NEXT_DEPTH
    float next = texelFetch(next_depth, texel_at(source.pixel), 0).r;  // as a liquid begins where its glass ends
    if (is_surface(next) && next < -at.z + gap) return source;
#endif
    float width = pixel_width(-at.z), reach = OUTSIDE_REACH * depth_scale(-at.z), growth = stride(width, reach, OUTSIDE_STEPS);
    float before = 0.0, step_end = 0.0, met = 0.0, slack = 0.0, behind_it = 0.0;
    int halvings = 0;
    bool crosses = false;
    for (int i = 0; i < OUTSIDE_STEPS + MAX_HITS * OUTSIDE_HALVINGS && before < reach && !crosses; ++i) {
        bool halves = halvings > 0;
        float way = halves ? 0.5 * (before + met) : max(growth * before, width);
        vec3 there = at + way * along;
        float deeper = -there.z - depth_behind(pixel_of(there), nearest);
        slack = halves ? slack : MAX_GRAZING * (way - before);
        bool meets = there.z < 0.0 && deeper > 0.0 && deeper < slack;
        halvings = halves ? halvings - 1 : meets ? OUTSIDE_HALVINGS : 0;
        step_end = halves ? step_end : way;
        met = meets ? way : met;
        behind_it = meets ? deeper : behind_it;
        before = meets ? before : way;
        bool is_last = halves && halvings == 0;  // as in share_inside
        crosses = is_last && behind_it < OUTSIDE_CROSSING * slack;
        before = is_last ? step_end : before;
    }
    source.pixel = pixel_of(at + (crosses ? met : FAR * depth_scale(-at.z)) * along);
    vec2 beside = abs(source.pixel - inside_image(source.pixel)) * image.zw;
    source.is_known = along.z < -MIN_FORWARD && max(beside.x, beside.y) < MAX_BESIDE;
    return source;
}

// As texels of the layer and of its volume tell; ``from`` is that of the texture ``refraction``.
Source refracted(float d, vec4 from)
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 at = view_point(gl_FragCoord.xy, d), view = normalize(view_ray(gl_FragCoord.xy));
    vec3 n = mat3(view_from_relative) * sanitize_normal(texelFetch(normal, texel, 0).xyz);
    float ior = max(from.x, 1.0), back_depth = texelFetch(exit, texel, 0).a;
    bool has_exit = back_depth > d;  // otherwise the nominal thickness counts
    vec3 along = refract(view, n, 1.0 / ior);
    float way = from.y * depth_scale(d);
    if (has_exit) way = length_inside(at, along, back_depth - d);
    vec3 end = at + way * along, last = has_exit ? at + WITHIN * way * along : end;
    vec2 aside = pixel_of(last) - gl_FragCoord.xy;
    float deep = -end.z - d, to_last = -last.z - d, s = share_inside(d, aside, to_last);
    bool meets = s < LEAVES;
    Source source = Source(gl_FragCoord.xy + min(s, 1.0) * aside, meets ? d : d + deep, vec3(1.0), true, along);
    if (meets) {
        way *= (depth_inside(d, to_last, s) - d) / deep;
    } else if (has_exit) {
        vec3 back = back_normal(pixel_of(end)), outward = refract(along, -back, ior);
        // What is totally reflected leaves as far from there, by a surface as parallel as to that where it entered.
        bool is_total = dot(outward, outward) <= 0.0;
        end += is_total ? way * reflect(along, back) : vec3(0.0);
        outward = is_total ? reflect(view, back) : outward;
        way *= is_total ? 2.0 : 1.0;
        source = seen_outside(end, outward, d + 0.5 * deep, is_total ? 0.0 : TOUCHING * deep);
    }
    source.tint = exp(-texelFetch(volume, texel, 0).rgb * (way / depth_scale(d)));
    return source;
}
#endif
