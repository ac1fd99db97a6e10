// What lies over some surfaces: a clear coat, and the sheen of fibres. Sheen takes lights as if from their centres.
#include "lights.glsl"
#include "ggx.glsl"
#include "numbers.glsl"
#include "octahedral.glsl"
#ifdef HAS_CLEARCOAT
#include "clearcoat.glsl"
uniform sampler2D clearcoat;  // normal, strength, perceptual roughness
#endif
#ifdef HAS_SHEEN
#include "sheen.glsl"
uniform sampler2D sheen;      // colour, perceptual roughness
#endif

struct Layers {
    float below;  // share of the surface's reflected light that passes
#ifdef HAS_CLEARCOAT
    vec3 normal;
    vec4 coat;    // F0, perceptual roughness
    float strength;
    Lobe lobe;
#endif
#ifdef HAS_SHEEN
    vec4 sheen;
    vec3 v;       // towards the viewer
#endif
};

Layers read_layers(ivec2 texel, vec3 p)
{
    Layers layers;
    layers.below = 1.0;
#ifdef HAS_CLEARCOAT
    vec4 coat = texelFetch(clearcoat, texel, 0);
    layers.strength = sanitize_albedo(coat.zzz).x;
    layers.normal = octahedral_decode(coat.xy);
    layers.coat = vec4(vec3(layers.strength > 0.0 ? CLEARCOAT_F0 : 0.0), sanitize_albedo(coat.www).x);
    layers.lobe = specular_lobe(p, layers.normal, layers.coat);
    layers.below = below_clearcoat(layers.strength, dot(layers.normal, -normalize(along_view(p))));
#endif
#ifdef HAS_SHEEN
    vec4 cloth = texelFetch(sheen, texel, 0);
    layers.sheen = vec4(sanitize_albedo(cloth.rgb), sanitize_albedo(cloth.aaa).x);
    layers.v = -normalize(along_view(p));
#endif
    return layers;
}

// Whether a light of irradiance e on the surface itself reaches any layer.
bool reaches_layers(Light light, vec3 p, vec3 e, Layers layers)
{
#ifdef HAS_CLEARCOAT
    if (layers.strength > 0.0) e = max(e, irradiance(light, p, layers.normal));
#endif
    return max(max(e.r, e.g), e.b) > 0.0;
}

// Radiance that the layers reflect of a light with irradiance e on the surface at relative point p.
vec3 layered_light(Light light, vec3 p, vec3 n, vec3 e, Layers layers)
{
    vec3 sum = vec3(0.0);
#ifdef HAS_CLEARCOAT
    vec3 of_coat = layers.strength * ggx_specular(light, p, layers.normal, layers.lobe);
#ifdef HAS_LIGHT_IMAGES
    of_coat *= image_along(light, p, layers.normal, reflect(-layers.lobe.v, layers.normal), layers.lobe.alpha);
#endif
    sum += of_coat;
#endif
#ifdef HAS_SHEEN
    if (max(max(layers.sheen.r, layers.sheen.g), layers.sheen.b) > 0.0) {
        bool is_parallel = int(light.color.w) == DIRECTIONAL;
        vec3 l = is_parallel ? light.position.xyz : normalize(light.position.xyz - p);
        sum += layers.below * layers.sheen.rgb * e * sheen_lobe(n, l, layers.v, layers.sheen.a);
    }
#endif
    return sum;
}

#ifdef HAS_SKY_SPECULAR
// The same of the environment; coat_share: the share of what the clear coat reflects of it that is not traced.
vec3 layered_sky(vec3 p, vec3 n, Layers layers, float coat_share)
{
    vec3 sum = vec3(0.0);
#ifdef HAS_CLEARCOAT
    sum += layers.strength * specular_albedo(layers.coat.rgb, layers.coat.a, dot(layers.normal, layers.lobe.v)) * coat_share
        * unshadowed_sky_specular(dominant_direction(layers.normal, p, layers.coat.a), layers.coat.a);
#endif
#ifdef HAS_SHEEN
    sum += layers.below * layers.sheen.rgb * sheen_albedo(max(dot(n, layers.v), 0.0), layers.sheen.a)
        * unshadowed_sky_irradiance(n) / PI;
#endif
    return sum;
}
#endif
