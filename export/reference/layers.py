"""How the layers of a surface share light: a clearcoat over a sheen over the base."""

from collections.abc import Sequence
from typing import Any

import drjit as dr

from export.reference.ggx import GgxLobe
from export.reference.lambert import LambertLobe
from export.reference.refraction import transmitted
from export.reference.sheen import SheenLobe
from export.reference.surfaces import Surface, SurfaceTable

COAT_F0 = 0.04


class Layers:
    """The layers of ``surface`` as seen from the direction ``v``.

    Attributes
    ----------
    coat_share : mitsuba.Float
        Share of light from below the clearcoat that passes it.
    base_share : mitsuba.Float
        Share that passes the clearcoat and the sheen.
    albedo : mitsuba.Color3f
        Diffuse reflectance, as far as light passes the layers above; the base reflects no more light than arrives.
    glossy : list of tuple
        Each glossy lobe that a material of the scene has, its share, and whether the surface has it.
    lobes : list of tuple
        The same with the diffuse one.
    """

    def __init__(self, mi: Any, surfaces: SurfaceTable, surface: Surface, v: Any) -> None:
        self._mi, self._surface, self._v = mi, surface, v
        self.coat_share = self.base_share = mi.Float(1.0)
        self.glossy: list[tuple[Any, Any, Any]] = []
        self._base = GgxLobe(mi, surface.normal, v, surface.f0, surface.roughness)
        if surfaces.has_coat:
            coat = GgxLobe(mi, surface.coat_normal, v, mi.Color3f(COAT_F0), surface.coat_roughness)
            self.glossy.append((coat, surface.coat, surface.coat > 0))
            self.coat_share = self.base_share = 1 - surface.coat * _schlick(COAT_F0, surface.coat_normal, v)
        if surfaces.has_sheen:
            sheen = SheenLobe(mi, surface.normal, v, surface.sheen, surface.sheen_roughness)
            self.glossy.append((sheen, self.coat_share, dr.max(surface.sheen) > 0))
            self.base_share = self.coat_share * sheen.base_share()
        diffuse = surface.albedo
        if surfaces.has_specular:  # an F0 of 0 means no specular reflection, not even at grazing angles
            self.glossy.append((self._base, self.base_share, dr.max(surface.f0) > 0))
            diffuse = dr.minimum(diffuse, 1 - self._base.albedo())
        self.albedo = self.base_share * diffuse
        self.lobes = [(LambertLobe(mi, surface.normal, self.albedo), 1.0, True), *self.glossy]

    @property
    def transmitted_share(self) -> Any:
        """Share of each colour that passes the surface, where it transmits all."""
        s = self._surface
        reflected = dr.select(dr.max(s.f0) > 0, _schlick(s.f0, s.normal, self._v), 0)
        return self.base_share * (1 - reflected) * s.base

    def transmitted(self, leaves: Any, u: Any) -> tuple[Any, Any]:
        """A direction of light that passes, and its weight; where it leaves a volume nothing of it is reflected."""
        s = self._surface
        roughness, ior = dr.select(leaves, 0.0, s.roughness), dr.select(leaves, 1 / s.ior, s.ior)
        d, weight = transmitted(self._mi, s.normal, self._v, roughness, ior, s.is_thick, u)
        return d, dr.select(leaves, self._mi.Color3f(1.0), weight * self.transmitted_share)


class ChosenLobe:
    """One of several lobes, as in ``Layers``, chosen in proportion to what each reflects; ``tint`` makes up for that.

    Parameters
    ----------
    choice : mitsuba.Float
        A random number in [0, 1).
    """

    def __init__(self, mi: Any, lobes: Sequence[tuple[Any, Any, Any]], choice: Any) -> None:
        chances = [dr.select(is_there, dr.max(share * lobe.albedo()), 0.0) for lobe, share, is_there in lobes]
        total = sum(chances)
        left, self._lobes = choice * total, []
        self.roughness = mi.Float(1.0)
        for (lobe, share, _), chance in zip(lobes, chances, strict=True):
            is_chosen = (left >= 0) & (left < chance)
            self._lobes.append((lobe, share * total / chance, is_chosen))
            self.roughness = dr.select(is_chosen, lobe.roughness, self.roughness)
            left -= chance

    def sample(self, u: Any) -> Any:
        d = self._lobes[0][0].sample(u)
        for lobe, _, is_chosen in self._lobes[1:]:
            d = dr.select(is_chosen, lobe.sample(u), d)
        return d

    def pdf(self, l: Any) -> Any:  # noqa: E741
        return sum(dr.select(is_chosen, lobe.pdf(l), 0.0) for lobe, _, is_chosen in self._lobes)

    def eval(self, l: Any) -> Any:  # noqa: E741
        return sum(dr.select(is_chosen, lobe.eval(l), 0.0) for lobe, _, is_chosen in self._lobes)

    def tint(self, l: Any) -> Any:  # noqa: E741
        return sum(dr.select(is_chosen, factor * lobe.tint(l), 0.0) for lobe, factor, is_chosen in self._lobes)


def _schlick(f0: Any, normal: Any, v: Any) -> Any:
    return f0 + (1 - f0) * dr.power(1 - dr.clip(dr.dot(normal, v), 0, 1), 5)
