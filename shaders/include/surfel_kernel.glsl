// Light between surfels, weighted as in app/surfels/kernel.py, which has the constants; app/passes/surfel_buffer.py fills the
// buffer. All invocations of a work group together look at one point: a single one would wait for each of thousands of surfels.
layout(local_size_x = 64) in;

const float DISTANCE_WEIGHT = 3.0, NORMAL_WEIGHT = 8.0, PLANE_WEIGHT = 24.0;
const int SURFEL_ROWS = 5;

// Position and 1 / radius²; normal and logarithm of the weight; key of the clip plane; indirect light; the sky's.
layout(std430, binding = 0) readonly buffer Surfels { vec4 surfels[]; };
uniform int surfel_count;
uniform vec3 surfel_center;  // that positions are relative to, in local space: world axes, the scene's centre as origin

struct SurfelLight {
    vec3 indirect;
    vec3 sky;
};

const int LANES = int(gl_WorkGroupSize.x);
shared vec4 lane_indirect[LANES];  // a: sum of weights
shared vec4 lane_sky[LANES];       // a: largest exponent, which weights are relative to so that no sum underflows

void merge(int lane, int other)
{
    float largest = max(lane_sky[lane].a, lane_sky[other].a);
    float own = exp(lane_sky[lane].a - largest), its = exp(lane_sky[other].a - largest);
    lane_indirect[lane] = lane_indirect[lane] * own + lane_indirect[other] * its;
    lane_sky[lane] = vec4(lane_sky[lane].rgb * own + lane_sky[other].rgb * its, largest);
}

// Means over all surfels at a point in local space, the same one for all invocations of the group.
SurfelLight surfel_light_at(vec3 position, vec3 normal)
{
    int lane = int(gl_LocalInvocationIndex);
    vec3 at = position - surfel_center, sky = vec3(0.0);
    vec4 indirect = vec4(0.0);
    float largest = -1e30;
    for (int i = lane; i < surfel_count; i += LANES) {
        vec4 place = surfels[SURFEL_ROWS * i], facing = surfels[SURFEL_ROWS * i + 1], clip = surfels[SURFEL_ROWS * i + 2];
        vec3 away = at - place.xyz;
        float off = dot(away, normal);
        float exponent = facing.w + NORMAL_WEIGHT * dot(facing.xyz, normal)
            - (DISTANCE_WEIGHT * dot(away, away) + PLANE_WEIGHT * off * off) * place.w + min(dot(clip.xyz, at) + clip.w, 0.0);
        float before = largest;
        largest = max(largest, exponent);
        float kept = exp(before - largest), weight = exp(exponent - largest);
        indirect = indirect * kept + weight * vec4(surfels[SURFEL_ROWS * i + 3].rgb, 1.0);
        sky = sky * kept + weight * surfels[SURFEL_ROWS * i + 4].rgb;
    }
    barrier();  // since others may still read an earlier result
    lane_indirect[lane] = indirect;
    lane_sky[lane] = vec4(sky, largest);
    for (int step = LANES / 2; step > 0; step /= 2) {
        barrier();
        if (lane < step) merge(lane, lane + step);
    }
    barrier();
    float total = max(lane_indirect[0].a, 1e-30);
    return SurfelLight(lane_indirect[0].rgb / total, lane_sky[0].rgb / total);
}
