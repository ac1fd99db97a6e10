// Joint bilateral upsampling (Kopf et al. 2007): low-resolution demodulated light, guided by full-resolution
// normals and by the distance from the receiver's plane (Xin et al. 2021, section 5.3). Where no low-resolution texel
// around shows a pixel's surface, which is too thin or at an edge, the pixel takes the light of missed pixels around, and
// keeps its light of earlier frames.
#include "numbers.glsl"
#include "joint_bilateral.glsl"
#include "history.glsl"
#include "inverse_depth.glsl"
#ifdef FAST_PATH
#include "quad_taps.glsl"
#endif

const float SKY = 1e-30;         // so that filled-in light counts where no texel shows a surface

uniform sampler2D light_filled;
uniform sampler2D lowres_gbuffer;
uniform sampler2D normal;
uniform sampler2D depth;
uniform vec2 ratio;  // full-resolution texels per low-resolution texel
#ifdef HAS_INDIRECT_PREV
uniform sampler2D motion;
uniform sampler2D indirect_prev;  // a: inverse depth
uniform sampler2D normal_prev;
uniform float near;        // distance of the near plane in scene units
uniform float max_frames;  // of history
uniform bool history_valid;
const float LEAST_FOUND = 0.1;  // so that light which is out of date fades
#endif

#ifdef HAS_LIGHT_GRADIENT
uniform sampler2D bumpy_normal;
uniform sampler2D light_gradient;  // of light by the tilt of bumps, over the light; low-resolution, world space
const float MAX_BRIGHTENED = 3.0;  // by bumps that face the light
#endif

#ifdef HAS_MISSED_LIGHT
#include "missed_pixels.glsl"

uniform sampler2D missed_surface;  // normal, depth
uniform sampler2D missed_light;    // a: 1 + number of the pixel in its tile, or 0
const float REACH = 1.5 * float(TILE);  // pixels
#endif

layout(location = 0) out vec4 out_light;

// rgb: weighted light, a: weight of one low-resolution texel, whose weighted gradient is added.
vec4 tap(ivec2 low, float along, float closeness, BilateralReceiver r, inout vec3 gradient)
{
    vec4 surface = texelFetch(lowres_gbuffer, low, 0);
    float alike = surface.a > 0.0 ? similarity(surface, along, r) : SKY;
    float weight = closeness * alike;
#ifdef HAS_LIGHT_GRADIENT
    gradient += texelFetch(light_gradient, low, 0).rgb * weight;
#endif
    return vec4(texelFetch(light_filled, low, 0).rgb, 1.0) * weight;
}

#ifdef HAS_MISSED_LIGHT
// rgb: weighted light, a: weight of the pixels around that have light of their own.
vec4 missed(ivec2 texel, BilateralReceiver r)
{
    ivec2 base = (texel + TILE / 2) / TILE - 1;  // of the four tiles around
    vec4 sum = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        ivec2 tile = base + ivec2(i & 1, i >> 1);
        if (any(lessThan(tile, ivec2(0))) || any(greaterThanEqual(tile, textureSize(missed_light, 0)))) continue;
        vec4 light = texelFetch(missed_light, tile, 0);
        ivec2 at = missed_texel(tile, max(int(light.a) - 1, 0));
        vec2 away = vec2(at - texel) / REACH, along = along_normal(at, r);
        float weight = max(1.0 - dot(away, away), MIN_WEIGHT)
            * similarity(texelFetch(missed_surface, tile, 0), along.x + along.y, r);
        sum += light.a > 0.0 ? vec4(light.rgb, 1.0) * weight : vec4(0.0);
    }
    return sum;
}
#endif

#ifdef HAS_INDIRECT_PREV
// Blended with the surface's previous light: more of it the less the texels around show (shown), and for longer where no
// pixel around has light of its own (found).
vec3 with_history(vec3 light, float shown, float found, float d, BilateralReceiver r)
{
    vec3 moved = texelFetch(motion, ivec2(gl_FragCoord.xy), 0).xyz;
    ivec2 at = ivec2(floor(gl_FragCoord.xy - moved.xy * vec2(1.0, -1.0)));
    vec4 old = texelFetch(indirect_prev, at, 0);
    bool keep = history_valid && all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, textureSize(depth, 0)))
        && same_surface(old.a, inverse_depth(d, near) / moved.z, plane_slope(r.normal, gl_FragCoord.xy, d),
                        texelFetch(normal_prev, at, 0).xyz, r.normal)
        && is_finite(dot(old.rgb, vec3(1.0)));
    float share = 1.0 - max(found, LEAST_FOUND) / max_frames;
    return keep ? mix(light, without_flash(old.rgb, light), share * (1.0 - shown)) : light;
}
#endif

