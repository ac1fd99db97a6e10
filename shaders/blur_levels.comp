// A level of the pyramid that rough glass blurs by, from the level below: the mean light of four texels, and the depth of the
// nearest opaque surface among them.
#include "numbers.glsl"
#include "blur_level.glsl"

uniform sampler2D below_light;  // times a; a: the share of the texel that is inside the picture
uniform sampler2D below_depth;
uniform int level;

layout(local_size_x = 8, local_size_y = 8) in;
layout(rgba16f, binding = 0) writeonly uniform image2D all_light;
layout(r32f, binding = 1) writeonly uniform image2D all_depth;

const float FAR = 1e30;  // depth of nothing

void main()
{
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), finest = finest_size(imageSize(all_light));
#ifdef FINEST
    ivec2 corner = ivec2(0), size = textureSize(below_light, 0);
#else
    ivec2 corner = level_corner(finest, level - 1), size = level_size(finest, level - 1);
#endif
    vec4 sum = vec4(0.0);
    float nearest = FAR;
    for (int i = 0; i < 4; ++i) {
        ivec2 t = 2 * texel + ivec2(i & 1, i >> 1);
        if (all(lessThan(t, size))) {
            vec4 light = texelFetch(below_light, corner + t, 0);
            float depth = texelFetch(below_depth, corner + t, 0).r;
#ifdef FINEST
            light = vec4(sanitize_radiance(light.rgb), 1.0);
#endif
            sum += light;
            nearest = is_surface(depth) ? min(nearest, depth) : nearest;
        }
    }
    if (all(lessThan(texel, level_size(finest, level)))) {
        imageStore(all_light, level_corner(finest, level) + texel, 0.25 * sum);
        imageStore(all_depth, level_corner(finest, level) + texel, vec4(nearest));
    }
}
