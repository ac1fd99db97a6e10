const float SHARPNESS = 0.65;  // of the history's cubic filter; 0.5 is Catmull-Rom, which blurs moving textures
// Brightest over darkest texel, between which the darkest more and more bounds the result: beside a lamp the lobes would leave
// nothing of a wall.
const float CONTRAST = 4.0, HIGH_CONTRAST = 12.0;

// Cubic convolution (Keys 1981) as one bilinear fetch of the middle four texels and the four beside them, corners left
// out (after Jimenez 2016, "Filmic SMAA"); its lobes may make it negative. a: not filtered. size: width, height, 1/width,
// 1/height.
vec4 filter_history(sampler2D history, vec2 at, vec4 size)
{
    vec2 centre = floor(at - 0.5) + 0.5;
    vec2 f = at - centre;
    vec2 w0 = -SHARPNESS * f * (1.0 - f) * (1.0 - f);
    vec2 w1 = 1.0 + f * f * ((2.0 - SHARPNESS) * f - (3.0 - SHARPNESS));
    vec2 w3 = -SHARPNESS * f * f * (1.0 - f);
    vec2 w12 = 1.0 - w0 - w3;
    vec2 middle = centre + (w12 - w1) / w12;
    ivec2 c = ivec2(middle), last = ivec2(size.xy) - 1;
    ivec2 low = max(ivec2(centre) - 1, 0), high = min(ivec2(centre) + 2, last);
    c = clamp(c, ivec2(0), last);
    vec4 four = textureLod(history, middle * size.zw, 0.0);
    vec3 below = texelFetch(history, ivec2(c.x, low.y), 0).rgb, above = texelFetch(history, ivec2(c.x, high.y), 0).rgb;
    vec3 left = texelFetch(history, ivec2(low.x, c.y), 0).rgb, right = texelFetch(history, ivec2(high.x, c.y), 0).rgb;
    vec4 sum = vec4(four.rgb, 1.0) * (w12.x * w12.y) + vec4(below, 1.0) * (w12.x * w0.y) + vec4(above, 1.0) * (w12.x * w3.y)
        + vec4(left, 1.0) * (w0.x * w12.y) + vec4(right, 1.0) * (w3.x * w12.y);
    vec3 darkest = min(four.rgb, min(min(below, above), min(left, right)));
    vec3 brightest = max(four.rgb, max(max(below, above), max(left, right)));
    vec3 bounded = smoothstep(CONTRAST, HIGH_CONTRAST, brightest / max(darkest, 1e-6));
    vec3 filtered = sum.rgb / sum.a;
    return vec4(filtered + max(bounded * darkest - filtered, 0.0), four.a);  // what is no number stays none
}
