// Normals of normal maps in the space of MikkTSpace (Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited").
const float MIN_FACING = 1e-2;  // cosine between a mapped normal and the face's

// The unit normal of a map's texel; face is on the viewer's side. mesh: interpolated, with its sign of a mirrored
// transform (side), as is the tangent, in whose w is the sign of the bitangent.
vec3 mapped_normal(vec3 texel, float scale, vec3 mesh, vec4 tangent, float side, vec3 face)
{
    vec3 slope = (texel * 2.0 - 1.0) * vec3(scale, scale, 1.0), front = side * mesh;
    vec3 n = slope.x * tangent.xyz + slope.y * tangent.w * cross(mesh, tangent.xyz) + slope.z * front;
    float square = dot(n, n);
    if (!(square > 1e-12 && is_finite(square))) return face;
    return n * (dot(front, face) < 0.0 ? -inversesqrt(square) : inversesqrt(square));
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
