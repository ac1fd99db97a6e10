"""The table of named channels that networks read and write, shared by renderer, model contract and exporter."""

from dataclasses import dataclass

SCREEN, CUBE, PANORAMA, SURFELS, RAYS, GLOBALS = "screen", "cube", "panorama", "surfels", "rays", "globals"
SEEN = (SCREEN, CUBE, PANORAMA)  # grids of texels that are drawn from the camera; only these show the sky
BOUNCES = "bounces"
INDIRECT, DIFFUSE, SPECULAR = "indirect.rgb", "direct.diffuse.rgb", "direct.specular.rgb"
SURFEL_INDIRECT = "surfel.indirect.rgb"
# A network that shades an environment writes ENVIRONMENT. It alone may read UNSHADOWED_CHANNELS, and it may not read
# LIT, which contains its own output.
ENVIRONMENT = (DIFFUSE, SPECULAR)
UNSHADOWED_CHANNELS = ("unshadowed_environment.diffuse.rgb", "unshadowed_environment.specular.rgb")
# What a network may read of light that is gathered on its own grid along rays in each frame.
GATHERED_CHANNELS = ("gathered.rgb", "gathered.count", "gathered.distance", "interpolated.rgb")
LIT = ("direct.rgb", "radiance.rgb", "surface_and_sky_radiance.rgb")


@dataclass(frozen=True)
class Channel:
    """One named group of components.

    Attributes
    ----------
    name : str
        ``quantity[.space].components``, as contracts spell it.
    components : int
        Number of tensor channels.
    unit : str
        Physical unit; ``"1"`` for ratios and directions, ``"extent"`` for lengths in scene units
        times ``scene_extent`` / longest edge of the scene's bounding box.
    range : tuple of float
        Smallest and largest value after clamping.
    background : float
        Value of every component where no surface is visible.
    grids : tuple of str
        Grids on which the renderer provides it.
    radiance : bool
        True if the frame's exposure scalar applies.
    sky : bool
        True if it is defined in directions without a surface too; otherwise it is masked there.
    output : bool
        True for what a network may write.
    meaning : str
        One line of documentation.
    """

    name: str
    components: int
    unit: str
    range: tuple[float, float]
    background: float
    grids: tuple[str, ...]
    meaning: str
    radiance: bool = False
    sky: bool = False
    output: bool = False


HALF_MAX = 65504.0
ALL_BOUNCES = HALF_MAX  # as a number of bounces: powers of a geometric series' ratio have become 0, in any precision
_EVERYWHERE = (*SEEN, SURFELS)
_RADIANCE = (0.0, HALF_MAX)

CHANNELS: dict[str, Channel] = {
    c.name: c
    for c in (
        Channel("direct.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, SEEN,
                "diffuse radiance that leaves the surface due to direct light alone", radiance=True),
        Channel("emission.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, SEEN,
                "radiance that the surface emits itself", radiance=True),
        Channel("radiance.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, SEEN,
                "direct + emission, without emitters that are analytic lights already", radiance=True),
        Channel("surface_and_sky_radiance.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, SEEN,
                "direct + emission, and the environment where no surface is", radiance=True, sky=True),
        Channel("albedo.rgb", 3, "1", (0.0, 1.0), 0.0, SEEN, "diffuse reflectance"),
        Channel("normal.view.xyz", 3, "1", (-1.0, 1.0), 0.0, _EVERYWHERE,
                "unit shading normal towards the viewer, camera space (x right, y up, z back)"),
        Channel("normal.world.xyz", 3, "1", (-1.0, 1.0), 0.0, SEEN,
                "unit shading normal towards the viewer, world space"),
        Channel("position.view.xyz", 3, "extent", (-HALF_MAX, HALF_MAX), 0.0, _EVERYWHERE,
                "surface point, camera space"),
        Channel("depth", 1, "extent", (0.0, HALF_MAX), 0.0, SEEN,
                "distance along the main camera's -z (screen) or along the ray (cube, panorama)"),
        Channel("roughness", 1, "1", (0.0, 1.0), 1.0, SEEN, "perceptual GGX roughness"),
        Channel("solid_angle", 1, "sr", (0.0, 13.0), 0.0, (SCREEN, CUBE),
                "solid angle of the texel as seen from the camera; 0 where no surface is visible"),
        Channel("on_screen", 1, "1", (0.0, 1.0), 0.0, (CUBE,),
                "1 where the direction of the texel lies inside the main camera's image"),
        Channel("irradiance.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SURFELS,),
                "radiance that a white surface would reflect of direct light: irradiance / π", radiance=True),
        Channel("emissive_irradiance.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SURFELS,),
                "the same of light from emissive surfaces, without emitters that are analytic lights already",
                radiance=True),
        Channel("surfel.radius", 1, "extent", (0.0, HALF_MAX), 0.0, (SURFELS,),
                "distance to the eighth-nearest surfel, the radius of the neighbourhood that it represents"),
        Channel("surfel.weight", 1, "1", (0.0, 1.0), 0.0, (SURFELS,),
                "how well the surfel represents its neighbourhood; 0 for unused entries"),
        Channel("surfel.clip_plane.view.xyzw", 4, "extent", (-HALF_MAX, HALF_MAX), 0.0, (SURFELS,),
                "unit normal and offset of a wall; beyond it, where normal · position + offset > 0, the surfel has no "
                "weight; zeros for none"),
        Channel("ray.surfel", 1, "1", (-1.0, HALF_MAX), -1.0, (RAYS,),
                "index of the surfel that represents what a ray from this one hits; -1 for none"),
        Channel("ray.albedo.rgb", 3, "1", (0.0, 1.0), 0.0, (RAYS,),
                "diffuse reflectance where the ray hits; 0 if it hits nothing"),
        Channel("gathered.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "indirect radiance divided by albedo: mean over rays of the light that surfels send where they end",
                radiance=True),
        Channel("gathered.count", 1, "1", (0.0, HALF_MAX), 0.0, (SCREEN,), "number of these rays"),
        Channel("gathered.distance", 1, "1", (0.0, 1.0), 0.0, (SCREEN,),
                "mean distance of their ends, at most the median radius of the surfels, relative to it"),
        Channel("interpolated.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "indirect radiance divided by albedo, interpolated between the surfels around", radiance=True),
        Channel("environment.sh", 75, "W/(sr m²)", (-HALF_MAX, HALF_MAX), 0.0, (GLOBALS,),
                "the environment in real spherical harmonics to order 4, camera space: red's 25, green's, blue's",
                radiance=True),
        Channel(BOUNCES, 1, "1", (1.0, ALL_BOUNCES), ALL_BOUNCES, (GLOBALS,),
                f"number of bounces of indirect light to compute; {ALL_BOUNCES:g} for all"),
        Channel("unshadowed_environment.diffuse.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "irradiance / π of the unoccluded environment, from 64 directions", radiance=True),
        Channel("unshadowed_environment.specular.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "the unoccluded environment filtered by a GGX lobe, without the Fresnel term", radiance=True),
        Channel(DIFFUSE, 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "irradiance / π straight from the environment", radiance=True, output=True),
        Channel(SPECULAR, 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "what a GGX lobe gathers straight from the environment, without Fresnel's law", radiance=True,
                output=True),
        Channel(INDIRECT, 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "indirect radiance divided by albedo", radiance=True, output=True),
        Channel(SURFEL_INDIRECT, 3, "W/(sr m²)", _RADIANCE, 0.0, (SURFELS,),
                "the same at surfels, which reflections show", radiance=True, output=True),
    )
}
