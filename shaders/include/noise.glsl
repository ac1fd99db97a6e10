// Noise for sampling patterns.
uniform float noise_phase;  // turns the patterns, from the seed

// Fixed per texel, so that still pictures stay still (Jimenez 2014, interleaved gradient noise).
float texel_noise(vec2 pixel)
{
    return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715))) + noise_phase);
}
