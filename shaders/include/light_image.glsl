// Images of rectangle lights: how their radiance varies, relative to its mean. Diffuse light weighs a few parts of the image by
// what each of them sends; highlights show it as wide as the lobe is where it meets the rectangle, an area light's prefiltered
// texture as in Heitz, Dupuy, Hill and Neubelt 2016, "Real-Time Polygonal-Light Shading with Linearly Transformed Cosines".
#include "light.glsl"
#include "numbers.glsl"
#include "rect_form.glsl"

#ifdef HAS_LIGHT_IMAGES
uniform sampler2DArray light_images;

const int PARTS = 4;               // along each edge
const float PART_LEVEL = 6.0;      // of mipmaps, whose texels are the parts
const int IMAGE_SAMPLES = 3;       // in a highlight
const float LOBE_WIDTH = 3.0;      // over alpha, in radians; a little more than between directions of half the lobe's radiance
const float RAY_LEVEL = 3.0;       // whose detail rays see; more would be noise
const float MIN_ROW = 3.0;         // texels, about, which a lobe is long where several samples are worth their time
const float MAX_ROW = 1024.0;
const float MEAN_LEVEL = 16.0;     // at least that of one texel
const float MIN_LENGTH_SQUARE = 1e-12;  // of a view along the normal, whose plane of incidence may be any
const float MIN_SPEED = 1e-6;      // at which a mirrored view approaches the light's plane
const float MIN_PART_WEIGHT = 1e-6;  // of a part, so that their sum is not 0 below the horizon

// Negative for lights without an image.
float image_layer(Light light)
{
    return int(light.color.w) == RECT ? light.frame_z.w - 1.0 : -1.0;
}

// What relative point p with unit normal n receives of every so many parts of the image, and the sum of their weights.
vec4 image_parts(Light light, vec3 p, vec3 n, int first, int stride)
{
    vec3 to_light = light.position.xyz - p, u = light.u.xyz, v = light.v.xyz;
    float scale = inversesqrt(max(dot(to_light, to_light) + dot(u, u) + dot(v, v), MIN_SQUARE));  // against overflows
    to_light *= scale;
    u *= scale;
    v *= scale;
    // A part is not a point, so its nearest distance is about a quarter of its size.
    float nearest = (dot(u, u) + dot(v, v)) / float(4 * PARTS * PARTS);
    vec4 sum = vec4(0.0);
    int i = first;
    do {
        ivec2 part = ivec2(i % PARTS, i / PARTS);
        vec2 at = (2.0 * vec2(part) + 1.0) / float(PARTS) - 1.0;
        vec3 to = to_light + at.x * u + at.y * v;
        float square = dot(to, to) + nearest, weight = max(dot(to, n), MIN_PART_WEIGHT * sqrt(square)) / (square * square);
        sum += weight * vec4(texelFetch(light_images, ivec3(part, image_layer(light)), int(PART_LEVEL)).rgb, 1.0);
    } while ((i += stride) < PARTS * PARTS);
    return sum;
}

// Mean of the image as relative point p with unit normal n receives it.
vec3 image_around(Light light, vec3 p, vec3 n)
{
    if (image_layer(light) < 0.0) return vec3(1.0);
    vec4 sum = image_parts(light, p, n, 0, 1);
    return sum.rgb / sum.a;
}

// The image at an offset from the light's centre.
vec3 image_at(Light light, vec3 offset, float level)
{
    if (image_layer(light) < 0.0) return vec3(1.0);
    vec2 place = vec2(dot(offset, light.frame_x.xyz), dot(offset, light.frame_y.xyz)) / vec2(light.frame_x.w, light.frame_y.w);
    return textureLod(light_images, vec3(clamp(0.5 + 0.5 * place, 0.0, 1.0), image_layer(light)), level).rgb;
}

// Mean of the image in a lobe around the unit vector ``mirrored`` from relative point p with unit normal n. The lobe is longer
// within the plane of incidence than across it, so it is a row of samples.
vec3 image_along(Light light, vec3 p, vec3 n, vec3 mirrored, float alpha)
{
    vec3 to_light = light.position.xyz - p, upward = n - mirrored * dot(n, mirrored);
    float along = dot(to_light, light.frame_z.xyz), n_v = max(dot(n, mirrored), alpha);
    float texels = float(textureSize(light_images, 0).x) * inversesqrt(4.0 * light.frame_x.w * light.frame_y.w);
    vec3 step_up = upward * (LOBE_WIDTH * alpha / float(IMAGE_SAMPLES) * inversesqrt(max(dot(upward, upward), MIN_LENGTH_SQUARE)));
    // A narrow lobe shows a point of the image, and a very wide one its mean.
    float length_up = LOBE_WIDTH * alpha * length(to_light) * texels;
    int i = 0, count = length_up > MIN_ROW && length_up < MAX_ROW ? IMAGE_SAMPLES : 1;
    vec3 sum = vec3(0.0);
    float total = 0.0;
    do {
        vec3 direction = mirrored + (float(i) - 0.5 * float(count - 1)) * step_up;
        float speed = dot(direction, light.frame_z.xyz), t = along / (abs(speed) < MIN_SPEED ? MIN_SPEED : speed);
        vec3 offset = direction * t - to_light;
        vec2 beyond = abs(vec2(dot(offset, light.frame_x.xyz), dot(offset, light.frame_y.xyz)))
            - vec2(light.frame_x.w, light.frame_y.w);
        // What is mirrored away from the light's plane meets it only at the lobe's edge.
        float width = max(n_v, 1.0 / float(IMAGE_SAMPLES)) * LOBE_WIDTH * alpha * t * inversesqrt(max(abs(speed), MIN_SPEED));
        float weight = t > 0.0 && max(beyond.x, beyond.y) < 0.0 ? 1.0 : MIN_PART_WEIGHT;
        sum += weight * image_at(light, t > 0.0 ? offset : vec3(0.0), t > 0.0 ? log2(max(width * texels, 1.0)) : MEAN_LEVEL);
        total += weight;
    } while (++i < count);
    return sum / total;
}
#endif
