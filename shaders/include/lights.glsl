// The irradiance that each light sends to an unoccluded receiver.
#include "numbers.glsl"
#include "light.glsl"
#include "light_image.glsl"
#include "rect_form.glsl"

// Irradiance form factor times pi of a sphere seen under cosine c at distance / radius h, with the part
// below the horizon left out (Lagarde and de Rousiers 2014, "Moving Frostbite to PBR", section 4.7.3).
float sphere_form(float c, float h)
{
    h = max(h, 1.0001);
    if (h * c > 1.0) return PI * c / (h * h);
    if (h * c < -1.0) return 0.0;
    float s = sqrt(max(1.0 - c * c, 1e-8));
    float x = sqrt(h * h - 1.0);
    float y = clamp(-x * c / s, -1.0, 1.0);
    float root = s * sqrt(1.0 - y * y);
    return max((c * acos(y) - x * root) / (h * h) + atan(root / x), 0.0);
}

float spot_falloff(Light light, vec3 to_light)
{
    float angle = acos(clamp(dot(-to_light, light.u.xyz), -1.0, 1.0));
    float width = light.v.y - light.v.x;
    return width > 0.0 ? clamp((light.v.y - angle) / width, 0.0, 1.0) : float(angle <= light.v.y);
}

#ifdef NORMAL_MAPS
// Share of a light that is in front of the face through relative point p, about that of a disc's segment. Of lights without
// a size it is all: their shadows hide what faces away.
float share_in_front(Light light, vec3 p, vec3 face)
{
    int kind = int(light.color.w);
    float height = dot(face, kind == DIRECTIONAL ? light.position.xyz : light.position.xyz - p);
    float reach = kind == RECT ? abs(dot(face, light.u.xyz)) + abs(dot(face, light.v.xyz)) : light.position.w;
    return reach > 0.0 ? smoothstep(-reach, reach, height) : 1.0;
}
#endif

// -1 or 1 for a receiver in front of or behind a rectangle that emits there, else 0. In its own plane, where the surface
// lies that shows it, nothing arrives.
float rect_side(Light light, vec3 to_light)
{
    float behind = dot(to_light, light.frame_z.xyz);
    return abs(behind) > light.u.w && (behind < 0.0 || light.v.w > 0.5) ? sign(behind) : 0.0;
}

// What a cosine lobe at relative point p with unit normal n gathers of a rectangle of radiance 1.
float rect_light(Light light, vec3 p, vec3 n, Cosine lobe)
{
    vec3 to_light = light.position.xyz - p;
    return rect_form(to_light, light.u.xyz, light.v.xyz, n, lobe) * rect_side(light, to_light);
}

// Irradiance in W/m² (times the scene's scale) at relative point p with unit normal n, as if no light had an image.
vec3 irradiance(Light light, vec3 p, vec3 n)
{
    int kind = int(light.color.w);
#ifdef HAS_DIRECTIONAL_LIGHT
    if (kind == DIRECTIONAL) return light.color.rgb * max(dot(n, light.position.xyz), 0.0);
#endif
    vec3 to_light = light.position.xyz - p;
#ifdef HAS_RECT_LIGHT
    if (kind == RECT) return light.color.rgb * max(rect_light(light, p, n, Cosine(mat3(1.0), n)), 0.0);
#endif
#if defined(HAS_POINT_LIGHT) || defined(HAS_SPOT_LIGHT)
    float square = max(dot(to_light, to_light), 1e-30);
    float distance = sqrt(square);
    to_light /= distance;
    float c = dot(n, to_light);
    float radius = light.position.w;
    float form = max(c, 0.0) / square;
#ifdef HAS_SOFT_LIGHT
    if (radius > 0.0) form = sphere_form(c, distance / radius) / (PI * radius * radius);
#endif
#ifdef HAS_SPOT_LIGHT
    if (kind == SPOT) form *= spot_falloff(light, to_light);
#endif
    return light.color.rgb * form;
#else
    return vec3(0.0);
#endif
}

// The same with images, which only lights with traced shadows have.
vec3 traced_irradiance(Light light, vec3 p, vec3 n)
{
    vec3 e = irradiance(light, p, n);
#ifdef HAS_LIGHT_IMAGES
    e *= image_around(light, p, n);
#endif
    return e;
}
