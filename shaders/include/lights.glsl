// The scene's lights and the irradiance that each sends to an unoccluded receiver.
#include "numbers.glsl"

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

// Signed angle between two unit vectors times the cosine of the plane that they span.
float edge_term(vec3 a, vec3 b, vec3 n)
{
    vec3 c = cross(a, b);
    float s = length(c);
    return s > 0.0 ? atan(s, dot(a, b)) * dot(c / s, n) : 0.0;
}

// Integral of cosine over a rectangle's solid angle above the receiver's horizon: Lambert's polygon formula.
// Each edge is clipped at the horizon; the gap that clipping opens is closed along it.
float rect_form(vec3 center, vec3 u, vec3 v, vec3 n)
{
    vec3 corners[4] = vec3[4](center - u - v, center + u - v, center + u + v, center - u + v);
    vec3 leaving = vec3(0.0), entering = vec3(0.0);
    float sum = 0.0;
    bool clipped = false;
    for (int i = 0; i < 4; ++i) {
        vec3 a = corners[i], b = corners[(i + 1) & 3];
        float ha = dot(a, n), hb = dot(b, n);
        if (ha <= 0.0 && hb <= 0.0) continue;
        vec3 crossing = normalize(a + (b - a) * clamp(ha / (ha - hb), 0.0, 1.0));
        if (ha > 0.0 && hb <= 0.0) {
            leaving = crossing;
            clipped = true;
        }
        if (ha <= 0.0 && hb > 0.0) entering = crossing;
        vec3 from = ha > 0.0 ? normalize(a) : crossing;
        vec3 to = hb > 0.0 ? normalize(b) : crossing;
        sum += edge_term(from, to, n);
    }
    if (clipped) sum += edge_term(leaving, entering, n);
    return 0.5 * abs(sum);
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
        return light.color.rgb * rect_form(to_light, light.u.xyz, light.v.xyz, n);
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
