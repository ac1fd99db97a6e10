// A level of the pyramid that rough glass blurs by, from the level below: the mean light of four texels, and the depth of the
// nearest opaque surface among them.
#include "numbers.glsl"

uniform sampler2D below_light;  // times a; a: the share of the texel that is inside the picture
uniform sampler2D below_depth;
uniform int below;              // level that is read

layout(local_size_x = 8, local_size_y = 8) in;
layout(rgba16f, binding = 0) writeonly uniform image2D level_light;
layout(r32f, binding = 1) writeonly uniform image2D level_depth;

const float FAR = 1e30;  // depth of nothing

void main()
{
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(below_light, below);
    vec4 sum = vec4(0.0);
    float nearest = FAR;
    for (int i = 0; i < 4; ++i) {
        ivec2 t = 2 * texel + ivec2(i & 1, i >> 1);
        if (all(lessThan(t, size))) {
            vec4 light = texelFetch(below_light, t, below);
            float depth = texelFetch(below_depth, t, below).r;
#ifdef FINEST
            light = vec4(sanitize_radiance(light.rgb), 1.0);
#endif
            sum += light;
            nearest = is_surface(depth) ? min(nearest, depth) : nearest;
        }
    }
    if (all(lessThan(texel, imageSize(level_light)))) {
        imageStore(level_light, texel, 0.25 * sum);
        imageStore(level_depth, texel, vec4(nearest));
    }
}
