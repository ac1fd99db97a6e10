// Where reflected rays end that the screen does not show, or not without something before it, as app/passes/reflection_rays.py
// traces them on the CPU, and the environment along those that end nowhere; from glossy surfaces they go on, as in
// app/raycast/onward_rays.py. Light at their ends is drawn between this and reflection_light.comp.
layout(local_size_x = 8, local_size_y = 8) in;

#include "numbers.glsl"
#include "store_ray_ends.glsl"
#include "noise.glsl"
#include "visible_normals.glsl"
#include "ray_share.glsl"

// Shares of the length of a ray whose end the screen shows, between which it must be free: facets beside its ends are not where
// their smooth normals say.
const float FREE_FROM = 0.02, FREE_TO = 0.98;
const float MAX_UNIT_ERROR = 0.1;  // of a direction's squared length

layout(rgba32f, binding = 4) writeonly uniform image2D end_lobe;  // F0; roughness
layout(rgba32f, binding = 5) writeonly uniform image2D end_view;  // back along the ray; a: share of the lobe's highlights

uniform sampler2D reflection_origin;  // relative space
uniform sampler2D reflection_ray;     // direction; a: length, negative if the screen does not show the end
#ifdef HAS_ENVIRONMENT
uniform sampler2D environment;        // top row straight up
uniform float rotation;               // counter-clockwise about +y seen from above, in full circles
#endif
uniform vec3 local_eye;               // in local space: world axes, the scene's centre as origin
uniform float ray_epsilon;            // by which rays that go on start off their surface, scene units
uniform vec2 noise_offset;            // of the patterns that choose where they go on, in this frame
uniform float sky_distance;           // length of rays that end nowhere, scene units

vec3 sky(vec3 along)
{
#ifdef HAS_ENVIRONMENT
    vec2 at = vec2(atan(along.x, -along.z) / (2.0 * PI) + 0.5 + rotation, acos(clamp(along.y, -1.0, 1.0)) / PI);
    return textureLod(environment, at, 0.0).rgb;
#else
    return vec3(0.0);
#endif
}

// What a ray in local space meets, or the sky as the emission of nothing; its length.
float trace(vec3 origin, vec3 along, float proxy_share, inout Surface end)
{
    Hit hit = nearest_hit(origin, along);
    bool met = hit.body >= 0;
    if (met) end = surface_at(hit, origin, along, proxy_share);
    else end.emission = sky(along);
    return met ? hit.distance : sky_distance;
}

// Of sharp lobes, emission that rays which go on meet is the highlight.
void store_lobe(ivec2 texel, Surface s, vec3 along)
{
    float blurred = smoothstep(SHARP_HIGHLIGHT, BROAD_HIGHLIGHT, s.roughness);
    imageStore(end_lobe, texel, vec4(s.f0, s.roughness));
    imageStore(end_view, texel, vec4(-along, blurred));
}

// Whether a ray's end that the screen shows is hidden from where it starts, by what its march has stepped over.
bool is_hidden(vec3 origin, vec4 ray)
{
    bool is_shown = ray.a > 0.0 && is_finite(ray.a);
    Hit hit = nearest_hit(origin + FREE_FROM * ray.a * ray.xyz, ray.xyz);
    return is_shown && hit.body >= 0 && hit.distance < (FREE_TO - FREE_FROM) * ray.a;
}

// Stores ends of first rays in the lower half of the images, and those of rays that go on in the upper half.
void main()
{
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(reflection_ray, 0);
    if (texel.x >= size.x || texel.y >= size.y) return;
    vec4 ray = texelFetch(reflection_ray, texel, 0);
    vec3 origin = texelFetch(reflection_origin, texel, 0).xyz + local_eye;
    Surface end = NO_SURFACE, beyond = NO_SURFACE;
    vec3 more_direct = vec3(0.0);
    vec3 onward = vec3(0.0);
    float distance = 0.0;  // where no ray was traced; negative where one goes on
    bool is_valid = abs(dot(ray.xyz, ray.xyz) - 1.0) < MAX_UNIT_ERROR && is_finite(dot(origin, vec3(1.0)));
    if (is_valid && (ray.a < 0.0 || is_hidden(origin, ray))) {
        distance = trace(origin, ray.xyz, 0.0, end);
        float n_v = -dot(ray.xyz, end.normal), share = onward_share(end.f0, end.roughness, n_v);
        if (share > 0.0) {
            vec3 mirrored = share * specular_albedo(end.f0, end.roughness, n_v);
            vec3 instead = share * specular_albedo(end.f0, end.roughness, MEAN_COSINE);
            float sharp = 1.0 - smoothstep(SHARP_HIGHLIGHT, BROAD_HIGHLIGHT, end.roughness);
            vec3 for_direct = min(end.albedo - sharp * instead, 1.0 - sharp * mirrored);
            end.albedo = min(end.albedo - instead, 1.0 - mirrored);
            more_direct = for_direct - end.albedo;
            vec2 u = fract(vec2(texel_noise(vec2(texel)), texel_noise(vec2(texel.y, size.x - texel.x))) + noise_offset);
            onward = reflected(-ray.xyz, end.normal, end.face, end.roughness * end.roughness, u);
            float further = trace(end.position + ray_epsilon * end.face, onward, sharp, beyond);
            distance = -(dot(mirrored - end.albedo, vec3(1.0)) > 0.0 ? distance + further : distance);
            beyond.albedo *= mirrored;
            beyond.emission *= mirrored;
            beyond.f0 *= mirrored;  // of which the lobe's light is about a multiple
        }
    }
    store_ray_end(texel, end, distance, more_direct);
    store_lobe(texel, end, ray.xyz);
    store_ray_end(texel + ivec2(0, size.y), beyond, 0.0, vec3(0.0));
    store_lobe(texel + ivec2(0, size.y), beyond, onward);
}
