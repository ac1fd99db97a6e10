// Normals of normal maps in the space of MikkTSpace (Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited").
const float MIN_FACING = 1e-2;   // cosine between a mapped normal and the face's, or the viewer
const float SPREAD_SCALE = 4.0;  // of the square of what tilts normals, in the alpha of their maps
const float MIN_SPREAD = 2e-3;   // of that square, the rounding of eight bits
const float VISIBLE = 0.8;       // sqrt(2 / π): edge on, the mean slope is its inverse, in deviations

// The unit normal of a map's texel; face is on the viewer's side. mesh: interpolated, with its sign of a mirrored
// transform (side), as is the tangent, in whose w is the sign of the bitangent. v: towards the viewer, to whom the bumps that a texel
// averages show more of their slopes that face it: of normally distributed ones, weighted by their projected area, the mean.
vec3 mapped_normal(vec4 texel, float scale, vec3 mesh, vec4 tangent, float side, vec3 face, vec3 v)
{
    vec3 slope = (texel.xyz * 2.0 - 1.0) * vec3(scale, scale, 1.0), front = side * mesh;
    vec3 n = slope.x * tangent.xyz + slope.y * tangent.w * cross(mesh, tangent.xyz) + slope.z * front;
    float square = dot(n, n);
    if (!(square > 1e-12 && is_finite(square))) return face;
    n *= dot(front, face) < 0.0 ? -inversesqrt(square) : inversesqrt(square);
    float spread = max(scale * scale * (texel.a / SPREAD_SCALE - MIN_SPREAD) - dot(slope.xy, slope.xy), 0.0);
    float cosine = max(dot(n, v), MIN_FACING);
    vec3 across = v - dot(n, v) * n;  // as long as the sine
    float tangent_of_view = length(across) / cosine, reach = VISIBLE * tangent_of_view;
    // Within 0.09 deviations of the integral.
    float tilt = 0.5 * spread * tangent_of_view * inversesqrt(1.0 + 0.5 * spread * reach * reach);
    return tangent_of_view > 0.0 ? normalize(n + across * (tilt / (cosine * tangent_of_view))) : n;
}

// Bends a normal so that it faces the side of the face, and so that what is mirrored in it is above the face (Keller et
// al. 2017, "The Iray Light Transport Simulation and Rendering System", appendix A.3). v: towards the viewer.
vec3 bend_above_face(vec3 n, vec3 face, vec3 v)
{
    n = normalize(n + face * max(MIN_FACING - dot(n, face), 0.0));
    vec3 mirrored = reflect(-v, n);
    float height = dot(mirrored, face);
    return height < 0.0 ? normalize(v + normalize(mirrored - n * (height / max(dot(n, face), MIN_FACING)))) : n;
}
