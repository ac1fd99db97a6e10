// GGX specular light of rectangles by two linearly transformed cosines, whose table scripts/fit_ltc.py fits (Heitz,
// Dupuy, Hill and Neubelt 2016, "Real-Time Polygonal-Light Shading with Linearly Transformed Cosines"). Light is
// clipped at the surface's horizon instead of the lobes', where a lobe that is seen at a grazing angle ends abruptly.
#include "lights.glsl"
#include "ggx_lobe.glsl"

// x: angle of the view, denser towards grazing; y: roughness; layers: a, b, c, w_x of each lobe; both w_z and Fresnel.
uniform sampler2DArray ltc;

const float MIN_COSINE = 1e-3;  // of the angle of the view, as in the table's last column
const float MIN_SIDE = 1e-6;    // sine of the angle of the view; below it any plane of incidence will do

// The specular lobe of a texel, the same for all of its lights.
struct RectLobe {
    mat3 transform[2];  // to the space in which a lobe is a cosine
    vec3 weight[2];     // of its vector irradiance
    float fresnel;      // mean of (1 - v·h)^5
};

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

RectLobe rect_lobe(vec3 n, vec3 v, float alpha)
{
    float n_v = clamp(dot(n, v), MIN_COSINE, 1.0), min_roughness = sqrt(MIN_ALPHA);
    vec2 size = vec2(textureSize(ltc, 0).xy);
    vec2 share = vec2(1.0 - sqrt(1.0 - acos(n_v) / (0.5 * PI)), (sqrt(alpha) - min_roughness) / (1.0 - min_roughness));
    vec2 at = (share * (size - 1.0) + 0.5) / size;
    vec4 both = textureLod(ltc, vec3(at, 2.0), 0.0);
    mat3 frame = mirror_frame(n, v, n_v);
    // The slopes of a narrow lobe, to which a and c are relative.
    float along = 0.5 / alpha, across = along * inversesqrt(n_v * n_v + 0.5 * alpha * alpha * (1.0 - n_v * n_v));
    RectLobe lobe;
    for (int i = 0; i < 2; ++i) {
        vec4 cell = textureLod(ltc, vec3(at, float(i)), 0.0);
        lobe.transform[i] = mat3(along * cell.x, 0.0, 0.0, 0.0, across * cell.z, 0.0, cell.y, 0.0, 1.0) * frame;
        lobe.weight[i] = vec3(cell.w, 0.0, both[i]);
    }
    lobe.fresnel = both.z;
    return lobe;
}

// Radiance that the lobe reflects of a rectangle at relative position to_light, as a share of the light's radiance,
// without the Fresnel term.
float rect_specular(Light light, vec3 to_light, vec3 n, RectLobe lobe)
{
    Clip clip = clip_rect(to_light, light.u.xyz, light.v.xyz, n);
    float sum = 0.0;
    for (int i = 0; i < 2; ++i) {
        mat3 m = lobe.transform[i];
        sum += dot(rect_form(m * to_light, m * light.u.xyz, m * light.v.xyz, clip), lobe.weight[i]);
    }
    return clamp(sum * sign(dot(to_light, cross(light.u.xyz, light.v.xyz))), 0.0, 1.0);
}
