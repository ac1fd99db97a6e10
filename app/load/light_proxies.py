"""Marks the surfaces that lights stand for, so that their emission does not count twice."""

from dataclasses import replace

import numpy as np

from app.arrays import Bools, Ints
from app.load.scene_builder import SceneBuilder


class ProxySplitter:
    """Gives triangles that became lights copies of their materials that are marked as light proxies."""

    def __init__(self, builder: SceneBuilder) -> None:
        self._builder = builder
        self._materials: dict[tuple[int, bool], int] = {}
        self._meshes: dict[tuple[int, bytes, bool], int] = {}

    def split(self, index: int, exact: Ints) -> None:
        """Replace instance ``index`` by its triangles ``exact``, which are exactly lights, and all others."""
        instance = self._builder.instances[index]
        mask = np.zeros(len(self._builder.meshes[instance.mesh].triangles), bool)
        mask[exact] = True
        parts = [replace(instance, mesh=self._extract(instance.mesh, side, is_exact))
                 for is_exact, side in ((True, mask), (False, ~mask)) if side.any()]
        self._builder.instances[index] = parts[0]
        self._builder.instances += parts[1:]

    def _extract(self, mesh: int, mask: Bools, exact: bool) -> int:
        key = (mesh, mask.tobytes(), exact)
        if key not in self._meshes:
            source = self._builder.meshes[mesh]
            self._meshes[key] = len(self._builder.meshes)
            self._builder.meshes.append(replace(source, triangles=source.triangles[mask],
                                                material=self._proxy_material(source.material, exact)))
        return self._meshes[key]

    def _proxy_material(self, material: int, exact: bool) -> int:
        if (material, exact) not in self._materials:
            self._materials[material, exact] = len(self._builder.materials)
            if not exact:
                self._builder.approximated_materials.append(len(self._builder.materials))
            self._builder.materials.append(replace(self._builder.materials[material], is_light_proxy=True))
        return self._materials[material, exact]
