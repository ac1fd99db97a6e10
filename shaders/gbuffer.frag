// Surface attributes of the nearest surface, one target per attribute that somebody reads.
#include "numbers.glsl"
#include "camera.glsl"
#include "inverse_depth.glsl"
#include "octahedral.glsl"
#include "uv_sets.glsl"
#ifdef TANGENT
#include "normal_map.glsl"
#endif
#ifdef CLEARCOAT
#include "clearcoat.glsl"
#endif
#ifdef SHEEN
#include "sheen.glsl"
#endif
#ifdef SPECULAR
#include "specular_albedo.glsl"
#endif

in vec3 position;
in vec3 normal;
flat in float scale;          // of the instance; negative if its transform is mirrored
#ifdef TANGENT
in vec4 tangent;
#endif
#ifdef VERTEX_COLOR
in vec4 color;
#endif

uniform vec3 albedo;
uniform vec4 specular_roughness;           // F0, perceptual roughness
uniform vec3 emission;
uniform vec2 emission_flags;  // shines from both sides; may light other surfaces
#ifdef ACCUMULATES
uniform float footprint;  // of a lookup, in pixels: averaged frames resolve finer texels than one (Karis 2014)
// A bias would leave an anisotropic footprint as long as it is.
#define lookup(map, at) textureGrad(map, at, footprint * dFdx(at), footprint * dFdy(at))
#else
#define lookup(map, at) texture(map, at)
#endif
#ifdef ALBEDO_MAP
uniform sampler2D albedo_map;
uniform mat3 albedo_uv;
#endif
#ifdef EMISSION_MAP
uniform sampler2D emission_map;
uniform mat3 emission_uv;
#endif
#ifdef SPECULAR_MAP
uniform sampler2D specular_map;
uniform mat3 specular_uv;
#endif
#ifdef METALLIC
uniform float metallic;
#endif
#ifdef METALLIC_ROUGHNESS_MAP
uniform sampler2D metallic_roughness_map;  // g: roughness, b: metallic
uniform mat3 metallic_roughness_uv;
#endif
#ifdef NORMAL_MAP
uniform sampler2D normal_map;
uniform mat3 normal_uv;
uniform float normal_scale;
#endif
#ifdef OCCLUSION_MAP
uniform sampler2D occlusion_map;
uniform mat3 occlusion_uv;
uniform float occlusion_strength;
#endif
#ifdef CLEARCOAT
uniform vec2 clearcoat;                    // strength, perceptual roughness
#endif
#ifdef CLEARCOAT_MAP
uniform sampler2D clearcoat_map;           // r
uniform mat3 clearcoat_uv;
#endif
#ifdef CLEARCOAT_ROUGHNESS_MAP
uniform sampler2D clearcoat_roughness_map; // g
uniform mat3 clearcoat_roughness_uv;
#endif
#ifdef CLEARCOAT_NORMAL_MAP
uniform sampler2D clearcoat_normal_map;
uniform mat3 clearcoat_normal_uv;
uniform float clearcoat_normal_scale;
#endif
#ifdef SHEEN
uniform vec4 sheen;                        // colour, perceptual roughness
#endif
#ifdef SHEEN_COLOR_MAP
uniform sampler2D sheen_color_map;
uniform mat3 sheen_color_uv;
#endif
#ifdef SHEEN_ROUGHNESS_MAP
uniform sampler2D sheen_roughness_map;     // a
uniform mat3 sheen_roughness_uv;
#endif
#ifdef LABELS
const float MIN_LABELLED_COVERAGE = 0.5;
#endif
#if defined(LABELS) || defined(SEE_THROUGH)
flat in vec2 labels;                       // numbers of the instance and the material
#endif
#if defined(ALPHA_MASK) || defined(BLENDED)
uniform vec2 alpha;           // factor, cutoff
#endif
#ifdef TRANSMISSION
uniform vec3 transmission;                 // share, index of refraction, thickness in object space
uniform vec3 extinction;                   // of the volume
#endif
#ifdef TRANSMISSION_MAP
uniform sampler2D transmission_map;        // r
uniform mat3 transmission_uv;
#endif
#ifdef THICKNESS_MAP
uniform sampler2D thickness_map;           // g
uniform mat3 thickness_uv;
#endif
#ifdef SEE_THROUGH
uniform sampler2D opaque_depth;
#ifdef HAS_NEARER_DEPTH
uniform sampler2D nearer_depth;            // of the layer before
#endif
#endif

