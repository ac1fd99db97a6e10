// Integrals of linearly transformed cosines over the solid angle of a rectangle, as far as it is above the receiver's
// horizon: Lambert's polygon formula.
#include "numbers.glsl"

const float MIN_SQUARE = 1e-30;         // of a length, so that points without one give no NaN
const float MIN_RISE = 1e-20;           // of an edge, so that its crossing of the horizon is a number
const float MIN_COSINE_SQUARE = 4e-12;  // of half the angle between opposite directions, whose plane rounding decides; times 4

// A cosine lobe whose directions have undergone a linear map.
struct Cosine {
    mat3 transform;  // to the space where the lobe is a cosine
    vec3 axis;       // times the normal of the plane through two points and the receiver: the share of the edge between them
};

// A point in the lobe's space.
struct Vertex {
    vec3 at;
    float distance;
};

Vertex vertex(vec3 at)
{
    return Vertex(at, sqrt(max(dot(at, at), MIN_SQUARE)));
}

// The angle between a and b over the length of a x b. Angle / sine is f(c) / c with c the cosine of half the angle and
// f(c) = acos(c) / sqrt(1 - c²), a rational function as in Hill and Heitz 2016, "Real-Time Area Lighting: a Journey from
// Research to Production", fitted to 6e-7. The bisector keeps c exact for opposite directions, to which narrow lobes map.
float edge_form(Vertex a, Vertex b)
{
    vec3 bisector = b.distance * a.at + a.distance * b.at;
    float p = a.distance * b.distance, p2 = p * p;
    float s2 = max(dot(bisector, bisector), MIN_COSINE_SQUARE * p2), s = sqrt(s2), ps = p * s;  // 2 c = s / p
    return (3.1415909 * p2 + 0.90581268 * ps + 0.01301606 * s2) / (s * (p2 + 0.606619175 * ps + 0.0723501275 * s2));
}

// Integral of the lobe over the solid angle of the rectangle center ± u ± v above the horizon of normal n; negative where
// the receiver is on the side of u x v.
float rect_form(vec3 center, vec3 u, vec3 v, vec3 n, Cosine lobe)
{
    float scale = inversesqrt(max(dot(center, center) + dot(u, u) + dot(v, v), MIN_SQUARE));
    center *= scale;
    vec2 rise = vec2(dot(u, n), dot(v, n)), toward = scale * mix(vec2(-1.0), vec2(1.0), greaterThanEqual(rise, vec2(0.0)));
    u *= toward.x;  // both rise, so that center + u + v is the highest corner
    v *= toward.y;
    rise = max(abs(rise) * scale, MIN_RISE);
    // What is above the horizon has five corners, some of which may coincide: those of u and v equal to (1, 1), (1, low.y),
    // (far.x, low.y), (low.x, far.y) and (low.x, 1). From the third to the fourth it goes along the horizon.
    float height = dot(center, n);
    vec2 low = clamp((-height - rise.yx) / rise, -1.0, 1.0), far = clamp((rise.yx - height) / rise, -1.0, 1.0);

    // Normals of the planes through edges are sums of three cross products, which the clipping only shortens.
    vec3 across_u = cross(u, lobe.axis), across_v = cross(v, lobe.axis);
    float side_u = dot(center, across_u), side_v = dot(center, across_v), facing = -dot(v, across_u);
    center = lobe.transform * center;
    u = lobe.transform * u;
    v = lobe.transform * v;
    vec3 right = center + u, top = center + v, bottom = center + low.y * v, left = center + low.x * u;
    Vertex a = vertex(right + v), b = vertex(right + low.y * v), c = vertex(bottom + far.x * u),
           d = vertex(left + far.y * v), e = vertex(top + low.x * u);
    float gap = (low.x - far.x) * side_u + (far.y - low.y) * side_v + (far.x * far.y - low.x * low.y) * facing;
    float sum = (low.y - 1.0) * (side_v + facing) * edge_form(a, b)
        + (far.x - 1.0) * (side_u - low.y * facing) * edge_form(b, c)
        + gap * edge_form(c, d)
        + (1.0 - far.y) * (side_v + low.x * facing) * edge_form(d, e)
        + (1.0 - low.x) * (side_u - facing) * edge_form(e, a);
    return toward.x * toward.y > 0.0 ? -0.5 * sum : 0.5 * sum;
}
