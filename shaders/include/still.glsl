const float STILL_PIXELS = 0.01;  // motion below which a texel counts as still

bool is_still(vec2 motion)
{
    return dot(motion, motion) < STILL_PIXELS * STILL_PIXELS;
}
