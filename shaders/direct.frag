// Outgoing diffuse radiance by direct light, and GGX specular light where a material has a specular lobe.
#include "numbers.glsl"
#include "octahedral.glsl"
#include "grid.glsl"
#include "shadow.glsl"
#include "shadow_ratio.glsl"
#include "quad_surface.glsl"
#include "sky_irradiance.glsl"
#include "sky_specular.glsl"
#include "ggx.glsl"
#include "sparse_lights.glsl"
#ifdef HAS_TRACED_RECT
#include "traced_rects.glsl"
#endif
#if defined(SKY_IS_REFLECTED) || defined(HAS_OUTER_DEPTH)
#include "reflection.glsl"
#endif
#ifdef LAYERS
#include "layers.glsl"
#endif

uniform sampler2D albedo;
uniform sampler2D normal;
uniform sampler2D depth;
#ifdef WRITE_SPECULAR
uniform sampler2D specular_roughness;
#endif

#ifdef HAS_ENVIRONMENT_DIFFUSE
uniform sampler2D environment_diffuse;   // irradiance / pi
#endif
#ifdef HAS_ENVIRONMENT_SPECULAR
uniform sampler2D environment_specular;  // without Fresnel's law
#endif

#ifdef HAS_SMOOTH_NORMAL
uniform sampler2D smooth_normal;         // by which shadow_gbuffer knows surfaces, whatever their bumps
#endif
#ifdef HAS_OUTER_DEPTH
uniform sampler2D outer_depth;           // of the clear coats, or of the layer if IS_OUTER, whose reflections are traced
#endif
#ifdef HAS_SKY_VISIBLE
uniform sampler2D sky_visible;           // share of the environment's light, a texel for SKY_TILE × SKY_TILE of shadow_ratio
#endif

#ifdef WRITE_DIRECT
layout(location = WRITE_DIRECT) out vec4 out_direct;
#endif
#ifdef WRITE_SPECULAR
layout(location = WRITE_SPECULAR) out vec4 out_specular;
#endif

// Share of the reflected environment that is not traced.
#ifdef IS_OUTER
#define SKY_SHARE (texelFetch(outer_depth, texel, 0).r == d ? 1.0 - ray_share(reflectance.a) : 1.0)
#elif defined(SKY_IS_REFLECTED)
#define SKY_SHARE (1.0 - ray_share(reflectance.a))
#else
#define SKY_SHARE 1.0
#endif

#ifdef HAS_SKY_VISIBLE
const float SHARE_NOISE = 0.05;  // of v, which must not let the bounds of a share rise

// Share of the sky's light alone, where v is that of all traced light: that of the tile, as far as v allows for it, since between
// none and all of the lights' is visible. The more of the light is the sky's, the nearer it is to v.
vec3 sky_share(vec3 v, vec3 of_lights, vec3 of_sky)
{
    vec2 tiles = vec2(textureSize(sky_visible, 0));
    vec3 share = vec3(textureLod(sky_visible, gl_FragCoord.xy / (shadow_grid_ratio * SKY_TILE * tiles), 0.0).r);
    vec3 visible = v * (of_lights + of_sky), sky = max(of_sky, 1e-30);
    vec3 least = visible - (1.0 + SHARE_NOISE) * of_lights, most = (1.0 + SHARE_NOISE) * visible;
    return clamp(share, clamp(least / sky, 0.0, 1.0), clamp(most / sky, 0.0, 1.0));
}
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, texel, 0).r;
    // Sky takes part, since the texels of a quad share their shadow taps; its light is masked below.
    vec3 diffuse = vec3(0.0), specular = vec3(0.0);
    vec4 surface = texelFetch(normal, texel, 0);
    vec4 base = texelFetch(albedo, texel, 0);
    vec3 n = sanitize_normal(surface.xyz);
    vec3 p = surface_point(gl_FragCoord.xy, d);
