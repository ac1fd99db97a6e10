// Motion and depth of the nearest layer of what is seen through where less than half of the light behind passes it,
// elsewhere those of what is opaque.
#include "numbers.glsl"

uniform sampler2D opaque_motion;
uniform sampler2D opaque_depth;
uniform sampler2D motion;   // of the layer
uniform sampler2D depth;
uniform sampler2D passage;
#ifdef HAS_EXIT
#include "camera.glsl"
uniform sampler2D volume;      // extinction times depth_scale
uniform sampler2D exit;        // a: depth of the volume's back
uniform sampler2D refraction;  // y: thickness / depth_scale
#endif

layout(location = WRITE_FRONT_MOTION) out vec4 out_motion;
layout(location = WRITE_FRONT_DEPTH) out float out_depth;

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, texel, 0).r;
    vec3 passing = texelFetch(passage, texel, 0).rgb;
#ifdef HAS_EXIT
    float back = texelFetch(exit, texel, 0).a, way = back > d ? (back - d) / depth_scale(d) : texelFetch(refraction, texel, 0).y;
    passing *= exp(-texelFetch(volume, texel, 0).rgb * way);
#endif
    bool is_front = is_surface(d) && dot(passing, vec3(1.0 / 3.0)) < 0.5;
    out_motion = is_front ? texelFetch(motion, texel, 0) : texelFetch(opaque_motion, texel, 0);
    out_depth = is_front ? d : texelFetch(opaque_depth, texel, 0).r;
}
