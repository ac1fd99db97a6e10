// The Khronos PBR Neutral tone mapper (specification 1.0, 2024): linear values to linear values from 0 to 1.
const float NEUTRAL_F90 = 0.04;                             // reflectance that is taken away
const float NEUTRAL_START = 0.8 - NEUTRAL_F90;              // of the compression of highlights
const float NEUTRAL_DESATURATION = 0.15;

vec3 pbr_neutral(vec3 x)
{
    float low = min(x.r, min(x.g, x.b));
    x -= low < 2.0 * NEUTRAL_F90 ? low - low * low / (4.0 * NEUTRAL_F90) : NEUTRAL_F90;
    float peak = max(x.r, max(x.g, x.b));
    float room = 1.0 - NEUTRAL_START;
    float compressed = 1.0 - room * room / (max(peak, NEUTRAL_START) + room - NEUTRAL_START);
    vec3 scaled = x * (compressed / max(peak, NEUTRAL_START));
    float grey = 1.0 - 1.0 / (NEUTRAL_DESATURATION * (peak - compressed) + 1.0);
    return peak < NEUTRAL_START ? x : mix(scaled, vec3(compressed), grey);
}
