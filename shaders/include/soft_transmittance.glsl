// What blended and transmissive surfaces leave of a light with a size: the mean over its image at their mean distance, as
// percentage closer soft shadows have it of opaque ones (see shadow.glsl).
#ifdef HAS_SHADOW_TRANSMITTANCE_NEAREST
uniform sampler2D shadow_transmittance_nearest;

// The mean of what passes, whose last component counts the taps: of a texel's, or where none of them sees the light, of its
// quad's; or of those that found light beside opaque blockers, whose image of the light is another; or else what passes at
// the light's middle, since what is right before the receiver escapes the search in tiles.
vec3 mean_passing(vec4 sum, vec4 beside_blockers, vec3 at_middle, int taps, vec3 p, vec3 n)
{
    vec4 of_quad = vec4(quad_sum(sum.rgb), quad_sum(sum.a));
    vec4 beside = vec4(quad_sum(beside_blockers.rgb), quad_sum(beside_blockers.a));
    vec4 known = sum.a > 0.0 ? sum : of_quad.a > 0.0 ? of_quad : beside_blockers.a > 0.0 ? beside_blockers : beside;
    return blend_quad(known.a > 0.0 ? known.rgb / known.a : at_middle, taps, p, n);
}

#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
vec3 soft_radial_transmittance(Light light, Receiver r, QuadNoise noise, bool wanted, vec4 beside_blockers,
                               vec3 at_middle)
{
    bool has_any;
    Disc disc = blocker_disc(shadow_transmittance_nearest, light, r, noise, has_any);
    int taps = wanted && has_any ? PENUMBRA_TAPS : 0;
    Pattern pattern = quad_pattern(noise, PENUMBRA_TAPS);
    vec4 sum = vec4(0.0);
    for (int i = 0; i < taps; ++i) {
        vec3 q = tap(r, disc, next_point(pattern, is_square(light)));
        MapTexel t = texel_towards(light, q);
        bool is_shaded = relate(r, q, t.distance, r.offset).before;
        sum += is_shaded ? vec4(0.0) : vec4(transmittance_towards(light, r, q, t), 1.0);
    }
    return mean_passing(sum, beside_blockers, at_middle, taps, r.p, r.n);
}
#endif

#ifdef HAS_PARALLEL_MAP
vec3 soft_parallel_transmittance(Light light, ParallelReceiver r, vec3 p, vec3 n, QuadNoise noise, bool wanted,
                                 vec4 beside_blockers, vec3 at_middle)
{
    ParallelBlockers found = find_parallel_blockers(shadow_transmittance_nearest, light, r, noise);
    int taps = wanted && found.any ? PENUMBRA_TAPS : 0;
    Pattern pattern = quad_pattern(noise, PENUMBRA_TAPS);
    vec4 sum = vec4(0.0);
    for (int i = 0; i < taps; ++i) {
        vec2 at = r.fraction + next_point(pattern, false) * found.width;
        bool is_shaded = before_parallel_receiver(r, at, stored_depth(light, at), 0.0);
        sum += is_shaded ? vec4(0.0) : vec4(transmittance_at(light, r, at), 1.0);
    }
    return mean_passing(sum, beside_blockers, at_middle, taps, p, n);
}
#endif
#endif

// At relative point p with face normal n, of no meaning unless wanted. beside_blockers: the sum of what passes at points of
// the light that opaque blockers leave in a penumbra, and their number.
vec3 transmittance(Light light, vec3 p, vec3 n, QuadNoise noise, bool wanted, vec4 beside_blockers)
{
    vec3 at_middle = middle_transmittance(light, p);
#ifdef HAS_SHADOW_TRANSMITTANCE_NEAREST
    if (!is_soft(light)) return at_middle;
#ifdef HAS_PARALLEL_MAP
    if (int(light.tile.w) == PARALLEL_MAP) {
        return soft_parallel_transmittance(light, parallel_receiver(light, p, n), p, n, noise, wanted, beside_blockers,
                                           at_middle);
    }
#endif
#if defined(HAS_CUBE_MAP) || defined(HAS_SINGLE_MAP)
    return soft_radial_transmittance(light, radial_receiver(light, p, n), noise, wanted, beside_blockers, at_middle);
#endif
#endif
    return at_middle;
}
