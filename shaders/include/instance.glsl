// One instance of a mesh, from a buffer with a row for each: rows of the affine matrices from object to relative space.
in vec4 in_relative_x, in_relative_y, in_relative_z;

mat4 affine_matrix(vec4 x, vec4 y, vec4 z)
{
    return transpose(mat4(x, y, z, vec4(0.0, 0.0, 0.0, 1.0)));
}
