// Unshadowed light of all rectangles whose shadows are traced. Diffuse and specular light are the same integrals of other
// cosines; the texels of a quad that shows one flat surface evaluate one each, at the quad's centre, and share the sums.
#include "lights.glsl"
#include "ggx.glsl"
#include "sparse_lights.glsl"
#include "quad_surface.glsl"

// How much the texels of a quad may differ from its centre:
const float MAX_PARALLAX = 0.02;          // radians between a light's directions
const float MAX_SHIFT = 0.04;             // of a light in the lobe, in widths of the lobe, at the light's outline
const float MAX_ALPHA_DIFFERENCE = 0.05;  // relative

struct TracedRects {
    vec3 irradiance;
    vec3 specular;  // radiance that the lobe reflects
};

#ifdef HAS_LIGHT_IMAGES
const int PLAIN_END = IMAGES_BEGIN;  // of the rectangles without an image
#else
const int PLAIN_END = LIGHT_COUNT;
#endif

// What a cosine gathers of those without an image, but for highlights of sparse ones. Loops have their tests at the end, as in
// direct.frag.
vec3 gather_rects(vec3 p, vec3 n, Cosine cosine, bool is_lit, bool is_specular)
{
    vec3 sum = vec3(0.0);
    int first = RECTS_BEGIN, end = is_lit ? PLAIN_END : RECTS_BEGIN;
#ifdef HAS_SPARSE_LIGHT
    first = is_specular ? max(SPARSE_END, RECTS_BEGIN) : RECTS_BEGIN;
#endif
    int i = min(first, PLAIN_END - 1);
    do {
        vec3 light = lights[i].color.rgb * rect_light(lights[i], p, n, cosine);
        sum += i < first ? vec3(0.0) : light;
    } while (++i < end);
    return sum;
}

// The rectangles as seen from a quad.
struct Outlook {
    float nearness;  // inverse square of the distance of the nearest
    float outline;   // smallest angle, about, between the mirrored view and the outline of one
    vec3 brightest;  // largest radiance in each channel
};

// Each texel looks at every fourth rectangle. Squares are inverted, since a quad can't hand on a small number beside a huge one.
Outlook rects_outlook(vec3 p, vec3 mirrored)
{
    Outlook o = Outlook(0.0, 1.0, vec3(0.0));
    int i = RECTS_BEGIN + int(quad_lane());
    do {
        Light light = lights[min(i, LIGHT_COUNT - 1)];
        vec3 to = light.position.xyz - p;
        vec3 at = vec3(dot(to, light.frame_x.xyz), dot(to, light.frame_y.xyz), dot(to, light.frame_z.xyz));
        vec3 along = vec3(dot(mirrored, light.frame_x.xyz), dot(mirrored, light.frame_y.xyz), dot(mirrored, light.frame_z.xyz));
        vec2 size = vec2(light.frame_x.w, light.frame_y.w), gap = max(abs(at.xy) - size, 0.0);
        bool is_in_plane = abs(at.z) <= light.u.w;  // where it gives nothing
        o.nearness = is_in_plane ? o.nearness : max(o.nearness, 1.0 / max(dot(gap, gap) + at.z * at.z, MIN_SQUARE));
        // Where the mirrored view meets the plane; if it does not, the angle to the plane is as large as that.
        float inverse_t = along.z / (at.z == 0.0 ? 1e-30 : at.z);
        vec2 beyond = abs(along.xy - at.xy * inverse_t) - size * inverse_t;
        float miss = inverse_t > 0.0 ? min(abs(max(beyond.x, beyond.y)), 1.0) : 1.0;
        vec3 brightest = light.color.rgb;
#ifdef HAS_LIGHT_IMAGES
        bool shows_image = image_layer(light) >= 0.0 && inverse_t > 0.0 && max(beyond.x, beyond.y) < 0.0;
        miss = shows_image ? 0.0 : miss;  // any place of an image may be an outline
        brightest *= max(light.position.w, 1.0);
#endif
        o.outline = min(o.outline, miss * abs(along.z));
        o.brightest = max(o.brightest, brightest);
    } while ((i += 4) < LIGHT_COUNT);
    return Outlook(quad_max(vec3(o.nearness)).x, 1.0 - quad_max(vec3(1.0 - o.outline)).x, quad_max(o.brightest));
}

