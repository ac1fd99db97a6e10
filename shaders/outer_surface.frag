// The surface of each pixel that mirrors what is around, where that is not the G-buffer's: the nearest layer of what is seen
// through, or a clear coat. Where there are both, a layer that covers much. Its targets are those of a G-buffer.
#include "numbers.glsl"
#include "grid.glsl"
#include "reflection.glsl"
#ifdef HAS_CLEARCOAT
#include "octahedral.glsl"
#include "clearcoat.glsl"
#endif

#ifdef HAS_CLEARCOAT
uniform sampler2D albedo;
uniform sampler2D normal;
uniform sampler2D depth;
uniform sampler2D motion;
uniform sampler2D clearcoat;   // normal, strength, perceptual roughness
#endif
#ifdef HAS_PEEL0_DEPTH
uniform sampler2D layer_albedo;
uniform sampler2D layer_normal;
uniform sampler2D layer_depth;
uniform sampler2D layer_motion;
uniform sampler2D layer_specular_roughness;
uniform sampler2D layer_passage;    // a: coverage
#ifdef HAS_PEEL0_CLEARCOAT
uniform sampler2D layer_clearcoat;
#endif

const float MIN_SHARE = 0.5;  // of a pixel that a layer covers, from which its reflection counts before that of a coat behind it
#endif

layout(location = WRITE_OUTER_ALBEDO) out vec4 out_albedo;  // share of the pixel; 1 for a layer, 0 for a coat; a: as in a G-buffer
layout(location = WRITE_OUTER_NORMAL) out vec4 out_normal;
layout(location = WRITE_OUTER_DEPTH) out float out_depth;   // 0 where there is none
layout(location = WRITE_OUTER_SPECULAR_ROUGHNESS) out vec4 out_specular_roughness;
#ifdef WRITE_OUTER_MOTION
layout(location = WRITE_OUTER_MOTION) out vec4 out_motion;
#endif

bool mirrors(float d, vec4 reflectance)
{
    return is_surface(d) && ray_share(reflectance.a) > 0.0 && max(max(reflectance.r, reflectance.g), reflectance.b) > 0.0;
}

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    out_albedo = out_normal = out_specular_roughness = vec4(0.0);
    out_depth = 0.0;
#ifdef WRITE_OUTER_MOTION
    out_motion = vec4(0.0);
#endif
    bool has_coat = false;
#ifdef HAS_CLEARCOAT
    float d = texelFetch(depth, texel, 0).r;
    vec4 coat = texelFetch(clearcoat, texel, 0);
    has_coat = is_surface(d) && coat.z > 0.0;
    if (has_coat) {
        out_albedo = vec4(coat.z, 0.0, 0.0, texelFetch(albedo, texel, 0).a);
        out_normal = vec4(octahedral_decode(coat.xy), texelFetch(normal, texel, 0).a);
        out_depth = d;
        out_specular_roughness = vec4(vec3(CLEARCOAT_F0), coat.w);
#ifdef WRITE_OUTER_MOTION
        out_motion = texelFetch(motion, texel, 0);
#endif
    }
#endif
#ifdef HAS_PEEL0_DEPTH
    float layer = texelFetch(layer_depth, texel, 0).r, share = texelFetch(layer_passage, texel, 0).a;
    vec4 reflectance = texelFetch(layer_specular_roughness, texel, 0);
    if (mirrors(layer, reflectance) && (!has_coat || share > MIN_SHARE)) {
#ifdef HAS_PEEL0_CLEARCOAT
        vec4 over = texelFetch(layer_clearcoat, texel, 0);
        vec3 p = surface_point(gl_FragCoord.xy, layer);
        share *= below_clearcoat(sanitize_albedo(over.zzz).x, dot(octahedral_decode(over.xy), -normalize(along_view(p))));
#endif
        out_albedo = vec4(share, 1.0, 0.0, texelFetch(layer_albedo, texel, 0).a);
        out_normal = texelFetch(layer_normal, texel, 0);
        out_depth = layer;
        out_specular_roughness = reflectance;
#ifdef WRITE_OUTER_MOTION
        out_motion = texelFetch(layer_motion, texel, 0);
#endif
    }
#endif
}