#ifdef WRITE_SPECULAR
    vec4 reflectance = texelFetch(specular_roughness, texel, 0);
    Lobe lobe = specular_lobe(p, n, reflectance);
    bool is_shiny = max(max(reflectance.r, reflectance.g), reflectance.b) > 0.0;
#endif
#ifdef LAYERS  // clear coat or sheen, which few scenes have
    Layers layers = read_layers(texel, p);
    vec3 layered = vec3(0.0), traced_layered = vec3(0.0);
#endif
#ifdef HAS_SHADOW
#if defined(FAST_PATH) && !defined(HAS_SHADOW_RATIO)
    // Done where no light arrives, so that no shadow is looked up there.
    bool is_dark = true;
    for (int i = 0; i < MAPPED_COUNT; ++i) {
        vec3 e = irradiance(lights[i], p, n);
        is_dark = is_dark && max(max(e.r, e.g), e.b) <= 0.0;
    }
    gl_FragDepth = quad_all(is_dark || !is_surface(d)) ? 1.0 : 0.0;
#else
    vec3 face = octahedral_decode(vec2(surface.a, base.a));
    QuadNoise noise = quad_noise();
    for (int i = 0; i < MAPPED_COUNT; ++i) {
        Light light = lights[i];
#ifdef HAS_NEAR_CASCADE
        light = with_cascade(light, p, noise);
#endif
        vec3 e = irradiance(light, p, n);
#ifdef LAYERS
        bool wanted = is_surface(d) && reaches_layers(light, p, e, layers);
#else
        bool wanted = is_surface(d) && max(max(e.r, e.g), e.b) > 0.0;
#endif
#ifdef NORMAL_MAPS
        float in_front = share_in_front(light, p, face);
        wanted = wanted && in_front > 0.0;
#endif
        vec3 v = arriving_share(light, p, face, noise, wanted);
        v = wanted ? v : vec3(0.0);
#ifdef NORMAL_MAPS
        v *= in_front;
#endif
        diffuse += wanted ? v * e : vec3(0.0);
#ifdef WRITE_SPECULAR
        specular += wanted ? v * ggx_specular(light, p, n, lobe) : vec3(0.0);
#endif
#ifdef LAYERS
        layered += wanted ? v * layered_light(light, p, n, e, layers) : vec3(0.0);
#endif
    }
#endif
#endif
#if defined(HAS_SHADOW_RATIO) || defined(HAS_SKY_IRRADIANCE)
    vec3 traced = vec3(0.0), traced_specular = vec3(0.0);
#ifdef HAS_TRACED_SPHERE
    // A loop with its test at the end, not a branch: software rasterisers walk through both sides of a branch, and once
    // more than needed through a loop with its test at the beginning.
    int i = MAPPED_COUNT, spheres_end = is_surface(d) ? RECTS_BEGIN : MAPPED_COUNT;
    do {
        traced += irradiance(lights[i], p, n);
#ifdef WRITE_SPECULAR
        traced_specular += is_sparse(i) ? vec3(0.0) : ggx_specular(lights[i], p, n, lobe);
#endif
    } while (++i < spheres_end);
#endif
#ifdef HAS_TRACED_RECT
    QuadSurface quad = quad_surface(p, n, d);
#ifdef WRITE_SPECULAR
    TracedRects rects = rects_light(p, n, lobe, is_surface(d), is_shiny, quad);
    traced += rects.irradiance;
    traced_specular += rects.specular;
#else
    traced += rects_irradiance(p, n, is_surface(d), quad);
#endif
#endif
#if defined(HAS_SPARSE_LIGHT) && defined(WRITE_SPECULAR)
    traced_specular += sparse_specular(p, n, lobe, is_surface(d) && is_shiny);
#endif
#ifdef LAYERS
    for (int m = MAPPED_COUNT; m < (is_surface(d) ? LIGHT_COUNT : MAPPED_COUNT); ++m)
        traced_layered += layered_light(lights[m], p, n, traced_irradiance(lights[m], p, n), layers);
