// Six square views: front -z, back +z, left -x, right +x, up +y, down -y, side by side in one atlas row.
struct CubeFace {
    vec3 forward;
    vec3 right;
    vec3 up;
};

CubeFace cube_face(int index)
{
    float s = (index == 0 || index == 3 || index == 4) ? 1.0 : -1.0;
    if (index < 2) return CubeFace(vec3(0.0, 0.0, -s), vec3(s, 0.0, 0.0), vec3(0.0, 1.0, 0.0));
    if (index < 4) return CubeFace(vec3(s, 0.0, 0.0), vec3(0.0, 0.0, s), vec3(0.0, 1.0, 0.0));
    return CubeFace(vec3(0.0, s, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, s));
}

int cube_face_index(vec3 d)
{
    vec3 a = abs(d);
    if (a.z >= a.x && a.z >= a.y) return d.z < 0.0 ? 0 : 1;
    if (a.x >= a.y) return d.x < 0.0 ? 2 : 3;
    return d.y > 0.0 ? 4 : 5;
}