// How much the directions of lights at point p with normal n may differ from those at the quad's centre, in radians.
float parallax(vec3 p, vec3 n, Outlook o, QuadSurface quad)
{
    vec3 to = p - quad.p;
    return sqrt(dot(to, to) * o.nearness) + distance(n, quad.n);
}

// Whether all four texels get the irradiance of the quad's centre; this must not depend on their lobes, which may be unknown.
bool shares_irradiance(vec3 p, vec3 n, Outlook o, QuadSurface quad)
{
    return quad.is_flat && quad_all(parallax(p, n, o, quad) < MAX_PARALLAX);
}

// Whether a lobe of slopes sees the same light at point p with normal n as at the quad's centre. Both the light's
// direction and the mirrored view may differ by little, most at the outline of a highlight.
bool reflects_the_same(vec3 p, vec3 n, vec2 slopes, Outlook o, QuadSurface quad)
{
    vec3 to = p - quad.p;
    float distance_square = dot(quad.p, quad.p), along = dot(to, quad.p);
    float sway = sqrt(max(dot(to, to) - along * along / distance_square, 0.0) / distance_square);  // of the view
    float shift = (parallax(p, n, o, quad) + sway + distance(n, quad.n)) * slopes.y, from_outline = o.outline * slopes.y;
    return shift < MAX_SHIFT * (1.0 + from_outline * from_outline);
}

#ifdef HAS_LIGHT_IMAGES
// What relative point p with normal n receives of an image on the mean; for the quad's centre its texels take different parts.
vec3 image_around_quad(Light light, vec3 p, vec3 n, bool is_shared, QuadSurface quad)
{
    vec3 at = is_shared ? quad.p : p, normal = is_shared ? quad.n : n;
    vec4 sum = image_parts(light, at, normal, is_shared ? int(quad_lane()) : 0, is_shared ? 4 : 1);
    vec4 of_quad = vec4(quad_sum(sum.rgb), quad_sum(sum.a));
    sum = is_shared ? of_quad : sum;
    return sum.rgb / sum.a;
}
#endif

// Irradiance where no specular light is written, the same as beside it.
vec3 rects_irradiance(vec3 p, vec3 n, bool is_lit, QuadSurface quad)
{
    bool is_shared = false;
#ifdef HAS_SPECULAR_SURFACES
    is_shared = shares_irradiance(p, n, rects_outlook(quad.p, quad.n), quad);
#endif
    vec3 at = is_shared ? quad.p : p, normal = is_shared ? quad.n : n;
    Cosine cosine = Cosine(mat3(1.0), normal);
    vec3 sum = vec3(0.0);
#ifdef HAS_PLAIN_RECT
    sum = gather_rects(at, normal, cosine, is_lit, false);
#endif
#ifdef HAS_LIGHT_IMAGES
    int i = IMAGES_BEGIN;
    do {
        vec3 image = image_around_quad(lights[i], p, n, is_shared, quad);
        sum += is_lit ? image * lights[i].color.rgb * rect_light(lights[i], at, normal, cosine) : vec3(0.0);
    } while (++i < LIGHT_COUNT);
#endif
    return max(sum, 0.0);
}

// What of a texel's light its quad shares, and what stands for its lobe.
struct RectView {
    bool is_shared;        // all of it; each texel has another cosine then
    bool is_matte_shared;  // irradiance
    RectLobe lobe;
    int cosines;           // that the texel looks at
};

