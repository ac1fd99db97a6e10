// Points of lights with an area, for shadow rays whose unshadowed light is known.
// Rectangles are sampled by solid angle (Ureña, Fajardo and King 2013, "An Area-Preserving Parametrization for
// Spherical Rectangles"), warped by the cosines at the corners (Hart, Pharr, Müller, Lopes, McGuire and Shirley 2020,
// "Practical Product Sampling by Fitting and Composing Warps"); spheres by the cone that they fill.
#include "lights.glsl"

const float MIN_SOLID_ANGLE = 1e-3;    // below it rounding spoils the spherical rectangle, and area will do
const float INSIDE = 1.001;            // of the squared radius, within which a receiver counts as inside of a sphere
const float MAX_SINE_SQUARE = 0.9999;  // of the half angle at which a sphere is seen, also from inside
const float MIN_CORNER_COSINE = 0.05;  // so that corners below the horizon don't hide what lies between them

const float LUMINANCE_FLOOR = 1e-30;
const int POINT_CANDIDATES = 4;        // of emission points, of which one is chosen, as of the environment's directions

#ifdef HAS_EMISSION_POINTS
const float EVEN_SHARE_OF_HALVES = 0.1;  // of the choice of a half that knows nothing of it

// A light has five rows: offset from its centre and squared radius of a disc of the point's area; normal and whether the back emits
// too; intensity along the normal; nodes of the tree, the halves of node k at 2 k and 2 k + 1: centre, squared radius; each node's
// share of the light in each channel.
uniform sampler2D emission_points;
#endif

struct LightSample {
    vec3 vector;  // from the receiver to a point of the light
    vec3 light;   // irradiance that it sends, over the density of the sample
    bool meets_proxies;  // whether light proxies are in the way of its ray
};

// Whether a candidate replaces the one that was chosen before it, by pick in [0, 1); adds its target to the total. What is
// left of the number is as random as it was.
bool replaces(float target, inout float total, inout float pick)
{
    float before = total;
    total += target;
    bool take = target > 0.0 && pick * total < target;
    pick = take ? pick * total / target : before > 0.0 ? (pick * total - target) / before : pick;
    return take;
}

// A rectangle in the axes of its edges, as seen from the receiver.
struct SphericalRectangle {
    mat3 axes;    // columns: along u, along v, towards the receiver's side
    vec3 low;     // corner; z < 0
    vec2 high;    // opposite corner
    vec2 edge_z;  // b0 and b1 of the paper
    float start;  // k
    float solid_angle;
};

SphericalRectangle spherical_rectangle(vec3 center, vec3 u, vec3 v)
{
    SphericalRectangle r;
    vec2 half_size = vec2(length(u), length(v));
    vec3 x = u / half_size.x, y = v / half_size.y, z = cross(x, y);
    if (dot(center, z) > 0.0) z = -z;
    r.axes = mat3(x, y, z);
    vec3 local = center * r.axes;
    r.low = vec3(local.xy - half_size, local.z);
    r.high = local.xy + half_size;
    // Normals of the planes through the receiver and each edge.
    vec3 n0 = normalize(vec3(0.0, local.z, -r.low.y)), n1 = normalize(vec3(-local.z, 0.0, r.high.x));
    vec3 n2 = normalize(vec3(0.0, -local.z, r.high.y)), n3 = normalize(vec3(local.z, 0.0, -r.low.x));
    float g0 = acos(clamp(-dot(n0, n1), -1.0, 1.0)), g1 = acos(clamp(-dot(n1, n2), -1.0, 1.0));
    float g2 = acos(clamp(-dot(n2, n3), -1.0, 1.0)), g3 = acos(clamp(-dot(n3, n0), -1.0, 1.0));
    r.edge_z = vec2(n0.z, n2.z);
    r.start = 2.0 * PI - g2 - g3;
    r.solid_angle = g0 + g1 - r.start;
    return r;
}

