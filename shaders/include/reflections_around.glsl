// What the 3x3 low-resolution texels around one reflect in this frame.
uniform sampler2D reflection_now;  // radiance; a: length of the ray / depth where it starts, none of the texel's surface if <= 0

struct Around {
    float count;      // of texels with a sample; without any, all else is 0
    vec3 mean;
    vec3 deviation;
    float brightest;  // of all channels
    float reach;      // mean length of the rays / depth
    float nearest;    // the least of these; HALF_MAX without any
};

Around reflections_around(ivec2 low)
{
    ivec2 last = textureSize(reflection_now, 0) - 1;
    vec3 mean = vec3(0.0), square = vec3(0.0);
    float count = 0.0, distances = 0.0, brightest = 0.0, nearest = HALF_MAX;
    for (int i = 0; i < 9; ++i) {
        vec4 t = texelFetch(reflection_now, clamp(low + ivec2(i % 3, i / 3) - 1, ivec2(0), last), 0);
        bool counts = is_finite(dot(t, vec4(1.0))) && t.a > 0.0;
        vec3 light = counts ? clamp(t.rgb, 0.0, HALF_MAX) : vec3(0.0);
        mean += light;
        brightest = max(brightest, max(max(light.r, light.g), light.b));
        square += light * light;
        distances += counts ? t.a : 0.0;
        nearest = counts ? min(nearest, t.a) : nearest;
        count += counts ? 1.0 : 0.0;
    }
    float scale = 1.0 / max(count, 1.0);
    mean *= scale;
    return Around(count, mean, sqrt(max(square * scale - mean * mean, 0.0)), brightest, distances * scale, nearest);
}