// One of the cosines: 0 is Lambert's. Where it is looked at, too.
Cosine cosine_at(RectView view, int index, vec3 p, vec3 n, QuadSurface quad, out vec3 at, out vec3 normal)
{
    bool is_central = view.is_shared || (view.is_matte_shared && index == 0);
    at = is_central ? quad.p : p;
    normal = is_central ? quad.n : n;
    Cosine cosine = lobe_cosine(view.lobe, max(index - 1, 0));
    cosine.transform = index == 0 ? mat3(1.0) : cosine.transform;
    cosine.axis = index == 0 ? normal : cosine.axis;
    return cosine;
}

TracedRects rects_light(vec3 p, vec3 n, Lobe lobe, bool is_lit, bool is_shiny, QuadSurface quad)
{
    float alpha = 0.25 * quad_sum(lobe.alpha);
    vec3 toward = normalize(along_view(quad.p));
    Outlook o = rects_outlook(quad.p, reflect(toward, quad.n));
    RectView view;
    view.is_matte_shared = shares_irradiance(p, n, o, quad);
    bool agrees = is_shiny && abs(lobe.alpha - alpha) < MAX_ALPHA_DIFFERENCE * alpha
        && reflects_the_same(p, n, lobe_slopes(max(-dot(toward, quad.n), MIN_COSINE), alpha), o, quad);
    view.is_shared = view.is_matte_shared && quad_all(agrees);
    is_lit = view.is_shared ? quad_any(is_lit) : is_lit;
    view.lobe = rect_lobe(view.is_shared ? quad.n : n, view.is_shared ? -toward : lobe.v, view.is_shared ? alpha : lobe.alpha);
    view.cosines = view.is_shared || !is_lit || !is_shiny ? 1 : 1 + view.lobe.cosines;

    vec3 irradiance = vec3(0.0), specular = vec3(0.0), at, normal;
#ifdef HAS_LIGHT_IMAGES
    vec2 forms[LIGHT_COUNT - IMAGES_BEGIN];  // what Lambert's cosine gathers of each, and what the others do
    int m = 0;
    do forms[m] = vec2(0.0);
    while (++m < LIGHT_COUNT - IMAGES_BEGIN);
#endif
    int i = 0;
    do {
        int index = view.is_shared ? int(quad_lane()) : i;
        Cosine cosine = cosine_at(view, index, p, n, quad, at, normal);
#ifdef HAS_PLAIN_RECT
        vec3 sum = gather_rects(at, normal, cosine, is_lit, index > 0);
        irradiance += index == 0 ? sum : vec3(0.0);
        specular += index == 0 ? vec3(0.0) : sum;
#endif
#ifdef HAS_LIGHT_IMAGES
        m = 0;
        do {
            float form = rect_light(lights[IMAGES_BEGIN + m], at, normal, cosine);
            forms[m] += index == 0 ? vec2(form, 0.0) : vec2(0.0, form);
        } while (++m < LIGHT_COUNT - IMAGES_BEGIN);
#endif
    } while (++i < view.cosines);
#ifdef HAS_LIGHT_IMAGES
    m = 0;
    do {
        Light light = lights[IMAGES_BEGIN + m];
        vec3 around = image_around_quad(light, p, n, view.is_matte_shared, quad);
        vec3 along = image_along(light, p, n, reflect(-lobe.v, n), lobe.alpha);
        irradiance += is_lit ? forms[m].x * light.color.rgb * around : vec3(0.0);
        specular += is_lit ? forms[m].y * light.color.rgb * along : vec3(0.0);
    } while (++m < LIGHT_COUNT - IMAGES_BEGIN);
#endif
    vec3 shared_irradiance = quad_sum(irradiance), shared_specular = quad_sum(specular);
    irradiance = view.is_shared ? shared_irradiance : irradiance;
    specular = view.is_shared ? shared_specular : specular;
    specular = clamp(specular, vec3(0.0), lobe.albedo * o.brightest);
    return TracedRects(max(irradiance, 0.0), specular * rect_reflectance(lobe, view.lobe));
}
