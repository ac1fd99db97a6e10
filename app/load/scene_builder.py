"""The scene while it is being read: lists that grow, and geometry that is cleaned on its way in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from app.errors import SceneError
from app.load.geometry import Surface, clean
from app.scene import F64, CameraPath, Environment, Instance, Light, Material, Mesh

LARGEST, BRIGHTEST = 1e15, 1e30  # coordinates and light, as in scene.schema.json


@dataclass
class SceneBuilder:
    """What a reader has found so far.

    Attributes
    ----------
    where : str
        The file, for messages.
    groups : dict of str to list of int
        Indices into ``instances`` of everything that one name of the file moves: an object, or a
        node with all that hangs below it.
    dropped, flattened : int
        Triangles left out, and normals replaced, because they were broken.
    """

    where: str
    meshes: list[Mesh] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    cameras: dict[str, CameraPath] = field(default_factory=dict)
    groups: dict[str, list[int]] = field(default_factory=dict)
    notices: list[str] = field(default_factory=list)
    environment: Environment | None = None
    dropped: int = 0
    flattened: int = 0
    _offsets: dict[int, F64] = field(default_factory=dict)

    def notice(self, text: str) -> None:
        """Tell the user once."""
        if text not in self.notices:
            self.notices.append(text)

    def add_mesh(self, name: str, surface: Surface, material: int) -> int | None:
        """Clean a surface and keep it; None when nothing of it can be seen.

        Raises
        ------
        SceneError
            When a triangle names a vertex that is not there.
        """
        looks = self.materials[material]
        if looks.alpha_cutoff is not None and looks.alpha < looks.alpha_cutoff and looks.albedo_map is None:
            self.notice(f"material {looks.name!r} is more than half transparent: its surfaces are left out")
            return None
        if len(surface.triangles) and int(surface.triangles.max()) >= len(surface.positions):
            raise SceneError(f"a triangle of {name!r} names a vertex that is not there", self.where,
                             "expected indices below the vertex count")
        cleaned = clean(surface)
        self.dropped += cleaned.dropped
        self.flattened += cleaned.flattened
        if not len(cleaned.surface.triangles):
            return None
        kept = cleaned.surface
        positions = kept.positions
        center = (positions.min(axis=0) + positions.max(axis=0)) / 2
        index = len(self.meshes)
        self.meshes.append(Mesh(
            name=name,
            positions=(positions - center).astype(np.float32),
            normals=kept.normals.astype(np.float32),  # type: ignore[union-attr]
            triangles=kept.triangles.astype(np.uint32),
            material=material,
            uvs=None if kept.uvs is None else kept.uvs.astype(np.float32),
            colors=None if kept.colors is None else kept.colors.astype(np.float32),
        ))
        self._offsets[index] = center
        return index

    def place(self, name: str, mesh: int, transform: F64, groups: Sequence[str] = ()) -> None:
        """Put a mesh into the world; ``transform`` maps the file's own mesh coordinates to the world."""
        if not np.isfinite(transform).all():
            raise SceneError(f"the transform of {name!r} is not finite", self.where, "expected finite numbers")
        centered = transform.copy()
        centered[:3, 3] += transform[:3, :3] @ self._offsets[mesh]
        for group in dict.fromkeys((name, *groups)):
            self.groups.setdefault(group, []).append(len(self.instances))
        self.instances.append(Instance(name, mesh, centered))

    def scale_emission(self, factor: float) -> None:
        """Multiply every material's emission."""
        self.materials = [replace(m, emission=color(np.multiply(m.emission, factor))) for m in self.materials]

    def notice_repairs(self) -> None:
        """Say what was broken in the meshes."""
        if self.dropped:
            self.notice(f"{self.dropped} triangles without area or with non-finite corners are left out")
        if self.flattened:
            self.notice(f"{self.flattened} normals are broken: face normals are used there")

    def drop_unused(self) -> None:
        """Forget meshes that are nowhere placed and materials that no mesh has."""
        meshes = sorted({i.mesh for i in self.instances})
        materials = sorted({self.meshes[i].material for i in meshes})
        new_mesh = {old: new for new, old in enumerate(meshes)}
        new_material = {old: new for new, old in enumerate(materials)}
        self.meshes = [replace(self.meshes[i], material=new_material[self.meshes[i].material]) for i in meshes]
        self.materials = [self.materials[i] for i in materials]
        self.instances = [replace(i, mesh=new_mesh[i.mesh]) for i in self.instances]


def color(values: Sequence[float] | NDArray[np.floating]) -> tuple[float, float, float]:
    """Three plain floats from 0 to ``BRIGHTEST``; what is not finite becomes 0."""
    r, g, b = np.clip(np.nan_to_num(np.asarray(values, np.float64), posinf=0.0), 0.0, BRIGHTEST).tolist()
    return r, g, b


def vector(values: Sequence[float] | F64) -> tuple[float, float, float]:
    """Three plain floats."""
    x, y, z = (float(v) for v in values)
    return x, y, z
