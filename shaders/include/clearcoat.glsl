// A clear layer over a surface: reflectance 0.04 at normal incidence, rising by Schlick's law.
const float CLEARCOAT_F0 = 0.04;

// Share of light that the layer lets through to a viewer at cosine n_v.
float below_clearcoat(float strength, float n_v)
{
    return 1.0 - strength * (CLEARCOAT_F0 + (1.0 - CLEARCOAT_F0) * pow(1.0 - clamp(n_v, 0.0, 1.0), 5.0));
}