#ifdef WRITE_ALBEDO
layout(location = WRITE_ALBEDO) out vec4 out_albedo;      // a: second number of the face normal
#endif
#ifdef WRITE_NORMAL
layout(location = WRITE_NORMAL) out vec4 out_normal;      // a: first number of the face normal
#endif
#ifdef WRITE_SMOOTH_NORMAL
layout(location = WRITE_SMOOTH_NORMAL) out vec4 out_smooth_normal;  // without the normal map's bumps
#endif
#ifdef WRITE_DEPTH
layout(location = WRITE_DEPTH) out float out_depth;
#endif
#ifdef WRITE_EMISSION
layout(location = WRITE_EMISSION) out vec4 out_emission;  // a: 1 where it may light other surfaces
#endif
#ifdef WRITE_SPECULAR_ROUGHNESS
layout(location = WRITE_SPECULAR_ROUGHNESS) out vec4 out_specular_roughness;
#endif
#ifdef WRITE_OCCLUSION
layout(location = WRITE_OCCLUSION) out float out_occlusion;  // share of indirect light that arrives
#endif
#ifdef WRITE_CLEARCOAT
layout(location = WRITE_CLEARCOAT) out vec4 out_clearcoat;   // normal, strength, perceptual roughness
#endif
#ifdef WRITE_SHEEN
layout(location = WRITE_SHEEN) out vec4 out_sheen;           // colour, perceptual roughness
#endif
#ifdef WRITE_PASSAGE
layout(location = WRITE_PASSAGE) out vec4 out_passage;       // share of the light behind that passes; a: coverage
#endif
#ifdef WRITE_REFRACTION
layout(location = WRITE_REFRACTION) out vec4 out_refraction; // ior, or 0 if thin; thickness / depth_scale; slope of the spread
                                                             // of what is seen through it; code of the material
#endif
#ifdef WRITE_VOLUME
layout(location = WRITE_VOLUME) out vec4 out_volume;         // extinction times depth_scale
#endif
#ifdef WRITE_INSTANCE
layout(location = WRITE_INSTANCE) out float out_instance;
#endif
#ifdef WRITE_MATERIAL
layout(location = WRITE_MATERIAL) out float out_material;
#endif
#ifdef WRITE_MOTION
in vec3 clip_now;
in vec3 clip_before;
#ifdef ORTHOGRAPHIC
uniform float near;           // distance of the near plane in scene units
#endif
layout(location = WRITE_MOTION) out vec4 out_motion;      // pixels, +y down; z: depth one frame ago / now; w: inverse depth
#endif

// Towards the viewer, from screen-space derivatives.
vec3 face_normal()
{
    vec3 n = cross(dFdx(position), dFdy(position));
    float square = dot(n, n);
    if (!(square > 0.0 && is_finite(square))) return -normalize(along_view(position));
    n *= inversesqrt(square);
    return dot(n, along_view(position)) > 0.0 ? -n : n;
}

// The interpolated normal on the viewer's side of the face; the face normal where there is none.
vec3 shading_normal(vec3 face)
{
    float square = dot(normal, normal);
    if (!(square > 1e-12 && is_finite(square))) return face;
    vec3 n = normal * inversesqrt(square);
    return dot(n, face) < 0.0 ? -n : n;
}

float view_depth(vec3 p)
{
    return dot(-vec3(view_from_relative[0].z, view_from_relative[1].z, view_from_relative[2].z), p);
}

#ifdef SEE_THROUGH
// Whether a surface of the given depth is seen through another layer, or lies behind what is opaque.
bool is_other_layer(float d)
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float opaque = texelFetch(opaque_depth, texel, 0).r;
    bool other = is_surface(opaque) && d >= opaque;
#ifdef HAS_NEARER_DEPTH
    float nearer = texelFetch(nearer_depth, texel, 0).r;
    other = other || !(is_surface(nearer) && d > nearer);
#endif
    return other;
}
#endif