// The point of a spherical rectangle at s in [0, 1)², uniform in solid angle.
vec3 spherical_point(SphericalRectangle r, vec2 s)
{
    float angle = s.x * r.solid_angle + r.start;
    float f = (cos(angle) * r.edge_z.x - r.edge_z.y) / sin(angle);
    float c = clamp((f > 0.0 ? 1.0 : -1.0) * inversesqrt(f * f + r.edge_z.x * r.edge_z.x), -1.0, 1.0);
    float x = clamp(-c * r.low.z * inversesqrt(max(1.0 - c * c, 1e-12)), r.low.x, r.high.x);
    float d = sqrt(x * x + r.low.z * r.low.z);
    float h0 = r.low.y * inversesqrt(d * d + r.low.y * r.low.y), h1 = r.high.y * inversesqrt(d * d + r.high.y * r.high.y);
    float h = mix(h0, h1, s.y);
    return r.axes * vec3(x, clamp(h * d * inversesqrt(max(1.0 - h * h, 1e-12)), r.low.y, r.high.y), r.low.z);
}

// Number in [0, 1) with a density that goes linearly from a to b.
float sample_linear(float s, float a, float b)
{
    return min(s * (a + b) / max(a + sqrt(mix(a * a, b * b, s)), 1e-20), 0.99999994);
}

float corner_cosine(vec3 corner, vec3 n)
{
    return max(dot(normalize(corner), n), MIN_CORNER_COSINE);
}

LightSample sample_rectangle(Light light, vec3 to_light, vec3 n, vec2 s)
{
    vec3 u = light.u.xyz, v = light.v.xyz;
    vec2 low = vec2(corner_cosine(to_light - u - v, n), corner_cosine(to_light + u - v, n));
    vec2 high = vec2(corner_cosine(to_light - u + v, n), corner_cosine(to_light + u + v, n));
    s.y = sample_linear(s.y, low.x + low.y, high.x + high.y);
    vec2 row = mix(low, high, s.y);
    s.x = sample_linear(s.x, row.x, row.y);
    float density = 4.0 * mix(row.x, row.y, s.x) / (low.x + low.y + high.x + high.y);
    SphericalRectangle r = spherical_rectangle(to_light, u, v);
    vec3 point = spherical_point(r, s);
    float solid_angle = r.solid_angle;
    if (!(solid_angle > MIN_SOLID_ANGLE)) {
        point = to_light + (2.0 * s.x - 1.0) * u + (2.0 * s.y - 1.0) * v;
        float square = dot(point, point);
        solid_angle = 4.0 * abs(dot(point, cross(u, v))) / max(square * sqrt(square), 1e-30);
    }
    vec3 radiance = light.color.rgb;
    bool has_image = false;  // of a surface with a texture, whose parts may hide each other, as flames on crossed cards do
#ifdef HAS_LIGHT_IMAGES
    has_image = image_layer(light) >= 0.0;
    radiance *= image_at(light, point - to_light, RAY_LEVEL);
#endif
    return LightSample(point, radiance * (solid_angle * max(dot(normalize(point), n), 0.0) / density), has_image);
}

LightSample sample_sphere(Light light, vec3 to_light, vec3 n, vec2 s)
{
    float square = max(dot(to_light, to_light), 1e-30), radius = light.position.w;
    float sine2 = min(radius * radius / square, MAX_SINE_SQUARE);
    // 1 - cosine of the cone, which rounding would spoil for small ones.
    float height = s.x * sine2 / (1.0 + sqrt(1.0 - sine2));
    float c = 1.0 - height, side = sqrt(max(height * (2.0 - height), 0.0));
    vec3 axis = to_light * inversesqrt(square);
    vec3 tangent = normalize(abs(axis.y) < 0.9 ? vec3(axis.z, 0.0, -axis.x) : vec3(0.0, -axis.z, axis.y));
    float turn = 2.0 * PI * s.y;
    vec3 direction = axis * c + (tangent * cos(turn) + cross(axis, tangent) * sin(turn)) * side;
    float distance = sqrt(square) * c - sqrt(max(radius * radius - square * side * side, 0.0));
    // From inside, nothing is in the way.
    vec3 vector = square > INSIDE * radius * radius ? direction * distance : n * (radius * 1e-3);
    // Radiance times the solid angle of the cone, without a division by a radius that may be 0.
    vec3 facing = light.color.rgb * (2.0 / ((1.0 + sqrt(1.0 - sine2)) * max(square, radius * radius / MAX_SINE_SQUARE)));
#ifdef HAS_SPOT_LIGHT
    if (int(light.color.w) == SPOT) facing *= spot_falloff(light, axis);
#endif
    return LightSample(vector, facing * max(dot(direction, n), 0.0), false);
}

