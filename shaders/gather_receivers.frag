// What the grid of gathered light shows: normal and depth, negative where the history knows nothing of the surface.
#include "lowres_history.glsl"

uniform sampler2D gathered_light_prev;  // a: rays

layout(location = 0) out vec4 out_gather_receivers;

float known(ivec2 low, float closeness)
{
    return closeness > 0.0 && texelFetch(gathered_light_prev, low, 0).a > 0.0 ? closeness : 0.0;
}

void main()
{
    ivec2 low = ivec2(gl_FragCoord.xy);
    Reprojection r = reproject(low);
    float weight = known(r.base, r.weights.x) + known(r.base + ivec2(1, 0), r.weights.y)
        + known(r.base + ivec2(0, 1), r.weights.z) + known(r.base + ivec2(1, 1), r.weights.w);
    vec4 surface = texelFetch(lowres_gbuffer, low, 0);
    out_gather_receivers = vec4(surface.xyz, history_valid && weight <= MIN_SHARE ? -surface.a : surface.a);
}
