// The mean radiance of all inputs of a network, by which it is divided, and the partial sums that it is made from.
layout(std430, binding = 2) buffer MeanRadiance {
    float means[2];  // the second with each number clamped at MAX_RATIO_TO_MEAN times the first
    vec2 sums[];     // sum, count
};
