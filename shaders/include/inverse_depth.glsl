// Inverse depth, 1 at UNIT_INVERSE_DEPTH near planes from the camera; 0 for the sky and for invalid
// depths. So half precision holds it to 1 % from the near plane to where the scene is a dot.
const float UNIT_INVERSE_DEPTH = 1000.0;

float inverse_depth(float depth, float near)
{
    return depth > 0.0 ? UNIT_INVERSE_DEPTH * near / depth : 0.0;
}
