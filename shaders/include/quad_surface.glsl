// What the four texels of a quad have in common if they show one flat surface, whose light they then share.
#include "camera.glsl"
#include "numbers.glsl"
#include "quad.glsl"

const float MAX_TILT = 0.1;     // of a texel's normal from the quad's, and of its offset from the quad's centre to the plane
const float MAX_HEIGHT = 1e-3;  // of a texel above that plane, of its depth_scale

struct QuadSurface {
    vec3 p;        // the quad's centre, relative space
    vec3 n;
    bool is_flat;  // the others have a meaning only if it is
};

// Of texels that show points p with unit normals n.
QuadSurface quad_surface(vec3 p, vec3 n, float depth)
{
    vec3 center = 0.25 * quad_sum(p), sum = quad_sum(n);
    vec3 normal = sum * inversesqrt(max(dot(sum, sum), 1e-30)), to = p - center, tilt = n - normal;
    float height = abs(dot(to, normal));
    bool fits = is_surface(depth) && dot(tilt, tilt) < MAX_TILT * MAX_TILT
        && height * height < MAX_TILT * MAX_TILT * dot(to, to) && height < MAX_HEIGHT * depth_scale(depth);
    return QuadSurface(center, normal, quad_all(fits));
}
