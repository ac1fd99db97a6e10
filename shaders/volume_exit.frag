// Where light that enters a volume at a layer may leave it: the nearest back of the layer's material behind it.
#include "camera.glsl"
#include "numbers.glsl"

uniform sampler2D depth;       // of the layer
uniform sampler2D refraction;  // a: code of its material

in vec3 position;
in vec3 normal;
flat in vec2 labels;

layout(location = WRITE_EXIT) out vec4 out_exit;  // unit normal in camera space, away from the viewer; a: depth

void main()
{
    vec3 face = cross(dFdx(position), dFdy(position));
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 p = (view_from_relative * vec4(position, 1.0)).xyz;
    float entered = texelFetch(depth, texel, 0).r;
    bool is_its_back = is_surface(entered) && -p.z > entered && material_code(labels.y) == texelFetch(refraction, texel, 0).a;
    if (!is_its_back) discard;
    bool is_smooth = dot(normal, normal) > 1e-12 && is_finite(dot(normal, normal));
    vec3 n = mat3(view_from_relative) * (is_smooth ? normal : face), ray = view_ray(gl_FragCoord.xy);
    n *= inversesqrt(max(dot(n, n), 1e-30));
    out_exit = vec4(dot(n, ray) < 0.0 ? -n : n, -p.z);
}
