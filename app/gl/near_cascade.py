"""Near cascades: second shadow maps of parallel light, for what is around the eye.

The map of a whole scene shows a room amid a large garden by texels that are much larger than pixels. A cascade shows
less, more finely (Dimitrov 2007, "Cascaded Shadow Maps"). It follows the eye in steps, so it is seldom drawn again.
"""

import math
from dataclasses import dataclass

import numpy as np

from app.arrays import F64
from app.gl.shadow_atlas import CASCADE_TEXELS, FACE_TEXELS, PARALLEL_MAP
from app.math3d import row_dots, row_lengths, spread_points
from app.scene import Scene

POINTS = 4096           # on the scene's surfaces
MAX_TRIANGLES = 2**16   # of a mesh, among which points are chosen
NEAR_SHARE = 0.25       # of what surrounds an eye counts as near
MIN_RELATIVE_HALF = 8.0 # half width of the whole map / distance of what is near, from which on a cascade pays
STEPS = 4               # in which a cascade follows the eye, along its half width


@dataclass(frozen=True)
class Cascade:
    """A square of the plane of a directional light's map.

    Attributes
    ----------
    center : tuple of float
        Relative to that of the whole map, in scene units along its axes.
    half : float
        Half width, in scene units.
    """

    center: tuple[float, float]
    half: float


def cascade_around(eye: F64, half: float, near: float) -> Cascade | None:
    """The near cascade for an eye, or None where the whole map shows as much.

    Parameters
    ----------
    eye : ndarray, float64, shape (2,)
        Relative to the centre of the whole map, along its axes.
    half : float
        Half width of the whole map.
    near : float
        Distance of what is near the eye.

    Notes
    -----
    Texels of the whole map are w = 2 half / (N a near) pixels wide at what is near, with N of them along the map and
    pixels of angle a; those of a cascade of half width c and N / m texels are w m c / half wide there. At the cascade's
    edge those of the whole map are w near / c wide. Both are small together where c² = half near / m.
    """
    if not half >= MIN_RELATIVE_HALF * near:
        return None
    relative_texels = FACE_TEXELS[PARALLEL_MAP] / CASCADE_TEXELS
    ratio = relative_texels * half / max(near, 1e-6 * half)
    own = half / 2.0 ** round(math.log2(ratio) / 2)
    step = own / STEPS
    x, y = np.round(eye / step) * step
    return Cascade((float(x), float(y)), own)


class Surroundings:
    """Tells how far away what surrounds an eye is, from points on the surfaces of ``scene`` at time 0."""

    def __init__(self, scene: Scene) -> None:
        corners, areas = [np.zeros((0, 3, 3))], [np.zeros(0)]
        for instance in scene.instances:
            mesh, m = scene.meshes[instance.mesh], instance.transform_at(0.0)
            step = -(-len(mesh.triangles) // MAX_TRIANGLES)
            own = mesh.positions.astype(np.float64)[mesh.triangles[::step]] @ m[:3, :3].T + m[:3, 3]
            corners.append(own)
            areas.append(step / 2 * row_lengths(np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])))
        area = np.nan_to_num(np.concatenate(areas), posinf=0.0)
        self._area = float(area.sum()) / POINTS
        self._points, self._normals = (spread_points(np.concatenate(corners), area, POINTS, np.random.default_rng(0))
                                       if self._area > 0 else (np.zeros((0, 3)), np.zeros((0, 3))))

    def near_distance(self, eye: F64) -> float:
        """Distance up to which ``NEAR_SHARE`` of what surrounds a world-space ``eye`` lies, by solid angle.

        No surface hides another. Infinite where there are none.
        """
        to_points = self._points - eye
        distance = row_lengths(to_points)
        solid_angle = np.abs(row_dots(to_points, self._normals)) / (distance * (distance**2 + self._area) + 1e-300)
        order = np.argsort(distance)
        sums = np.cumsum(solid_angle[order])
        if not len(sums) or not sums[-1] > 0:
            return math.inf
        return float(distance[order[np.searchsorted(sums, NEAR_SHARE * sums[-1])]])
