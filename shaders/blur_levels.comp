// A level of the pyramid that rough glass blurs by, from the level below: the mean light of four texels, and the depth of the
// nearest opaque surface among them. What stands before the glass is not in it.
#include "numbers.glsl"
#include "blur_level.glsl"

uniform sampler2D below_light;  // times a; a: the share of the texel that is in the picture and not before the glass
uniform sampler2D below_depth;
uniform int level;

layout(local_size_x = 8, local_size_y = 8) in;
layout(rgba16f, binding = 0) writeonly uniform image2D all_light;
layout(r32f, binding = 1) writeonly uniform image2D all_depth;

const float NOTHING = 1e30;  // depth of nothing

#ifdef FINEST
uniform sampler2D glass_depth;

const int FIRST_RADIUS = 8;  // pixels to where the glass is looked for,
const int RADII = 3;         // each four times as far as the one before,
const int DIRECTIONS = 8;

// Mean depth of the glass at a texel or as near to it as it is found; 0 if it is not.
float glass_around(ivec2 texel)
{
    float own = texelFetch(glass_depth, min(texel, textureSize(glass_depth, 0) - 1), 0).r;
    vec2 sum = is_surface(own) ? vec2(own, 1.0) : vec2(0.0);
    for (int k = 0; k < RADII && sum.y == 0.0; ++k) {
        float radius = float(FIRST_RADIUS << (2 * k));
        for (int i = 0; i < DIRECTIONS; ++i) {
            float angle = 2.0 * PI * float(i) / float(DIRECTIONS);
            ivec2 t = clamp(texel + ivec2(radius * vec2(cos(angle), sin(angle))), ivec2(0), textureSize(glass_depth, 0) - 1);
            float depth = texelFetch(glass_depth, t, 0).r;
            sum += is_surface(depth) ? vec2(depth, 1.0) : vec2(0.0);
        }
    }
    return sum.x / max(sum.y, 1.0);
}
#endif

void main()
{
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), finest = finest_size(imageSize(all_light));
#ifdef FINEST
    ivec2 corner = ivec2(0), size = textureSize(below_light, 0);
    float least = glass_around(2 * texel);
#else
    ivec2 corner = level_corner(finest, level - 1), size = level_size(finest, level - 1);
#endif
    vec4 sum = vec4(0.0);
    float nearest = NOTHING;
    for (int i = 0; i < 4; ++i) {
        ivec2 t = 2 * texel + ivec2(i & 1, i >> 1);
        if (all(lessThan(t, size))) {
            vec4 light = texelFetch(below_light, corner + t, 0);
            float depth = texelFetch(below_depth, corner + t, 0).r;
#ifdef FINEST
            bool counts = !is_surface(depth) || depth > least;
            light = counts ? vec4(sanitize_radiance(light.rgb), 1.0) : vec4(0.0);
            depth = counts && is_surface(depth) ? depth : NOTHING;
#endif
            sum += light;
            nearest = min(nearest, depth);
        }
    }
    if (all(lessThan(texel, level_size(finest, level)))) {
        imageStore(all_light, level_corner(finest, level) + texel, 0.25 * sum);
        imageStore(all_depth, level_corner(finest, level) + texel, vec4(nearest));
    }
}
