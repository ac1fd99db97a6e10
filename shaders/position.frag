// Surface points relative to the eye, for the position AOV.
#include "numbers.glsl"
#include "grid.glsl"

uniform sampler2D depth;
layout(location = 0) out vec4 out_position;

void main()
{
    float d = texelFetch(depth, ivec2(gl_FragCoord.xy), 0).r;
    out_position = is_surface(d) ? vec4(surface_point(gl_FragCoord.xy, d), 1.0) : vec4(0.0);
}
