// The scene's lights and the irradiance that each sends to an unoccluded receiver.
#include "numbers.glsl"
#include "rect_form.glsl"

const int POINT = 0;
const int SPOT = 1;
const int DIRECTIONAL = 2;
const int RECT = 3;
const float IN_PLANE = 1e-4;  // of a rectangle's size

struct Light {
    vec4 position;  // relative space (directional: unit vector towards the light); w: radius, or its tangent
    vec4 color;     // intensity, irradiance or radiance; w: kind
    vec4 u;         // rectangle: half edge; spot: axis; directional: x = half width of its map
    vec4 v;         // rectangle: half edge, w = two-sided; spot: inner and outer half angle in radians
    vec4 tile;      // shadow map: corner and face size in texels, kind of map
    vec4 frame_x;   // axes of a single map
    vec4 frame_y;
    vec4 frame_z;
};

layout(std140) uniform LightBlock {
    Light lights[LIGHT_COUNT > 0 ? LIGHT_COUNT : 1];
};

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

// Irradiance in W/m² (times the scene's scale) at relative point p with unit normal n.
vec3 irradiance(Light light, vec3 p, vec3 n)
{
    int kind = int(light.color.w);
#ifdef HAS_DIRECTIONAL_LIGHT
    if (kind == DIRECTIONAL) return light.color.rgb * max(dot(n, light.position.xyz), 0.0);
#endif
    vec3 to_light = light.position.xyz - p;
#ifdef HAS_RECT_LIGHT
    if (kind == RECT) {
        vec3 facing = cross(light.u.xyz, light.v.xyz);
        float side = -dot(to_light, facing);
        // In the light's own plane, where the surface lies that shows it, rounding would choose between all and none.
        float least = IN_PLANE * length(facing) * (length(light.u.xyz) + length(light.v.xyz));
        if (abs(side) <= least || (side < 0.0 && light.v.w < 0.5)) return vec3(0.0);
        vec3 form = rect_form(to_light, light.u.xyz, light.v.xyz, clip_rect(to_light, light.u.xyz, light.v.xyz, n));
        return light.color.rgb * abs(dot(form, n));
    }
#endif
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
}