#endif
    vec3 of_lights = traced, of_sky = vec3(0.0), sky_glossy = vec3(0.0), sky_layered = vec3(0.0);
#if defined(HAS_SKY_IRRADIANCE) && !defined(SKY_IS_GATHERED)
    if (is_surface(d)) of_sky = unshadowed_sky_irradiance(n);
    traced += of_sky;
#endif
#if defined(HAS_SKY_SPECULAR) && defined(WRITE_SPECULAR)
    if (is_surface(d))
        sky_glossy = SKY_SHARE * specular_albedo(reflectance.rgb, reflectance.a, dot(n, lobe.v))
            * unshadowed_sky_specular(dominant_direction(n, p, reflectance.a), reflectance.a);
#endif
#if defined(LAYERS) && defined(HAS_SKY_SPECULAR)
    float coat_share = 1.0;
#if defined(HAS_OUTER_DEPTH) && defined(HAS_CLEARCOAT) && !defined(IS_OUTER)
    coat_share = texelFetch(outer_depth, texel, 0).r == d ? 1.0 - ray_share(layers.coat.a) : 1.0;
#endif
    if (is_surface(d)) sky_layered = layered_sky(p, n, layers, coat_share);
#endif
    vec3 arriving = traced + traced_specular + sky_glossy + sky_layered;
#ifdef LAYERS
    arriving += traced_layered;
#endif
    bool is_reached = is_surface(d) && max(max(arriving.r, arriving.g), arriving.b) > 0.0;
#ifdef HAS_SHADOW_RATIO
#ifdef HAS_SMOOTH_NORMAL
    vec3 smooth_n = sanitize_normal(texelFetch(smooth_normal, texel, 0).xyz);
#else
    vec3 smooth_n = n;
#endif
#ifdef FAST_PATH
    bool is_known;
    float specular_share;
    vec3 v = traced_visibility(smooth_n, d, is_reached, specular_share, is_known);
    gl_FragDepth = quad_all(is_known || !is_reached) ? 1.0 : 0.0;
#elif defined(SPECULAR_RAYS)
    float specular_share;
    vec3 v = traced_visibility(smooth_n, d, is_reached, specular_share);
#else
    vec3 v = traced_visibility(smooth_n, d, is_reached);
#endif
#else  // layers that are seen through, where a model makes the environment's shadows on opaque surfaces
    vec3 v = vec3(1.0);
#endif
    v = is_reached ? v : vec3(0.0);
#ifdef SPECULAR_RAYS
    vec3 v_specular = vec3(is_reached ? specular_share : 0.0);
#else
    vec3 v_specular = v;
#endif
#ifdef HAS_SKY_VISIBLE
    vec3 v_sky = sky_share(v, of_lights, of_sky);
#else
    vec3 v_sky = v;
#endif
    diffuse += v * traced;
    specular += v_specular * traced_specular + v_sky * sky_glossy;
#ifdef LAYERS
    layered += v * traced_layered + v_sky * sky_layered;
#endif
#endif
#ifdef HAS_ENVIRONMENT_DIFFUSE
    diffuse += PI * sanitize_radiance(texelFetch(environment_diffuse, texel, 0).rgb);
#endif
    diffuse *= sanitize_albedo(base.rgb) / PI;
#ifdef WRITE_DIRECT
    out_direct = vec4(sanitize_radiance(diffuse), 1.0);
#endif
#ifdef WRITE_SPECULAR
#ifdef HAS_ENVIRONMENT_SPECULAR
    if (is_surface(d))
        specular += SKY_SHARE * lobe_reflectance(reflectance.rgb, reflectance.a, dot(n, lobe.v))
            * sanitize_radiance(texelFetch(environment_specular, texel, 0).rgb);
#endif
#ifdef LAYERS
    specular = specular * layers.below + layered;
#endif
    out_specular = vec4(sanitize_radiance(specular), 1.0);
#endif
}
