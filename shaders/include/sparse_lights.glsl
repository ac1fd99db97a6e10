// Highlights of lights that stand for surfaces far smaller than they, such as a neon sign or many bulbs: those of parts of these
// surfaces, by the tree of their points, as fine as the lobe tells them apart. A part is a point, seen by a lobe whose slopes vary by
// as much more as its points are spread: where within it they are is not known, so its highlight has no edge.
#include "lights.glsl"
#include "ggx.glsl"
#include "noise.glsl"

#ifdef HAS_SPARSE_LIGHT
const float TOLD_APART = 0.5;  // size of a part, of the lobe's width at its distance
const float BLURS = 0.25;      // of the distance by which the mirrored ray misses a light, what counts as width
const float MAX_WIDTH = 0.05;  // of the distance

uniform sampler2D emission_points;  // as in light_sampling.glsl

// Intensity towards a point.
vec3 sparse_intensity(Light light, vec3 to_light)
{
#ifdef HAS_RECT_LIGHT
    if (int(light.color.w) == RECT) {
        float area = 4.0 * light.frame_x.w * light.frame_y.w;
        return light.color.rgb * area * max(dot(normalize(to_light), light.frame_z.xyz) * rect_side(light, to_light), 0.0);
    }
#endif
    return light.color.rgb;
}

// As ggx_specular, by one of two levels of the tree, which TAA mixes.
vec3 sparse_specular(Light light, vec3 p, vec3 n, Lobe lobe)
{
    int row = int(light.tile.x);
    vec4 root = texelFetch(emission_points, ivec2(1, row + 3), 0);
    vec3 to_light = light.position.xyz - p, to_middle = to_light + root.xyz, mirrored = reflect(-lobe.v, n);
    float size = sqrt(root.w), away = length(to_middle - mirrored * max(dot(to_middle, mirrored), 0.0));
    float distance = length(to_middle);
    float width = min(lobe.alpha * distance + BLURS * max(away - 2.0 * size, 0.0), MAX_WIDTH * distance);
    float level = log2(max(size / max(TOLD_APART * width, 1e-30), 1.0)) + texel_noise(gl_FragCoord.xy);
    int node = 1 << int(clamp(level, 0.0, float(POINT_LEVELS))), end = 2 * node;
    Light part = light;
    Lobe spread = lobe;
    vec3 intensity = sparse_intensity(light, to_light), sum = vec3(0.0);
    do {
        vec4 ball = texelFetch(emission_points, ivec2(node, row + 3), 0);
        vec3 to_part = to_light + ball.xyz;
        float solid_angle = 2.0 * PI * ball.w / max(dot(to_part, to_part), 1e-12);  // of a disc with that mean square radius
        spread.alpha = min(sqrt(lobe.alpha * lobe.alpha + solid_angle / (8.0 * PI)), 1.0);
        part.position = vec4(light.position.xyz + ball.xyz, 0.0);
        part.color = vec4(intensity * texelFetch(emission_points, ivec2(node, row + 4), 0).rgb, float(POINT));
        vec3 most = part.color.rgb * lobe.compensation * lobe.albedo / max(dot(to_part, to_part) * solid_angle, 1e-12);
        sum += min(ggx_specular(part, p, n, spread), most);
    } while (++node < end);
    return sum;
}

// Of all sparse lights.
vec3 sparse_specular(vec3 p, vec3 n, Lobe lobe, bool is_shiny)
{
    vec3 sum = vec3(0.0);
    int i = SPARSE_BEGIN, sparse_end = is_shiny ? SPARSE_END : SPARSE_BEGIN;
    do {
        sum += sparse_specular(lights[i], p, n, lobe);
    } while (++i < sparse_end);
    return is_shiny ? sum : vec3(0.0);
}
#endif

bool is_sparse(int light)
{
#ifdef HAS_SPARSE_LIGHT
    return light >= SPARSE_BEGIN && light < SPARSE_END;
#else
    return false;
#endif
}
