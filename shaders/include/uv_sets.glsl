// Texture coordinates of a surface: one or two sets.
#ifdef UV
in vec2 uv;
#ifdef SECOND_UV
in vec2 second_uv;
#endif

// Where a map is read; in the last row of its transform, of which nothing else is needed, is the number of its uv set.
vec2 map_at(mat3 transform)
{
#ifdef SECOND_UV
    return (transform * vec3(transform[0].z > 0.5 ? second_uv : uv, 1.0)).xy;
#else
    return (transform * vec3(uv, 1.0)).xy;
#endif
}
#endif
