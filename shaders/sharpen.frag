// Contrast-limited sharpening of what temporal anti-aliasing resampled: the difference to the four neighbours is added,
// and the result stays in their range, so that edges gain no halos (after Lottes 2021, "Robust Contrast Adaptive
// Sharpening", in AMD's FSR 1). The history is not sharpened, or it would sharpen itself anew in each frame.
const float SHARPENING = 0.2;  // per resampling half a texel off in both directions
const float MAX_SHARPENING = 1.0;

uniform sampler2D taa;
uniform sampler2D resampled;  // how often the history was resampled

layout(location = WRITE_SHARPENED) out vec4 out_sharpened;

void main()
{
    ivec2 t = ivec2(gl_FragCoord.xy), last = textureSize(taa, 0) - 1;
    vec3 here = texelFetch(taa, t, 0).rgb;
    vec3 left = texelFetch(taa, ivec2(max(t.x - 1, 0), t.y), 0).rgb;
    vec3 right = texelFetch(taa, ivec2(min(t.x + 1, last.x), t.y), 0).rgb;
    vec3 below = texelFetch(taa, ivec2(t.x, max(t.y - 1, 0)), 0).rgb;
    vec3 above = texelFetch(taa, ivec2(t.x, min(t.y + 1, last.y)), 0).rgb;
    vec3 low = min(here, min(min(left, right), min(below, above)));
    vec3 high = max(here, max(max(left, right), max(below, above)));
    float strength = min(SHARPENING * texelFetch(resampled, t, 0).r, MAX_SHARPENING);
    vec3 difference = here - 0.25 * (left + right + below + above);
    out_sharpened = vec4(clamp(here + strength * difference, low, high), 1.0);
}
