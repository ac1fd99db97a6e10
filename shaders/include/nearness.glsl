// Nearness: the inverse of depth, 1 at UNIT_NEARNESS near planes from the camera; 0 for sky and for what is no depth.
// So half precision holds it to 1 % from the near plane to where the scene is a dot.
const float UNIT_NEARNESS = 1000.0;

float nearness(float depth, float near)
{
    return depth > 0.0 ? UNIT_NEARNESS * near / depth : 0.0;
}
