// Rays through the scene's triangles, as Caster on the CPU traces them. app/raycast/gpu_rays.py fills the buffers.
// Bounding volumes are complete binary trees, numbered as in a heap; triangles are intersected as in Möller and Trumbore
// 1997, "Fast, Minimum Storage Ray/Triangle Intersection".
const int LEAF = 4;             // triangles, as in app/raycast/hierarchy.py
const int STACK_SIZE = 28;      // nodes, more than the levels of a tree
const int IS_PROXY = 1, IS_ONE_SIDED = 2, IS_LIT_THROUGH = 4, IS_MIRRORED = 8;  // of a triangle
const float MIN_COMPONENT = 1e-20;  // of a direction, whose inverse must be finite

struct Body {
    vec4 to_body[3];   // rows of the matrix from local space: world axes, the scene's centre as origin
    ivec4 place;       // first node, number of leaves, first triangle
};

layout(std430, binding = 1) readonly buffer RayNodes { vec4 ray_nodes[]; };          // lowest and highest corner
// Corner and number; edge and flags; edge. Integers, since small ones are no floats that every driver keeps.
layout(std430, binding = 2) readonly buffer RayTriangles { ivec4 ray_triangles[]; };
layout(std430, binding = 3) readonly buffer RayBodies { Body ray_bodies[]; };
uniform int body_count;

struct Hit {
    float distance;  // in lengths of the direction
    int body;        // -1 for none
    int triangle;    // number among all
    int flags;
    vec2 uv;         // barycentric coordinates of the second and third corner
    vec3 face;       // normal of the triangle in the body's space, of any length
};

vec3 by_rows(vec4 rows[3], vec4 v)
{
    return vec3(dot(rows[0], v), dot(rows[1], v), dot(rows[2], v));
}

// Where a ray enters a node's box; beyond end if it doesn't.
float entry(int node, vec3 origin, vec3 inverse, float end)
{
    vec3 low = (ray_nodes[2 * node].xyz - origin) * inverse, high = (ray_nodes[2 * node + 1].xyz - origin) * inverse;
    vec3 near = min(low, high), far = max(low, high);
    float enters = max(max(near.x, near.y), max(near.z, 0.0)), leaves = min(min(far.x, far.y), min(far.z, end));
    return enters <= leaves ? enters : 3e38;
}

// Update the hit where the ray meets a triangle nearer than its distance. Of one-sided triangles a ray finds the fronts only.
// Light, which moves against the ray, passes the backs of those that are lit through.
void intersect(int index, vec3 origin, vec3 along, bool is_light, bool proxies_block, int body, inout Hit hit)
{
    ivec4 first = ray_triangles[3 * index], second = ray_triangles[3 * index + 1];
    vec3 edge = intBitsToFloat(second.xyz), other = intBitsToFloat(ray_triangles[3 * index + 2].xyz);
    vec3 from = origin - intBitsToFloat(first.xyz), p = cross(along, other);
    float determinant = dot(edge, p), inverse = 1.0 / (determinant == 0.0 ? MIN_COMPONENT : determinant);
    vec3 q = cross(from, edge);
    float u = dot(from, p) * inverse, v = dot(along, q) * inverse, t = dot(other, q) * inverse;
    int flags = second.w;
    vec3 face = cross(edge, other);
    bool front = (dot(face, along) < 0.0) != (is_light != ((flags & IS_MIRRORED) != 0));
    int culled = is_light ? IS_LIT_THROUGH : IS_ONE_SIDED;
    bool counts = ((flags & culled) == 0 || front) && ((flags & IS_PROXY) == 0 || proxies_block);
    if (counts && determinant != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < hit.distance)
        hit = Hit(t, body, first.w, flags, vec2(u, v), face);
}

// Update the hit by one body; for light, the first triangle that is found will do.
void walk(int index, vec3 origin, vec3 along, bool is_light, bool proxies_block, inout Hit hit)
{
    Body body = ray_bodies[index];
    vec3 start = by_rows(body.to_body, vec4(origin, 1.0)), step = by_rows(body.to_body, vec4(along, 0.0));
    vec3 inverse = 1.0 / mix(step, vec3(MIN_COMPONENT), lessThan(abs(step), vec3(MIN_COMPONENT)));
    int first_node = body.place.x, leaves = body.place.y, stack[STACK_SIZE], top = 0, node = 1;
    if (leaves == 0 || entry(first_node + 1, start, inverse, hit.distance) > hit.distance) return;
    while (node > 0) {
        if (node >= leaves) {
            int first = body.place.z + (node - leaves) * LEAF;
            for (int i = 0; i < LEAF; ++i) intersect(first + i, start, step, is_light, proxies_block, index, hit);
            if (is_light && hit.body >= 0) return;
            node = 0;
        } else {
            int child = 2 * node;
            float t0 = entry(first_node + child, start, inverse, hit.distance);
            float t1 = entry(first_node + child + 1, start, inverse, hit.distance);
            int near = t0 <= t1 ? child : child + 1;
            bool meets = min(t0, t1) <= hit.distance, meets_both = max(t0, t1) <= hit.distance;
            if (meets_both) stack[top++] = near ^ 1;
            node = meets ? near : 0;
        }
        if (node == 0 && top > 0) node = stack[--top];
    }
}

// The nearest surface along a ray in local space, light proxies among them.
Hit nearest_hit(vec3 origin, vec3 along)
{
    Hit hit = Hit(3e37, -1, -1, 0, vec2(0.0), vec3(0.0));
    for (int i = 0; i < body_count; ++i) walk(i, origin, along, false, true, hit);
    return hit;
}

// Whether a surface blocks light from the end of a vector to its origin in local space.
bool is_occluded(vec3 origin, vec3 vector, bool proxies_block)
{
    Hit hit = Hit(1.0, -1, -1, 0, vec2(0.0), vec3(0.0));
    for (int i = 0; i < body_count && hit.body < 0; ++i) walk(i, origin, vector, true, proxies_block, hit);
    return hit.body >= 0;
}
