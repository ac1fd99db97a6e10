// The environment where no surface is seen, on the screen or around the camera (GRID_CUBE): a latitude-longitude map, -z
// in the middle, +x right of it.
#include "numbers.glsl"
#include "grid.glsl"

uniform sampler2D depth;
uniform sampler2D environment;  // top row straight up
uniform float rotation;         // counter-clockwise about +y seen from above, in full circles
uniform float level;            // of detail whose texels are as large as pixels

layout(location = 0) out vec4 out_background;

void main()
{
    if (is_surface(texelFetch(depth, ivec2(gl_FragCoord.xy), 0).r)) {
        out_background = vec4(0.0);
        return;
    }
    vec3 d = normalize(surface_ray(gl_FragCoord.xy));
    vec2 at = vec2(atan(d.x, -d.z) / (2.0 * PI) + 0.5 + rotation, acos(clamp(d.y, -1.0, 1.0)) / PI);
    out_background = vec4(sanitize_radiance(textureLod(environment, at, level).rgb), 1.0);
}
