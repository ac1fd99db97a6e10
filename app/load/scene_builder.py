"""The scene under construction: growing lists, and meshes that are cleaned as they are added."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace

import numpy as np

from app.animation.deformation import Deformation
from app.animation.node_tree import NodePlacement
from app.arrays import F32, F64, Floats, Ints
from app.errors import SceneError
from app.load.geometry import RawMesh, clean
from app.load.tangents import with_tangents
from app.scene import CameraPath, EmissionPoints, Environment, Instance, Light, Material, Mesh

MAX_COORDINATE, MAX_RADIANCE = 1e15, 1e30  # as in scene.schema.json
MAX_TRIANGLES = MAX_VERTICES = 2**26       # of all meshes; a small file can repeat a large mesh
MAX_INSTANCES = 2**18
ALL_ANIMATIONS, NO_ANIMATION = "all", "none"  # beside the names of a file's animations


@dataclass
class SceneBuilder:
    """What a reader has added so far.

    Attributes
    ----------
    where : str
        The file, for messages.
    groups : dict of str to list of int
        Indices into ``instances`` of everything that a name in the file moves: an object, or a node with all its
        descendants.
    approximate_lights, approximated_materials, approximations
        See ``Scene``.
    variant : str or None
        Which of ``variants``, the file's sets of materials (KHR_materials_variants), is wanted; None: its default.
    dropped_triangles, dropped_normals : int
        How many were broken; face normals replace broken normals.
    animation : str or None
        The animation to play; None for the first.
    animations : list of str
        Names of the file's animations.
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
    approximate_lights: dict[Light, EmissionPoints] = field(default_factory=dict)
    approximated_materials: list[int] = field(default_factory=list)
    approximations: list[str] = field(default_factory=list)
    variant: str | None = None
    variants: list[str] = field(default_factory=list)
    dropped_triangles: int = 0
    dropped_normals: int = 0
    animation: str | None = None
    animations: list[str] = field(default_factory=list)
    _read_vertices: int = 0
    _read_triangles: int = 0
    _offsets: dict[int, F64] = field(default_factory=dict)
    _sources: dict[int, Ints] = field(default_factory=dict)

    def fork(self) -> SceneBuilder:
        """A builder that holds the same and grows on its own from here."""
        copies = {f.name: copy(getattr(self, f.name)) for f in fields(self)}
        return SceneBuilder(**{**copies, "groups": {name: [*members] for name, members in self.groups.items()}})

    def notice(self, text: str) -> None:
        """Add a notice for the user, once."""
        if text not in self.notices:
            self.notices.append(text)

    def approximation(self, text: str) -> None:
        """Say what is only approximated, once."""
        if text not in self.approximations:
            self.approximations.append(text)

    def add_mesh(self, name: str, raw: RawMesh, material: int) -> int | None:
        """Clean a mesh and add it; None if nothing of it is visible.

        Raises
        ------
        SceneError
            When a triangle refers to a missing vertex.
        """
        m = self.materials[material]
        if m.alpha_cutoff is not None and m.alpha < m.alpha_cutoff and m.albedo_map is None:
            self.notice(f"material {m.name!r} is below its alpha cutoff, so its surfaces are omitted")
            return None
        self._count(raw)
        if len(raw.triangles) and int(raw.triangles.max()) >= len(raw.positions):
            raise SceneError(f"a triangle of {name!r} refers to a missing vertex", self.where,
                             "expected indices below the vertex count")
        cleaned = clean(with_tangents(raw, m))
        self.dropped_triangles += cleaned.dropped_triangles
        self.dropped_normals += cleaned.dropped_normals
        if not len(cleaned.triangles):
            return None
        positions = cleaned.positions
        center = (positions.min(axis=0) + positions.max(axis=0)) / 2
        index = len(self.meshes)
        self.meshes.append(Mesh(
            name=name,
            positions=(positions - center).astype(np.float32),
            normals=cleaned.normals.astype(np.float32),
            triangles=cleaned.triangles.astype(np.uint32),
            material=material,
            uvs=_float32(cleaned.uvs),
            colors=_float32(cleaned.colors),
            second_uvs=_float32(cleaned.second_uvs),
            tangents=_float32(cleaned.tangents),
        ))
        self._offsets[index] = center
        if cleaned.source is not None:
            self._sources[index] = cleaned.source
        return index

    def add_instance(self, name: str, mesh: int, transform: F64, groups: Sequence[str] = (),
                     placement: NodePlacement | None = None, deformation: Deformation | None = None) -> None:
        """Place a mesh in the world; ``transform`` maps the mesh coordinates of the file to world space.

        So does ``placement`` at any time, and ``deformation`` gives these coordinates of all vertices of the file's.
        """
        if not np.isfinite(transform).all():
            raise SceneError(f"the transform of {name!r} is not finite", self.where, "expected finite numbers")
        if len(self.instances) >= MAX_INSTANCES:
            raise SceneError("the scene has too many objects", self.where,
                             f"expected at most {MAX_INSTANCES:,} instances")
        centered = transform.copy()
        centered[:3, 3] += transform[:3, :3] @ self._offsets[mesh]
        for group in dict.fromkeys((name, *groups)):
            self.groups.setdefault(group, []).append(len(self.instances))
        if deformation is not None:
            deformation = deformation.select(self._sources[mesh], self._offsets[mesh])
        self.instances.append(Instance(
            name, mesh, centered, deformation=deformation,
            placement=None if placement is None else placement.shifted(self._offsets[mesh])))

    def _count(self, raw: RawMesh) -> None:
        self._read_vertices += len(raw.positions)
        self._read_triangles += len(raw.triangles)
        if self._read_vertices > MAX_VERTICES or self._read_triangles > MAX_TRIANGLES:
            raise SceneError("the scene is too large", self.where,
                             f"expected at most {MAX_TRIANGLES:,} triangles and as many vertices")

    def scale_emission(self, factor: float) -> None:
        """Multiply the emission of all materials."""
        self.materials = [replace(m, emission=color(np.multiply(m.emission, factor))) for m in self.materials]

    def notice_repairs(self) -> None:
        """Add notices about broken triangles and normals."""
        if self.dropped_triangles:
            self.notice(f"{self.dropped_triangles} triangles without area or with non-finite corners are omitted")
        if self.dropped_normals:
            self.notice(f"{self.dropped_normals} normals are broken, so face normals replace them")

    def drop_unused(self) -> None:
        """Remove meshes without an instance and materials without a mesh."""
        meshes = sorted({i.mesh for i in self.instances})
        materials = sorted({self.meshes[i].material for i in meshes})
        new_mesh = {old: new for new, old in enumerate(meshes)}
        new_material = {old: new for new, old in enumerate(materials)}
        self.meshes = [replace(self.meshes[i], material=new_material[self.meshes[i].material]) for i in meshes]
        self.materials = [self.materials[i] for i in materials]
        self.approximated_materials = [new_material[i] for i in self.approximated_materials if i in new_material]
        self.instances = [replace(i, mesh=new_mesh[i.mesh]) for i in self.instances]


def _float32(values: F64 | None) -> F32 | None:
    return None if values is None else values.astype(np.float32)


def color(values: Sequence[float] | Floats) -> tuple[float, float, float]:
    """Three plain floats from 0 to ``MAX_RADIANCE``; non-finite values become 0."""
    r, g, b = np.clip(np.nan_to_num(np.asarray(values, np.float64), posinf=0.0), 0.0, MAX_RADIANCE).tolist()
    return r, g, b


def vector(values: Sequence[float] | F64) -> tuple[float, float, float]:
    """Three plain floats."""
    x, y, z = (float(v) for v in values)
    return x, y, z
