// Light that a network has written, NCHW and top row first, as a texture.
#include "numbers.glsl"
#ifdef HAS_MEAN
#include "mean_radiance.glsl"
#endif

const float MIN_NORMAL_HALF = 6.103515625e-5;

layout(std430, binding = 4) readonly buffer Light { float light[]; };

uniform ivec2 grid;    // width and height of the texture
uniform ivec2 padded;  // of the tensor
uniform int row;       // of red in the tensor

layout(location = 0) out vec4 out_light;

// The nearest half float, as some drivers only cut off what a target of half floats does not hold.
vec3 round_to_half(vec3 c)
{
    uvec3 bits = floatBitsToUint(c);
    vec3 normal = uintBitsToFloat((bits + 0xFFFu + ((bits >> 13) & 1u)) & ~0x1FFFu);
    precise vec3 subnormal = (c + 0.5) - 0.5;  // single floats next to 0.5 are as far apart as halves that are subnormal
    return mix(normal, subnormal, lessThan(c, vec3(MIN_NORMAL_HALF)));
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
    int plane = padded.x * padded.y, at = row * plane + (grid.y - 1 - low.y) * padded.x + low.x;
    vec3 found = sanitize_radiance(vec3(light[at], light[at + plane], light[at + 2 * plane]));
#ifdef HAS_MEAN
    found = min(found * means[1], HALF_MAX);
#endif
    out_light = vec4(round_to_half(found), 1.0);
}
