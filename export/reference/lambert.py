"""A diffuse surface, with the interface of ``GgxLobe``."""

from typing import Any

import drjit as dr


class LambertLobe:
    """Reflects 1/π in all directions around the shading normal; directions are sampled by their cosine."""

    def __init__(self, mi: Any, normal: Any, albedo: Any = 1.0) -> None:
        self._mi, self._normal, self._albedo = mi, normal, albedo
        self.roughness = 1.0

    def sample(self, u: Any) -> Any:
        return self._mi.Frame3f(self._normal).to_world(self._mi.warp.square_to_cosine_hemisphere(u))

    def pdf(self, l: Any) -> Any:  # noqa: E741
        return self.eval(l)

    def eval(self, l: Any) -> Any:  # noqa: E741
        """1/π times the cosine of ``l``; 0 below the horizon."""
        return dr.maximum(dr.dot(self._normal, l), 0) / dr.pi

    def tint(self, l: Any) -> Any:  # noqa: E741
        return self._albedo

    def albedo(self) -> Any:
        return self._albedo
