// Properties of the surfaces that rays meet, as Body.interact on the CPU has them: blurred textures, and diffuse and specular
// reflection together as one albedo.
#include "ray_scene.glsl"
#include "specular_albedo.glsl"

const int HAS_SPECULAR = 1, IS_DOUBLE_SIDED = 2, EMITS = 4;  // of a material
const int REPEATS_U = 1, REPEATS_V = 2, SECOND_UVS = 4;      // of a texture
const int MATERIAL_ROWS = 15, ALBEDO_MAP = 3, SPECULAR_MAP = 6, METALLIC_ROUGHNESS_MAP = 9, EMISSION_MAP = 12;

layout(std430, binding = 4) readonly buffer RayCorners { ivec4 ray_corners[]; };    // three vertices, material
layout(std430, binding = 5) readonly buffer RayVertices { vec4 ray_vertices[]; };   // normal; two sets of uv; colour
layout(std430, binding = 6) readonly buffer RayMaterials { ivec4 ray_materials[]; };  // bits of floats, and integers
layout(std430, binding = 7) readonly buffer RayTexels { float ray_texels[]; };

struct Surface {
    vec3 position;  // local space
    vec3 normal;    // unit length, on the side of the ray's origin
    vec3 face;      // that of the triangle
    vec3 albedo;    // share of light from everywhere that goes back along the ray
    vec3 emission;  // W/(sr m²)
    vec3 f0;        // reflectance of the specular lobe at normal incidence, 0 for none
    float roughness;  // perceptual
};

vec4 interpolate(int row, ivec3 vertices, vec3 weights)
{
    return ray_vertices[3 * vertices.x + row] * weights.x + ray_vertices[3 * vertices.y + row] * weights.y
        + ray_vertices[3 * vertices.z + row] * weights.z;
}

int wrap(float at, bool repeats, int size)
{
    return clamp(int((repeats ? fract(at) : clamp(at, 0.0, 1.0)) * float(size)), 0, size - 1);
}

// The texel nearest to mesh coordinates, of the texture whose record begins in that row; 1 without one.
vec3 textured(int row, vec4 uvs)
{
    ivec4 place = ray_materials[row];
    if (place.x < 0) return vec3(1.0);
    vec4 first = intBitsToFloat(ray_materials[row + 1]), second = intBitsToFloat(ray_materials[row + 2]);
    vec3 uv = vec3((place.w & SECOND_UVS) != 0 ? uvs.zw : uvs.xy, 1.0);
    vec2 at = vec2(dot(first.xyz, uv), dot(vec3(first.w, second.xy), uv));
    int x = wrap(at.x, (place.w & REPEATS_U) != 0, place.y), y = wrap(1.0 - at.y, (place.w & REPEATS_V) != 0, place.z);
    int index = 3 * (place.x + y * place.y + x);
    return vec3(ray_texels[index], ray_texels[index + 1], ray_texels[index + 2]);
}

// A vector of a body's space that goes by the transpose of the inverse, as normals do, in local space.
vec3 turned(Body body, vec3 v)
{
    return normalize(v.x * body.to_body[0].xyz + v.y * body.to_body[1].xyz + v.z * body.to_body[2].xyz);
}

// The surface at a hit of nearest_hit; proxy_share: of the emission of light proxies, which analytic lights stand for.
Surface surface_at(Hit hit, vec3 origin, vec3 along, float proxy_share)
{
    Body body = ray_bodies[hit.body];
    ivec4 corners = ray_corners[hit.triangle];
    vec3 weights = vec3(1.0 - hit.uv.x - hit.uv.y, hit.uv), step = by_rows(body.to_body, vec4(along, 0.0));
    int material = MATERIAL_ROWS * corners.w;
    ivec4 first = ray_materials[material];
    vec4 reflected = intBitsToFloat(ray_materials[material + 1]), emitted = intBitsToFloat(ray_materials[material + 2]);
    vec3 base = intBitsToFloat(first.xyz);
    int kind = first.w;
    vec4 uvs = interpolate(1, corners.xyz, weights);

    vec3 size = abs(hit.face);  // whose square may be no number
    vec3 face = normalize(hit.face / max(max(size.x, size.y), max(size.z, 1e-30))) * (dot(hit.face, step) > 0.0 ? -1.0 : 1.0);
    vec3 normal = interpolate(0, corners.xyz, weights).xyz;
    normal = length(normal) > 1e-6 ? normalize(normal) : face;
    normal = dot(normal, face) < 0.0 ? -normal : normal;

    vec3 albedo = base * interpolate(2, corners.xyz, weights).rgb * textured(material + ALBEDO_MAP, uvs);
    vec3 f0 = vec3(0.0);
    float roughness = 1.0;
    if ((kind & HAS_SPECULAR) != 0) {
        vec3 maps = textured(material + METALLIC_ROUGHNESS_MAP, uvs), color = clamp(albedo, 0.0, 1.0);
        float metallic = emitted.w * maps.b;
        f0 = mix(reflected.rgb * textured(material + SPECULAR_MAP, uvs), color, metallic);
        roughness = reflected.w * maps.g;
        vec3 specular = specular_albedo(f0, roughness, MEAN_COSINE);
        albedo = specular + min(color * (1.0 - metallic), 1.0 - specular);
    }
    bool front = (dot(hit.face, step) < 0.0) != ((hit.flags & IS_MIRRORED) != 0);
    bool emits = (kind & EMITS) != 0 && ((kind & IS_DOUBLE_SIDED) != 0 || front);
    vec3 emission = emits ? max(emitted.rgb * textured(material + EMISSION_MAP, uvs), 0.0) : vec3(0.0);
    emission *= (hit.flags & IS_PROXY) != 0 ? proxy_share : 1.0;
    return Surface(origin + along * hit.distance, turned(body, normal), turned(body, face), clamp(albedo, 0.0, 1.0), emission,
                   f0, roughness);
}
