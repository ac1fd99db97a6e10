// GGX specular light of rectangles by linearly transformed cosines, whose table scripts/fit_ltc.py fits (Heitz, Dupuy, Hill
// and Neubelt 2016, "Real-Time Polygonal-Light Shading with Linearly Transformed Cosines"). Light is clipped at the
// surface's horizon instead of the lobes', where a lobe that is seen at a grazing angle ends abruptly.
#include "lights.glsl"
#include "ggx_lobe.glsl"

// x: angle of the view, denser towards grazing; y: roughness; layers: a, b, c, w_x of each cosine; all w_z and Fresnel.
uniform sampler2DArray ltc;

const int LAST_TWO_LOBED = 13;  // column of the table, beyond which there is a third cosine
const int WEIGHTS = 3;          // the last layer
const float MIN_COSINE = 1e-3;  // of the angle of the view, as in the table's last column
const float MIN_SIDE = 1e-6;    // sine of the angle of the view; below it any plane of incidence will do

// Orthonormal rows: away from the surface within the plane of incidence; across that plane; the mirrored view.
mat3 mirror_frame(vec3 n, vec3 v, float n_v)
{
    vec3 side = v - n * dot(n, v);
    float square = dot(side, side);
    vec3 other = cross(n, abs(n.x) < 0.5 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0));
    side = square > MIN_SIDE * MIN_SIDE ? side * inversesqrt(square) : normalize(other);
    float sine = sqrt(1.0 - n_v * n_v);
    return transpose(mat3(n_v * side + sine * n, cross(n, side), n_v * n - sine * side));
}

// The specular lobe of a texel, the same for all of its lights.
struct RectLobe {
    mat3 frame;   // rows: the lobe's axes
    vec2 slopes;  // a and c of a narrow lobe, to which those of the table are relative
    vec2 at;      // position in the table
    vec4 weights; // w_z of each cosine; mean of (1 - v·h)^5 over the lobe
    int cosines;  // how many stand for the lobe
};

// Per radian within the plane of incidence and across it, of a narrow lobe.
vec2 lobe_slopes(float n_v, float alpha)
{
    float along = 0.5 / alpha;
    return vec2(along, along * inversesqrt(n_v * n_v + 0.5 * alpha * alpha * (1.0 - n_v * n_v)));
}

RectLobe rect_lobe(vec3 n, vec3 v, float alpha)
{
    float n_v = clamp(dot(n, v), MIN_COSINE, 1.0), min_roughness = sqrt(MIN_ALPHA);
    vec2 size = vec2(textureSize(ltc, 0).xy);
    vec2 share = vec2(1.0 - sqrt(1.0 - acos(n_v) / (0.5 * PI)), (sqrt(alpha) - min_roughness) / (1.0 - min_roughness));
    vec2 texel = share * (size - 1.0);
    vec2 at = (texel + 0.5) / size;
    return RectLobe(mirror_frame(n, v, n_v), lobe_slopes(n_v, alpha), at, textureLod(ltc, vec3(at, float(WEIGHTS)), 0.0),
                    texel.x > float(LAST_TWO_LOBED) ? 3 : 2);
}

// One of the cosines that stand for the lobe, index 0 to 2.
Cosine lobe_cosine(RectLobe lobe, int index)
{
    vec4 cell = textureLod(ltc, vec3(lobe.at, float(index)), 0.0);
    float a = lobe.slopes.x * cell.x, b = cell.y, c = lobe.slopes.y * cell.z;
    float w_x = cell.w, w_z = index == 0 ? lobe.weights.x : index == 1 ? lobe.weights.y : lobe.weights.z;
    // The axis: the weight times the transform's cofactors, by which normals of planes are transformed.
    return Cosine(mat3(a, 0.0, 0.0, 0.0, c, 0.0, b, 0.0, 1.0) * lobe.frame,
                  vec3(c * (w_x - b * w_z), 0.0, a * c * w_z) * lobe.frame);
}

// Radiance that the lobe reflects of a rectangle, as a share of the light's radiance, without the Fresnel term.
float rect_specular(Light light, vec3 p, vec3 n, RectLobe lobe)
{
    float sum = 0.0;
    int i = 0;
    do sum += rect_light(light, p, n, lobe_cosine(lobe, i));
    while (++i < lobe.cosines);
    return max(sum, 0.0);
}