#ifdef HAS_EMISSION_POINTS
// How much light points of a node send, about.
float importance(int node, int row, vec3 to_light, vec3 n)
{
    vec4 ball = texelFetch(emission_points, ivec2(node, row + 3), 0);
    vec3 vector = to_light + ball.xyz;
    float square = max(dot(vector, vector) + ball.w, 1e-30);
    return max(dot(vector, n) + sqrt(ball.w), 0.0) * inversesqrt(square) / square;
}

// A place in the order of a light's points.
struct Place {
    float at;       // in [0, 1)
    float density;  // over that of places spread evenly
};

// The place that is chosen for pick in [0, 1): down the tree, by which half is nearer (as in Conty Estevez and Kulla 2018,
// "Importance Sampling of Many Lights with Adaptive Tree Splitting").
Place choose_place(int row, vec3 to_light, vec3 n, float pick)
{
    int node = 1;
    float density = 1.0;
    for (int level = 0; level < POINT_LEVELS; ++level) {
        float one = importance(2 * node, row, to_light, n), total = one + importance(2 * node + 1, row, to_light, n);
        float share = mix(total > 0.0 ? one / total : 0.5, 0.5, EVEN_SHARE_OF_HALVES);
        bool is_first = pick < share;
        density *= 2.0 * (is_first ? share : 1.0 - share);
        pick = min(is_first ? pick / share : (pick - share) / (1.0 - share), 0.99999994);
        node = 2 * node + (is_first ? 0 : 1);
    }
    return Place((float(node) + pick) / float(1 << POINT_LEVELS) - 1.0, density);
}

// A point of the surfaces that a light only approximates: what holds them, and they themselves, may be in the way.
LightSample sample_emission_points(Light light, vec3 to_light, vec3 n, vec2 s)
{
    int row = int(light.tile.x);
    LightSample chosen = LightSample(to_light, vec3(0.0), true);
    float total = 0.0, chosen_target = 0.0, pick = s.y;
    for (int i = 0; i < POINT_CANDIDATES; ++i) {
        Place place = choose_place(row, to_light, n, fract(s.x + float(i) / float(POINT_CANDIDATES)));
        int index = int(min(place.at * light.tile.y, light.tile.y - 1.0));
        vec4 at = texelFetch(emission_points, ivec2(index, row), 0);
        vec4 facing = texelFetch(emission_points, ivec2(index, row + 1), 0);
        vec3 intensity = texelFetch(emission_points, ivec2(index, row + 2), 0).rgb;
        vec3 vector = to_light + at.xyz;
        float square = max(dot(vector, vector), 1e-30), emitted = -dot(vector, facing.xyz);
        float cosines = (facing.w > 0.5 ? abs(emitted) : max(emitted, 0.0)) * max(dot(vector, n), 0.0) / square;
        vec3 received = intensity * (light.tile.y * cosines / ((square + at.w) * place.density));
        float target = luminance(received);
        bool take = replaces(target, total, pick);
        chosen.vector = take ? vector : chosen.vector;
        chosen.light = take ? received : chosen.light;
        chosen_target = take ? target : chosen_target;
    }
    chosen.light *= total / (float(POINT_CANDIDATES) * max(chosen_target, LUMINANCE_FLOOR));
    return chosen;
}
#endif

// A point of ``light`` for s in [0, 1)², as seen from relative point p with unit normal n.
LightSample sample_light(Light light, vec3 p, vec3 n, vec2 s)
{
    vec3 to_light = light.position.xyz - p;
#ifdef HAS_EMISSION_POINTS
    if (light.tile.y > 0.5) return sample_emission_points(light, to_light, n, s);
#endif
#ifdef HAS_RECT_LIGHT
    if (int(light.color.w) == RECT) return sample_rectangle(light, to_light, n, s);
#endif
    return sample_sphere(light, to_light, n, s);
}
