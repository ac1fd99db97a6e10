// Where reflected rays end that the screen does not show, as app/passes/reflection_rays.py traces them on the CPU, and the
// environment along those that end nowhere. Light at their ends is drawn between this and reflection_light.comp.
layout(local_size_x = 8, local_size_y = 8) in;

#include "numbers.glsl"
#include "store_ray_ends.glsl"

const float MAX_UNIT_ERROR = 0.1;  // of a direction's squared length

uniform sampler2D reflection_origin;  // relative space
uniform sampler2D reflection_ray;     // direction; a: negative if the screen does not show the end
#ifdef HAS_ENVIRONMENT
uniform sampler2D environment;        // top row straight up
uniform float rotation;               // counter-clockwise about +y seen from above, in full circles
#endif
uniform vec3 local_eye;               // in local space: world axes, the scene's centre as origin
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

void main()
{
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(reflection_ray, 0);
    if (texel.x >= size.x || texel.y >= size.y) return;
    vec4 ray = texelFetch(reflection_ray, texel, 0);
    vec3 origin = texelFetch(reflection_origin, texel, 0).xyz + local_eye;
    Surface end = NO_SURFACE;
    float distance = 0.0;  // where no ray was traced
    if (ray.a < 0.0 && abs(dot(ray.xyz, ray.xyz) - 1.0) < MAX_UNIT_ERROR && is_finite(dot(origin, vec3(1.0)))) {
        Hit hit = nearest_hit(origin, ray.xyz);
        bool met = hit.body >= 0;
        distance = met ? hit.distance : sky_distance;
        if (met) end = surface_at(hit, origin, ray.xyz);
        else end.emission = sky(ray.xyz);
    }
    store_ray_end(texel, end, distance);
}
