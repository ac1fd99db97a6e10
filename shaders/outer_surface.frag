// The outermost surface of each pixel that mirrors what is around, where that is not the G-buffer's: the nearest layer of
// what is seen through, else a clear coat. Its targets are those of a G-buffer.
#include "numbers.glsl"
#include "camera.glsl"
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
uniform sampler2D layer_passage;  // a: coverage
#endif

layout(location = WRITE_OUTER_ALBEDO) out vec4 out_albedo;  // share of the pixel; 1 for a layer, 0 for a coat; a: as in a G-buffer
layout(location = WRITE_OUTER_NORMAL) out vec4 out_normal;
layout(location = WRITE_OUTER_DEPTH) out float out_depth;   // 0 where there is none
layout(location = WRITE_OUTER_SPECULAR_ROUGHNESS) out vec4 out_specular_roughness;
#ifdef WRITE_OUTER_MOTION
layout(location = WRITE_OUTER_MOTION) out vec4 out_motion;
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec4 albedo_here = vec4(0.0), normal_here = vec4(0.0), reflectance = vec4(0.0), moved = vec4(0.0);
    float d = 0.0;
#ifdef HAS_CLEARCOAT
    vec4 coat = texelFetch(clearcoat, texel, 0);
    d = texelFetch(depth, texel, 0).r;
    albedo_here = vec4(coat.z, 0.0, 0.0, texelFetch(albedo, texel, 0).a);
    normal_here = vec4(octahedral_decode(coat.xy), texelFetch(normal, texel, 0).a);
    reflectance = coat.z > 0.0 ? vec4(vec3(CLEARCOAT_F0), coat.w) : vec4(0.0);
    moved = texelFetch(motion, texel, 0);
#endif
#ifdef HAS_PEEL0_DEPTH
    float layer = texelFetch(layer_depth, texel, 0).r;
    if (is_surface(layer)) {
        d = layer;
        albedo_here = vec4(texelFetch(layer_passage, texel, 0).a, 1.0, 0.0, texelFetch(layer_albedo, texel, 0).a);
        normal_here = texelFetch(layer_normal, texel, 0);
        reflectance = texelFetch(layer_specular_roughness, texel, 0);
        moved = texelFetch(layer_motion, texel, 0);
    }
#endif
    bool mirrors = is_surface(d) && ray_share(reflectance.a) > 0.0 && max(max(reflectance.r, reflectance.g), reflectance.b) > 0.0;
    out_albedo = albedo_here;
    out_normal = normal_here;
    out_depth = mirrors ? d : 0.0;
    out_specular_roughness = mirrors ? reflectance : vec4(0.0);
#ifdef WRITE_OUTER_MOTION
    out_motion = moved;
#endif
}
