"""The table of named channels: what a network may read or write, and how each is to be read.

One ordered table for the renderer, the model contract and the exporter.
"""

from __future__ import annotations

from dataclasses import dataclass

SCREEN, CUBE, PANORAMA, SURFELS, RAYS, GLOBALS = "screen", "cube", "panorama", "surfels", "rays", "globals"
SEEN = (SCREEN, CUBE, PANORAMA)  # texels, drawn from the camera; no others have a sky
BOUNCES = "bounces"
INDIRECT, DIFFUSE, SPECULAR = "indirect.rgb", "direct.diffuse.rgb", "direct.specular.rgb"
ENVIRONMENT = (DIFFUSE, SPECULAR)                             # what shades an environment writes
UNSHADOWED_CHANNELS = ("unshadowed_environment.diffuse.rgb", "unshadowed_environment.specular.rgb")  # ... and alone may read
LIT = ("direct.rgb", "radiance.rgb", "surface_and_sky_radiance.rgb")        # ... and may not, since it lights them


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
        Smallest and largest value after sanitising.
    background : float
        Value of every component where no surface is seen.
    grids : tuple of str
        Grids on which the renderer provides it.
    radiance : bool
        True where the frame's exposure scalar applies.
    sky : bool
        True where it has a meaning in directions without a surface, too; otherwise it is masked there.
    output : bool
        True for what a network may write; such a channel is an input only if another network wrote it.
    meaning : str
        One line for people.
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
ALL_BOUNCES = HALF_MAX  # a geometric series has ended by then: powers of its ratio are 0, in any precision
_EVERYWHERE = (*SEEN, SURFELS)
_RADIANCE = (0.0, HALF_MAX)

CHANNELS: dict[str, Channel] = {
    c.name: c
    for c in (
        Channel("direct.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, SEEN,
                "diffuse radiance that leaves the surface by direct light alone", radiance=True),
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
                "solid angle of the texel as seen from the camera; 0 where no surface is seen"),
        Channel("on_screen", 1, "1", (0.0, 1.0), 0.0, (CUBE,),
                "1 where the direction of the texel lies inside the main camera's image"),
        Channel("irradiance.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SURFELS,),
                "what a white surface would send by direct light: irradiance / π", radiance=True),
        Channel("emissive_irradiance.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SURFELS,),
                "the same by surfaces that glow, without emitters that are analytic lights already", radiance=True),
        Channel("surfel.radius", 1, "extent", (0.0, HALF_MAX), 0.0, (SURFELS,),
                "distance to the neighbours that it shares its surroundings with"),
        Channel("surfel.weight", 1, "1", (0.0, 1.0), 0.0, (SURFELS,),
                "how well it stands for its surroundings; 0 where there is no surfel"),
        Channel("ray.surfel", 1, "1", (-1.0, HALF_MAX), -1.0, (RAYS,),
                "number of the surfel that a ray from this one meets; -1 for none"),
        Channel("ray.albedo.rgb", 3, "1", (0.0, 1.0), 0.0, (RAYS,),
                "diffuse reflectance where the ray ends; 0 where it meets nothing"),
        Channel("environment.sh", 75, "W/(sr m²)", (-HALF_MAX, HALF_MAX), 0.0, (GLOBALS,),
                "the environment in real spherical harmonics to order 4, camera space: red's 25, green's, blue's",
                radiance=True),
        Channel(BOUNCES, 1, "1", (1.0, ALL_BOUNCES), ALL_BOUNCES, (GLOBALS,),
                f"how many bounces of indirect light are wanted; {ALL_BOUNCES:g} for all"),
        Channel("unshadowed_environment.diffuse.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "irradiance / π by the environment with nothing in its way, from 64 directions", radiance=True),
        Channel("unshadowed_environment.specular.rgb", 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "what a GGX lobe gathers of the same, without Fresnel's law", radiance=True),
        Channel(DIFFUSE, 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "irradiance / π straight from the environment", radiance=True, output=True),
        Channel(SPECULAR, 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "what a GGX lobe gathers straight from the environment, without Fresnel's law", radiance=True,
                output=True),
        Channel(INDIRECT, 3, "W/(sr m²)", _RADIANCE, 0.0, (SCREEN,),
                "indirect radiance divided by albedo", radiance=True, output=True),
    )
}
