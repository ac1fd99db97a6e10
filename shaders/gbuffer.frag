// Surface attributes of the nearest surface, one target per attribute that somebody reads.
#include "numbers.glsl"
#include "camera.glsl"
#include "inverse_depth.glsl"
#include "octahedral.glsl"

in vec3 position;
in vec3 normal;
#if defined(ALBEDO_MAP) || defined(EMISSION_MAP)
in vec2 uv;
#endif
#ifdef VERTEX_COLOR
in vec4 color;
#endif

uniform vec3 albedo;
uniform vec4 specular_roughness;           // F0, perceptual roughness
uniform vec3 emission;
uniform vec3 emission_flags;  // shines from both sides; may light other surfaces; -1 for a mirrored transform
#ifdef ALBEDO_MAP
uniform sampler2D albedo_map;
uniform mat3 albedo_uv;
#endif
#ifdef EMISSION_MAP
uniform sampler2D emission_map;
uniform mat3 emission_uv;
#endif
#ifdef ALPHA_MASK
uniform vec2 alpha;           // factor, cutoff
#endif

#ifdef WRITE_ALBEDO
layout(location = WRITE_ALBEDO) out vec4 out_albedo;      // a: second number of the face normal
#endif
#ifdef WRITE_NORMAL
layout(location = WRITE_NORMAL) out vec4 out_normal;      // a: first number of the face normal
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
#ifdef WRITE_MOTION
in vec3 clip_now;
in vec3 clip_before;
layout(location = WRITE_MOTION) out vec4 out_motion;      // pixels, +y down; z: depth one frame ago / now; w: inverse depth
#endif

// Towards the viewer, from screen-space derivatives.
vec3 face_normal()
{
    vec3 n = cross(dFdx(position), dFdy(position));
    float square = dot(n, n);
    if (!(square > 0.0 && is_finite(square))) return -normalize(position);
    n *= inversesqrt(square);
    return dot(n, position) > 0.0 ? -n : n;
}

// The interpolated normal on the viewer's side of the face; the face normal where there is none.
vec3 shading_normal(vec3 face)
{
    float square = dot(normal, normal);
    if (!(square > 1e-12 && is_finite(square))) return face;
    vec3 n = normal * inversesqrt(square);
    return dot(n, face) < 0.0 ? -n : n;
}

void main()
{
    vec3 face = face_normal();  // before any discard, since it takes derivatives
    vec4 base = vec4(albedo, 1.0);
#ifdef ALBEDO_MAP
    base *= texture(albedo_map, (albedo_uv * vec3(uv, 1.0)).xy);
#endif
#ifdef VERTEX_COLOR
    base *= color;
#endif
#ifdef ALPHA_MASK
    if (!(base.a * alpha.x >= alpha.y)) discard;
#endif
    vec2 code = octahedral_encode(face);
#ifdef WRITE_ALBEDO
    out_albedo = vec4(sanitize_albedo(base.rgb), code.y);
#endif
#ifdef WRITE_NORMAL
    out_normal = vec4(shading_normal(face), code.x);
#endif
#ifdef WRITE_DEPTH
#ifdef GRID_CUBE
    out_depth = length(position);
#else
    out_depth = dot(-vec3(view_from_relative[0].z, view_from_relative[1].z, view_from_relative[2].z), position);
#endif
#endif
#ifdef WRITE_EMISSION
    vec3 light = emission;
#ifdef EMISSION_MAP
    light *= texture(emission_map, (emission_uv * vec3(uv, 1.0)).xy).rgb;
#endif
    bool front = gl_FrontFacing == (emission_flags.z > 0.0);
    out_emission = front || emission_flags.x > 0.5 ? vec4(sanitize_radiance(light), emission_flags.y) : vec4(0.0);
#endif
#ifdef WRITE_SPECULAR_ROUGHNESS
    out_specular_roughness = specular_roughness;
#endif
#ifdef WRITE_MOTION
    out_motion = vec4(0.0, 0.0, 0.0, UNIT_INVERSE_DEPTH * gl_FragCoord.z);  // z = near / depth
    if (clip_before.z > 0.0) {
        vec2 moved = clip_now.xy / clip_now.z - clip_before.xy / clip_before.z;
        out_motion.xyz = vec3(moved * image.xy * vec2(0.5, -0.5), clip_before.z / clip_now.z);
    }
#endif
}