void main()
{
    vec3 face = face_normal(), n = shading_normal(face);  // before the discard, as all that takes derivatives
    vec4 base = vec4(albedo, 1.0);
#ifdef ALBEDO_MAP
#if defined(ALPHA_MASK) && defined(ACCUMULATES)
    // Coarse levels of a mask are all above or all below the cutoff; frames of the finest see the share that it covers.
    base *= textureLod(albedo_map, map_at(albedo_uv), 0.0);
#else
    base *= lookup(albedo_map, map_at(albedo_uv));
#endif
#endif
#ifdef VERTEX_COLOR
    base *= color;
#endif
    vec3 light = emission;
#ifdef EMISSION_MAP
    light *= lookup(emission_map, map_at(emission_uv)).rgb;
#endif
#ifdef UNLIT
    light = base.rgb;
    base.rgb = vec3(0.0);
#endif
#ifdef TRANSMISSION
    vec3 tint = sanitize_albedo(base.rgb);
#endif
    vec4 reflectance = specular_roughness;
#ifdef SPECULAR_MAP
    vec4 specular_texel = lookup(specular_map, map_at(specular_uv));
    reflectance.rgb *= specular_texel.rgb * specular_texel.a;
#endif
#ifdef METALLIC_ROUGHNESS_MAP
    vec2 roughness_metallic = lookup(metallic_roughness_map, map_at(metallic_roughness_uv)).gb;
    reflectance.a *= roughness_metallic.x;
#endif
#ifdef METALLIC
#ifdef METALLIC_ROUGHNESS_MAP
    float metal = metallic * roughness_metallic.y;
#else
    float metal = metallic;
#endif
    reflectance.rgb = mix(reflectance.rgb, sanitize_albedo(base.rgb), metal);
    base.rgb *= 1.0 - metal;
#endif
#ifdef TRANSMISSION
    float transmitted = transmission.x;
#ifdef TRANSMISSION_MAP
    transmitted *= lookup(transmission_map, map_at(transmission_uv)).r;
#endif
    base.rgb *= 1.0 - transmitted;
#ifdef METALLIC
    transmitted *= 1.0 - metal;
#endif
    float thickness = transmission.z * abs(scale);
#ifdef THICKNESS_MAP
    thickness *= lookup(thickness_map, map_at(thickness_uv)).g;
#endif
#endif
#ifdef TANGENT
    vec3 v = -normalize(along_view(position));
#endif
#ifdef SHEEN
    vec4 cloth = sheen;
#ifdef SHEEN_COLOR_MAP
    cloth.rgb *= lookup(sheen_color_map, map_at(sheen_color_uv)).rgb;
#endif
#ifdef SHEEN_ROUGHNESS_MAP
    cloth.a *= lookup(sheen_roughness_map, map_at(sheen_roughness_uv)).a;
#endif
#endif
#ifdef CLEARCOAT
    vec2 coat = clearcoat;
    vec3 coat_normal = n;
#ifdef CLEARCOAT_MAP
    coat.x *= lookup(clearcoat_map, map_at(clearcoat_uv)).r;
#endif
#ifdef CLEARCOAT_ROUGHNESS_MAP
    coat.y *= lookup(clearcoat_roughness_map, map_at(clearcoat_roughness_uv)).g;
#endif
#ifdef CLEARCOAT_NORMAL_MAP
    coat_normal = bend_above_face(mapped_normal(lookup(clearcoat_normal_map, map_at(clearcoat_normal_uv)),
                                                clearcoat_normal_scale, normal, tangent, sign(scale), face, v), face, v);
#endif
#endif
#ifdef WRITE_SMOOTH_NORMAL
    out_smooth_normal = vec4(n, 0.0);
#endif
#ifdef NORMAL_MAP
    n = bend_above_face(mapped_normal(lookup(normal_map, map_at(normal_uv)), normal_scale, normal, tangent,
                                      sign(scale), face, v), face, v);
#endif
#if defined(SPECULAR) && defined(WRITE_ALBEDO)
    // A surface reflects no more light than arrives.
    base.rgb = min(base.rgb, 1.0 - specular_albedo(reflectance.rgb, reflectance.a, dot(n, -normalize(along_view(position)))));
#endif
#ifdef OCCLUSION_MAP
    float occlusion = 1.0 + occlusion_strength * (lookup(occlusion_map, map_at(occlusion_uv)).r - 1.0);
#endif
#ifdef ALPHA_MASK
    if (!(base.a * alpha.x >= alpha.y)) discard;
#endif
#if defined(LABELS) && defined(BLENDED)
    if (!(base.a * alpha.x >= MIN_LABELLED_COVERAGE)) discard;
#endif
#ifdef SEE_THROUGH
    if (is_other_layer(view_depth(position))) discard;
    float coverage = 1.0;
    vec3 passing = vec3(0.0);
#ifdef BLENDED
    coverage = clamp(base.a * alpha.x, 0.0, 1.0);
    if (!(coverage > 0.0)) discard;
#endif
#ifdef TRANSMISSION
    // The back of a volume only lets light out, which the front stands for.
    if (transmission.z > 0.0 && gl_FrontFacing != (scale > 0.0)) discard;
    vec3 to_viewer = -normalize(along_view(position));
    vec3 reflected = reflectance.rgb + (1.0 - reflectance.rgb) * pow(1.0 - clamp(dot(n, to_viewer), 0.0, 1.0), 5.0);
    bool is_glossy = max(max(reflectance.r, reflectance.g), reflectance.b) > 0.0;
    passing = transmitted * tint * (is_glossy ? 1.0 - reflected : vec3(1.0));
#endif
#endif
#ifdef SHEEN
    float left = 1.0 - max(max(cloth.r, cloth.g), cloth.b) * sheen_albedo(max(dot(n, -normalize(along_view(position))), 0.0), cloth.a);
    base.rgb *= left;
    reflectance.rgb *= left;
#ifdef SEE_THROUGH
    passing *= left;
#endif
#endif
#ifdef CLEARCOAT
    float below = below_clearcoat(coat.x, dot(coat_normal, -normalize(along_view(position))));
    base.rgb *= below;
    light *= below;
#ifdef SEE_THROUGH
    passing *= below;
#endif
#endif
#ifdef SEE_THROUGH
    base.rgb *= coverage;
    light *= coverage;
#endif
    vec2 code = octahedral_encode(face);
#ifdef WRITE_ALBEDO
    out_albedo = vec4(sanitize_albedo(base.rgb), code.y);
#endif
#ifdef WRITE_NORMAL
    out_normal = vec4(n, code.x);
#endif
#ifdef WRITE_DEPTH
#ifdef GRID_CUBE
    out_depth = length(position);
#else
    out_depth = view_depth(position);
#endif
#endif
#ifdef WRITE_EMISSION
    bool front = gl_FrontFacing == (scale > 0.0);
    out_emission = front || emission_flags.x > 0.5 ? vec4(sanitize_radiance(light), emission_flags.y) : vec4(0.0);
#endif
#ifdef WRITE_SPECULAR_ROUGHNESS
    out_specular_roughness = reflectance;
#endif
#ifdef WRITE_OCCLUSION
#ifdef OCCLUSION_MAP
    out_occlusion = occlusion;
#else
    out_occlusion = 1.0;
#endif
#endif
#ifdef WRITE_CLEARCOAT
#ifdef CLEARCOAT
    out_clearcoat = vec4(octahedral_encode(coat_normal), coat);
#else
    out_clearcoat = vec4(0.0);
#endif
#endif
#ifdef WRITE_SHEEN
#ifdef SHEEN
    out_sheen = cloth;
#else
    out_sheen = vec4(0.0);
#endif
#endif
#ifdef WRITE_PASSAGE
    out_passage = vec4(sanitize_albedo(1.0 - coverage + coverage * passing), coverage);
#endif
#ifdef WRITE_REFRACTION
#ifdef TRANSMISSION
    float tilt = reflectance.a * reflectance.a;  // slope that half of the microfacets stay below
    bool is_thick = transmission.z > 0.0;
    float spread = tilt * (is_thick ? transmission.y - 1.0 : 2.0), deep = thickness / depth_scale(view_depth(position));
    out_refraction = is_thick ? vec4(min(vec3(transmission.y, deep, spread), HALF_MAX), material_code(labels.y))
                              : vec4(0.0, 0.0, min(spread, HALF_MAX), -1.0);
#else
    out_refraction = vec4(0.0, 0.0, 0.0, -1.0);
#endif
#endif
#ifdef WRITE_VOLUME
#ifdef TRANSMISSION
    out_volume = vec4(min(extinction * depth_scale(view_depth(position)), HALF_MAX), 1.0);
#else
    out_volume = vec4(0.0);
#endif
#endif
#ifdef WRITE_INSTANCE
    out_instance = labels.x;
#endif
#ifdef WRITE_MATERIAL
    out_material = labels.y;
#endif
#ifdef WRITE_MOTION
#ifdef ORTHOGRAPHIC
    out_motion = vec4(0.0, 0.0, 0.0, inverse_depth(clip_now.z, near));
#else
    out_motion = vec4(0.0, 0.0, 0.0, UNIT_INVERSE_DEPTH * gl_FragCoord.z);  // z = near / depth
#endif
    if (clip_before.z > 0.0) {
#ifdef ORTHOGRAPHIC
        vec2 moved = clip_now.xy - clip_before.xy;
#else
        vec2 moved = clip_now.xy / clip_now.z - clip_before.xy / clip_before.z;
#endif
        out_motion.xyz = vec3(moved * image.xy * vec2(0.5, -0.5), clip_before.z / clip_now.z);
    }
#endif
}