#ifdef HAS_LIGHT_GRADIENT
// Light on a bump over that on the smooth surface with normal n: half of what is below its horizon is seen no more, and the
// surface hides the rest; to first order, light from one side counts more on bumps that face it.
float on_bump(vec3 n, vec3 gradient)
{
    vec3 bump = sanitize_normal(texelFetch(bumpy_normal, ivec2(gl_FragCoord.xy), 0).xyz);
    float cosine = dot(bump, n), seen = 0.5 + 0.5 * cosine + dot(bump - cosine * n, gradient);
    return clamp(is_finite(seen) ? seen : 1.0, 0.0, MAX_BRIGHTENED);
}
#endif

void write(vec3 light, float d)
{
#ifdef HAS_INDIRECT_PREV
    out_light = vec4(light, inverse_depth(d, near));
#else
    out_light = vec4(light, 1.0);
#endif
}

#ifdef FAST_PATH
// Stands where all texels of a quad show one plane that the low-resolution texels show too, and where all show none.
void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, texel, 0).r;
    BilateralReceiver r = bilateral_receiver(gl_FragCoord.xy, texelFetch(normal, texel, 0).xyz, d);
    QuadTap t = quad_tap(textureSize(lowres_gbuffer, 0), ratio);
    vec2 along = along_normal(t.low, ratio, r);
    vec3 own_gradient = vec3(0.0);
    vec4 sum = interpolate_taps(tap(t.low, along.x + along.y, 1.0, r, own_gradient), t.closeness);
    bool is_seen = is_surface(d), stands = t.is_inside && shows_plane_of_quad(r) && sum.a >= SHOWN;
    vec3 light = is_seen ? sanitize_radiance(sum.rgb / sum.a) : vec3(0.0);
#ifdef HAS_LIGHT_GRADIENT
    vec3 gradient = interpolate_taps(vec4(own_gradient, 0.0), t.closeness).rgb / sum.a;
    light = min(light * on_bump(r.normal, gradient), HALF_MAX);
#endif
    write(light, d);
    gl_FragDepth = quad_all(stands) || !quad_any(is_seen) ? 1.0 : 0.0;
}
#else
void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, texel, 0).r;
    BilateralReceiver r = bilateral_receiver(gl_FragCoord.xy, sanitize_normal(texelFetch(normal, texel, 0).xyz), d);
    Around t = texels_around(gl_FragCoord.xy, textureSize(lowres_gbuffer, 0), ratio, r);
    vec2 f = t.f, g = 1.0 - f;
    vec3 gradient = vec3(0.0);
    vec4 sum = tap(t.low, t.along_low.x + t.along_low.y, g.x * g.y, r, gradient);
    sum += tap(ivec2(t.high.x, t.low.y), t.along_high.x + t.along_low.y, f.x * g.y, r, gradient);
    sum += tap(ivec2(t.low.x, t.high.y), t.along_low.x + t.along_high.y, g.x * f.y, r, gradient);
    sum += tap(t.high, t.along_high.x + t.along_high.y, f.x * f.y, r, gradient);
    gradient /= max(sum.a, 1e-30);
    float shown = min(sum.a / SHOWN, 1.0), found = 1.0;
#ifdef HAS_MISSED_LIGHT
    if (is_surface(d) && shown < 1.0) {
        vec4 own = missed(texel, r);
        sum += (1.0 - shown) * own;
        found = clamp(own.a / SHOWN, shown, 1.0);
    }
#endif
    // NaN in the light of any tap ends as 0 here.
    vec3 light = is_surface(d) && sum.a > 0.0 ? sanitize_radiance(sum.rgb / sum.a) : vec3(0.0);
#ifdef HAS_LIGHT_GRADIENT
    light = min(light * on_bump(r.normal, gradient), HALF_MAX);
#endif
#ifdef HAS_INDIRECT_PREV
    if (is_surface(d) && shown < 1.0) light = with_history(light, shown, found, d, r);
#endif
    write(light, d);
}
#endif
