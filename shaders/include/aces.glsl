// Hill's fit of the ACES 1.0 reference rendering transform with the sRGB output transform (2016; in BakingLab by Pettineo
// and Neubelt): linear Rec. 709 to linear values from 0 to 1.
const mat3 ACES_INPUT = mat3(0.59719, 0.07600, 0.02840, 0.35458, 0.90834, 0.13383, 0.04823, 0.01566, 0.83777);
const mat3 ACES_OUTPUT = mat3(1.60475, -0.10208, -0.00327, -0.53108, 1.10813, -0.07276, -0.07367, -0.00605, 1.07602);

vec3 aces(vec3 x)
{
    vec3 v = ACES_INPUT * x;
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081);
    return clamp(ACES_OUTPUT * v, 0.0, 1.0);
}
