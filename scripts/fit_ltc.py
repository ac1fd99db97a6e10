"""Fit ``app/data/ltc.npy``: linearly transformed cosines for each roughness and viewing angle of the GGX lobe.

The lobe f(l), GGX times the cosine at the light (``shaders/include/ggx_lobe.glsl``), is approximated above the surface
by

    f(l) ≈ Σ w_i · M_i l det(M_i) / |M_i l|⁴

with M_i = [[a, 0, b], [0, c, 0], [0, 0, 1]] and w_i = (w_x, 0, w_z), in the frame whose z axis is the mirrored view and
whose x axis lies in the plane of incidence, turned away from the surface (Heitz, Dupuy, Hill and Neubelt 2016,
"Real-Time Polygonal-Light Shading with Linearly Transformed Cosines"). Unlike theirs, w_i is free, is not clamped below
zero, and light is clipped at the surface's own horizon, where a lobe seen at a grazing angle ends abruptly. There are
two cosines, and a third one beyond column LAST_TWO_LOBED of the table, where two are not enough.

The fit minimises errors of integrals over spherical caps of several sizes, relative to the largest such integral of
each size. Neighbouring cells are drawn together, so that their parameters can be interpolated. It takes a few minutes
with OPENBLAS_NUM_THREADS=1, which suits small matrices in several processes, and needs scipy.

Cells at grazing angles, and of rough surfaces from 66° on, are then refined all at once. What is minimised there are
errors over rectangles, at the cells and halfway between them, where parameters are interpolated. The approximation is
integrated in closed form, so that no lobe is too thin to be seen by samples. ``--refine`` does only this, from the
table that is there, in a minute or two.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import least_squares
from scipy.sparse.linalg import splu

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # app, which need not be installed

from app.arrays import F64
from app.io.atomic_files import replace_file
from app.paths import data_dir

ROUGHNESSES, ANGLES, LOBES = 20, 32, 3
LAST_TWO_LOBED = 13  # column, as in shaders/include/ltc.glsl
MIN_ALPHA = 2e-3  # as in shaders/include/ggx_lobe.glsl
MIN_COSINE = 1e-3  # of the viewing angle, as in shaders/include/ltc.glsl
GOLDEN_RATIO = (math.sqrt(5) - 1) / 2
RINGS = 48  # of light directions, along the edge of a square of samples
GRAZING, GRAZING_RINGS = 20, 96  # from this column on, where the horizon cuts lobes off
CAP_RADII = np.array([0.12, 0.3, 0.6, 1.2])  # radians, of a lobe as wide as the hemisphere
ALBEDO_WEIGHT = 4.0
TYPICAL_ERROR = 0.02  # larger errors count with their fourth power
SMOOTHNESS = 0.03  # weight of a parameter's distance from the mean of its neighbours
SWEEPS = (0.3, 0.3, 0.1, 0.1, SMOOTHNESS, SMOOTHNESS)  # the smoothness of each; the first join paths
ANCHOR = (11, 20)  # the cell where the continuation starts, from two lobes that a search from random starts found
ANCHOR_PARAMETERS = np.array([0.31, -0.48, -0.80, 0.15, 0.10, 0.79, -0.19, 0.35, 0.04, 0.08, 0, 0, 0, 0, 0])
THIRD_ANCHOR = (8, 26)  # the cell where the continuation of the third lobe starts, found alike
THIRD_ANCHOR_PARAMETERS = np.array([0.21, -0.68, -1.58, 0.2, 0.01, 0.56, -0.42, 0.16, 0.12, 0.12,
                                    -0.46, 0.27, -1.56, -0.01, 0.09])
THIRD_SMOOTHNESS = 0.01  # while the third lobe is spread
LAST_ROW_REFITTED = 22  # from this column on

MIN_SWAP_GAIN = 0.5  # by how much lobes must come nearer to those of the column before to change places
REFINED_ROW = 12  # from this roughness on, more columns are refined
SMOOTH_COLUMN, ROUGH_COLUMN = 23, 15  # the first refined ones, in rows before it and in those from it on
PANES, WINDOW_PANES = 64, 28  # of each width, of each window
PANE_WIDTHS = (0.35, 1.0, 3.0, math.inf)  # as multiples of the lobe's, at most MAX_PANE_WIDTH
MAX_PANE_WIDTH = 1.6
CLASS_WEIGHTS = np.array([1.0, 1.0, 1.5, 1.5, 1.5, 1.5])  # of PANE_WIDTHS, narrow windows, large windows
REFINED_ERROR = 0.016  # as TYPICAL_ERROR
REFINED_ALBEDO_WEIGHT = 3.0
REFINED_SMOOTHNESS = 0.3
LOGARITHMIC = np.tile([True, False, True, False, False], LOBES)  # parameters of the table
REFINED_SCALES = np.tile([1, 0.3, 1, 0.1, 0.1], LOBES)  # of a lobe's a, b, c, w_x and w_z
MAX_REFINING_STEPS = 60
MIN_GAIN = 1e-4  # of a step, as a share of the sum of squares
DIFFERENCE = 1e-5  # of a parameter, for derivatives
HORIZON = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, -1, 0]])  # corners of everything above it

Cell = tuple[int, int]


@dataclass(frozen=True)
class View:
    """A roughness and a viewing angle.

    Attributes
    ----------
    alpha : float
        Width of the GGX distribution, roughness squared.
    cosine : float
        Cosine of the angle between normal and view.
    """

    alpha: float
    cosine: float

    @property
    def sine(self) -> float:
        return math.sqrt(1 - self.cosine**2)

    @property
    def view(self) -> F64:
        """Unit vector to the viewer, shape (3,); the normal is z."""
        return np.array([self.sine, 0.0, self.cosine])

    @property
    def frame(self) -> F64:
        """Rows, shape (3, 3): the lobe's axes x, y, z."""
        return np.array([[self.cosine, 0, self.sine], [0, 1, 0], [-self.sine, 0, self.cosine]])

    @property
    def slopes(self) -> F64:
        """``a`` and ``c`` of a narrow lobe, shape (2,); the table holds ratios to them."""
        across = math.sqrt(self.cosine**2 + 0.5 * (self.alpha * self.sine) ** 2)
        return np.array([0.5 / self.alpha, 0.5 / (self.alpha * across)])


def view_of(cell: tuple[float, float]) -> View:
    """The view of a cell, or of a point between cells; rows count roughness, columns angle, denser towards grazing."""
    angle = 0.5 * math.pi * (1 - (1 - cell[1] / (ANGLES - 1)) ** 2)
    roughness = math.sqrt(MIN_ALPHA) + (1 - math.sqrt(MIN_ALPHA)) * cell[0] / (ROUGHNESSES - 1)
    return View(roughness**2, max(math.cos(angle), MIN_COSINE))


def evaluate_ggx(view: View, light: F64) -> F64:
    """GGX lobe times the cosine at the light, per steradian, shape (N,), for unit vectors ``light`` of shape (N, 3)."""
    half = light + view.view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    a2, n_v, n_l = view.alpha**2, view.cosine, light[:, 2]
    q = half[:, 0] ** 2 + half[:, 1] ** 2 + a2 * half[:, 2] ** 2
    smith = n_l * np.sqrt(n_v**2 * (1 - a2) + a2) + n_v * np.sqrt(n_l**2 * (1 - a2) + a2)
    return np.where(n_l > 0, a2 / (np.pi * q**2) * 0.5 / np.maximum(smith, 1e-12) * n_l, 0)


def evaluate_cosines(view: View, parameters: F64) -> tuple[F64, F64]:
    """Matrices M of shape (3, 3, 3) and weights w of shape (3, 3), from a cell's ``parameters`` of shape (15,)."""
    matrices, weights = np.zeros((LOBES, 3, 3)), np.zeros((LOBES, 3))
    for matrix, weight, (log_a, b, log_c, w_x, w_z) in zip(matrices, weights, parameters.reshape(-1, 5), strict=True):
        a, c = view.slopes * np.exp([log_a, log_c])
        matrix[:] = [[a, 0, b], [0, c, 0], [0, 0, 1]]
        weight[:] = w_x, 0, w_z
    return matrices, weights


def evaluate_lobe(view: View, parameters: F64, light: F64) -> F64:
    """The approximation at unit vectors ``light`` of shape (N, 3), as ``evaluate_ggx``."""
    local = light @ view.frame.T
    total = np.zeros(len(light))
    for matrix, weight in zip(*evaluate_cosines(view, parameters), strict=True):
        at = local @ matrix.T
        total += at @ weight * np.linalg.det(matrix) / (at * at).sum(1) ** 2
    return total


def sample_lights(view: View, rings: int = RINGS) -> tuple[F64, F64]:
    """Directions with y > 0, where the lobe is and anywhere, shape (N, 3), and their solid angles, shape (N,)."""
    even = (np.arange(rings) + 0.5) / rings
    u, phi = (x.ravel() for x in np.meshgrid(even, np.pi * even, indexing="ij"))
    slope = np.sqrt(u / (1 - u)) * view.alpha
    half = np.stack([slope * np.cos(phi), slope * np.sin(phi), np.ones_like(u)], 1)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    mirrored = 2 * (half @ view.view)[:, None] * half - view.view
    sine = np.sqrt(1 - u**2)
    uniform = np.stack([sine * np.cos(phi), sine * np.sin(phi), u], 1)
    light = np.concatenate([mirrored[(mirrored[:, 2] > 0) & (half @ view.view > 0)], uniform])
    half = light + view.view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    q = half[:, 0] ** 2 + half[:, 1] ** 2 + view.alpha**2 * half[:, 2] ** 2
    density = 2 * view.alpha**2 / (np.pi * q**2) * half[:, 2] / (4 * half @ view.view) + 1 / np.pi
    return light, 1 / (density * rings**2)


def sample_caps(view: View, count: int = 32) -> F64:
    """Centres of spherical caps, shape (2 count, 3): some around the lobe, some anywhere."""
    even, turn = (np.arange(count) + 0.5) / count, np.pi * (np.arange(count) * GOLDEN_RATIO % 1)
    z = 1 - 1.5 * even
    sine = np.sqrt(1 - z**2)
    anywhere = np.stack([sine * np.cos(turn), sine * np.sin(turn), z], 1)
    slope = np.sqrt(0.97 * even / (1 - 0.97 * even)) * max(view.alpha, 0.002)
    half = np.stack([slope * np.cos(turn), slope * np.sin(turn), np.ones(count)], 1)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return np.concatenate([anywhere, 2 * (half @ view.view)[:, None] * half - view.view])


class CellProblem:
    """Errors of one cell's lobe: integrals over caps, relative to the largest over one of that size, and albedo.

    Parameters
    ----------
    lobes : int
        How many of the cosines may have a weight.
    """

    def __init__(self, cell: Cell, lobes: int) -> None:
        self.view = view_of(cell)
        # A view along the normal has no plane of incidence: a and c are equal, b and w_x are 0.
        isotropic = np.array([[1.0, 0], [0, 0], [1, 0], [0, 0], [0, 1]])
        constraint = np.kron(np.eye(LOBES), isotropic) if cell[1] == 0 else np.eye(5 * LOBES)
        constraint[[5 * lobe + i for lobe in range(lobes, LOBES) for i in (3, 4)]] = 0
        self._constraint = constraint[:, constraint.any(axis=0)]
        light, solid_angle = sample_lights(self.view, GRAZING_RINGS if cell[1] >= GRAZING else RINGS)
        self._light = light
        exact = evaluate_ggx(self.view, light)
        centres = sample_caps(self.view)
        distances = [np.arccos(np.clip(centres @ (light * [1, side, 1]).T, -1, 1)) for side in (1, -1)]
        radii = [*CAP_RADII * min(3 * self.view.alpha, 1.0), 1.0]
        weights = []
        for radius in radii:
            cap = sum(np.clip((radius - d) / (0.15 * radius) + 0.5, 0, 1) for d in distances) * solid_angle
            weights.append(cap / (cap @ exact).max() / math.sqrt(len(cap) * len(radii)))
        albedo = 2 * solid_angle
        self._weights = np.concatenate([*weights, ALBEDO_WEIGHT * albedo[None] / (albedo @ exact)])
        self._exact = self._weights @ exact
        self._scale = math.sqrt(len(centres) * len(radii))

    def errors(self, parameters: F64) -> F64:
        """Errors as shares of the largest integrals, each divided by the root of their number, shape (E,)."""
        return self._weights @ evaluate_lobe(self.view, parameters, self._light) - self._exact

    def slopes(self, parameters: F64) -> F64:
        """Derivatives of the errors by the parameters, shape (E, 15)."""
        columns = []
        local = self._light @ self.view.frame.T
        for matrix, weight in zip(*evaluate_cosines(self.view, parameters), strict=True):
            at = local @ matrix.T
            square = (at * at).sum(1)
            density = np.linalg.det(matrix) / square**2
            lobe, steep = at @ weight * density, matrix[0, 0] * local[:, 0]
            columns += [lobe + weight[0] * steep * density - 4 * lobe * at[:, 0] * steep / square,
                        weight[0] * local[:, 2] * density - 4 * lobe * at[:, 0] * local[:, 2] / square,
                        lobe - 4 * lobe * at[:, 1] ** 2 / square,
                        at[:, 0] * density, at[:, 2] * density]
        return self._weights @ np.stack(columns, 1)

    def fit(self, start: F64, target: F64, smoothness: float = SMOOTHNESS) -> F64:
        """Parameters near ``target``, shape (15,), by least squares from ``start``."""
        def residuals(free: F64) -> F64:
            parameters = self._constraint @ free
            errors = self.errors(parameters)
            return np.concatenate([errors * self._emphasis(errors), smoothness * (parameters - target)])

        def jacobian(free: F64) -> F64:
            parameters = self._constraint @ free
            emphasis = self._emphasis(self.errors(parameters))
            slopes = self.slopes(parameters) * (2 * emphasis - 1 / emphasis)[:, None]
            return np.concatenate([slopes, smoothness * np.eye(len(target))]) @ self._constraint

        free = np.linalg.lstsq(self._constraint, start)[0]
        return self._constraint @ least_squares(residuals, free, jacobian, max_nfev=30).x

    def largest_error(self, parameters: F64) -> float:
        """Over caps, as a share of the largest integral over a cap of that size."""
        return float(np.abs(self.errors(parameters)[:-1]).max()) * self._scale

    def _emphasis(self, errors: F64) -> F64:
        return np.sqrt(1 + (errors * self._scale / TYPICAL_ERROR) ** 2)


def fit_path(cells: list[Cell], start: F64) -> list[F64]:
    """Parameters of two lobes in ``cells``, each begun at those of the one before it."""
    found = []
    for cell in cells:
        fitted = CellProblem(cell, 2).fit(start, start)
        swapped = np.concatenate([fitted[5:10], fitted[:5], fitted[10:]])  # the same lobes in the other order
        is_swapped = np.abs(swapped - start).sum() < np.abs(fitted - start).sum()
        start = swapped if is_swapped else fitted
        found.append(start)
    return found


def fit_third_path(cells: list[Cell], pairs: list[F64], start: F64) -> list[F64]:
    """Parameters of three lobes in ``cells``, each begun at those of the one before it.

    The first two lobes are begun at those of ``pairs``, which were fitted alone, but for rough cells, where these jump.
    """
    found = []
    for cell, pair in zip(cells, pairs, strict=True):
        if cell[0] <= THIRD_ANCHOR[0]:
            start = np.concatenate([pair[:10], start[10:]])
        start = CellProblem(cell, 3).fit(start, start, THIRD_SMOOTHNESS)
        found.append(start)
    return found


def fit_cell(cell: Cell, start: F64, target: F64, smoothness: float = SMOOTHNESS, lobes: int = LOBES) -> F64:
    """Parameters of one cell; a function of the module, so that other processes can call it."""
    return CellProblem(cell, lobes if cell[1] > LAST_TWO_LOBED else 2).fit(start, target, smoothness)


def mean_of_neighbours(table: F64, cell: Cell) -> F64:
    """Mean of opposite neighbours where both are there; of any at a corner."""
    i, j = cell
    pairs = [[(i - 1, j), (i + 1, j)], [(i, j - 1), (i, j + 1)]]
    inside = [[c for c in pair if 0 <= c[0] < ROUGHNESSES and 0 <= c[1] < ANGLES] for pair in pairs]
    whole = [pair for pair in inside if len(pair) == 2] or inside
    return np.mean([table[c] for pair in whole for c in pair], axis=0)


def fit_table(workers: int) -> F64:
    """Parameters of all cells, shape (ROUGHNESSES, ANGLES, 15).

    From the anchor along its row, from there along all columns, and then in sweeps over every other cell; first two
    lobes everywhere, then a third where it belongs.
    """
    table = np.zeros((ROUGHNESSES, ANGLES, 5 * LOBES))
    row, column = ANCHOR
    paths = [[(row, j) for j in range(column, -1, -1)], [(row, j) for j in range(column, ANGLES)]]
    with ProcessPoolExecutor(workers) as pool:
        _continue(table, paths, pool.map(fit_path, paths, [ANCHOR_PARAMETERS] * 2))
        paths = _columns(row, range(ANGLES))
        _continue(table, paths, pool.map(fit_path, paths, [table[row, path[0][1]] for path in paths]))
        _sweep(pool, table, range(ANGLES), 2)
        row, column = THIRD_ANCHOR
        third = range(LAST_TWO_LOBED + 1, ANGLES)
        table[THIRD_ANCHOR] = THIRD_ANCHOR_PARAMETERS
        along_row = [[(row, j) for j in range(column, LAST_TWO_LOBED, -1)], [(row, j) for j in range(column, ANGLES)]]
        for paths in (along_row, _columns(row, third)):
            pairs = [[table[cell] for cell in path] for path in paths]
            starts = [table[row, column if path[0][0] == row else path[0][1]] for path in paths]
            _continue(table, paths, pool.map(fit_third_path, paths, pairs, starts))
        table[:, :LAST_TWO_LOBED + 1, 10:13] = table[:, LAST_TWO_LOBED + 1, None, 10:13]
        _sweep(pool, table, third, 3)
        # Sweeps tie the last row to itself alone, and at grazing angles it finds a minimum of its own, from which
        # parameters can't be interpolated to those of the row beside it.
        cells = [(ROUGHNESSES - 1, j) for j in range(LAST_ROW_REFITTED, ANGLES)]
        beside = [table[ROUGHNESSES - 2, j] for _, j in cells]
        for cell, parameters in zip(cells, pool.map(fit_cell, cells, beside, beside), strict=True):
            table[cell] = parameters
    return table


def _columns(row: int, columns: range) -> list[list[Cell]]:
    """Paths from ``row`` up and down."""
    return [[(i, j) for i in rows] for j in columns for rows in (range(row - 1, -1, -1), range(row + 1, ROUGHNESSES))]


def _sweep(pool: ProcessPoolExecutor, table: F64, columns: range, lobes: int) -> None:
    for smoothness, parity in ((s, p) for s in SWEEPS for p in (0, 1)):
        cells = [(i, j) for i in range(ROUGHNESSES) for j in columns if (i + j) % 2 == parity]
        starts, targets = [table[cell] for cell in cells], [mean_of_neighbours(table, cell) for cell in cells]
        found = pool.map(fit_cell, cells, starts, targets, [smoothness] * len(cells), [lobes] * len(cells), chunksize=8)
        for cell, parameters in zip(cells, found, strict=True):
            table[cell] = parameters


def _continue(table: F64, paths: list[list[Cell]], found: Iterable[list[F64]]) -> None:
    for path, parameters_along in zip(paths, found, strict=True):
        for cell, parameters in zip(path, parameters_along, strict=True):
            table[cell] = parameters


def sample_lobe(view: View, count: int = 2**15) -> tuple[F64, F64]:
    """Directions that GGX prefers, shape (N, 3), and weights, shape (N,), which add up to its directional albedo."""
    u, phi = (np.arange(count) + 0.5) / count, 2 * np.pi * (np.arange(count) * GOLDEN_RATIO % 1)
    slope = np.sqrt(u / (1 - u)) * view.alpha
    half = np.stack([slope * np.cos(phi), slope * np.sin(phi), np.ones(count)], 1)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    v_h = half @ view.view
    light = 2 * v_h[:, None] * half - view.view
    is_lit = (v_h > 0) & (light[:, 2] > 0)
    half, v_h, light = half[is_lit], v_h[is_lit], light[is_lit]
    q = half[:, 0] ** 2 + half[:, 1] ** 2 + view.alpha**2 * half[:, 2] ** 2
    density = view.alpha**2 / (np.pi * q**2) * half[:, 2] / (4 * v_h)
    return light, evaluate_ggx(view, light) / density / count


def sample_panes(view: View, random: np.random.Generator) -> tuple[F64, NDArray[np.int64]]:
    """Corners of rectangles seen from the origin, shape (N, 4, 3), and each one's class of sizes, shape (N,)."""
    def unit(x: F64) -> F64:
        return x / np.linalg.norm(x, axis=-1, keepdims=True)

    lights = sample_lobe(view, 2**12)[0]
    mirrored = np.array([-view.sine, 0.0, view.cosine])
    panes = []
    for width in PANE_WIDTHS:  # across the direction to them, three in four of them about the lobe
        centre = lights[random.integers(len(lights), size=PANES)]
        anywhere = unit(random.normal(size=(PANES, 3)))
        anywhere[:, 2] = np.abs(anywhere[:, 2])
        centre = np.where(random.random((PANES, 1)) < 0.25, anywhere, centre)
        u = unit(np.cross(centre, random.normal(size=(PANES, 3))))
        aspect = np.exp(random.normal(0, 0.5, (PANES, 1)))
        size = min(width * 2 * view.alpha, MAX_PANE_WIDTH)
        u, v = size * aspect * u, size / aspect * np.cross(centre, u)
        panes.append((centre + u * random.uniform(-1, 1, (PANES, 1)) / 2, u, v))
    facing = np.array([view.cosine, 0.0, view.sine])
    windows = [(1.2 * mirrored, (0, 1.8, 0), 0.25 * facing), ((-1.6, 0.1, 0.15), (0, 1.8, 0.1), (0.1, -0.1, 0.25)),
               (1.2 * mirrored, (0.3, 1.6, 0), 1.6 * facing), ((-0.3, 0.3, 0.8), (0, 3.0, 0), (2.0, 0, 0)),
               ((-1.5, 0.3, 0.4), (0.5, 3.0, 0), (0.2, 0, 2.0))]
    for window in windows:  # seen from points of a floor
        centre, u, v = (x * random.normal(1, 0.15, (WINDOW_PANES, 1)) for x in np.array(window))
        panes.append((centre - random.uniform([-2, -0.8, 0], [2, 0.8, 0], (WINDOW_PANES, 3)), u, v))
    centre, u, v = (np.concatenate(x) for x in zip(*panes, strict=True))
    v *= np.sign((np.cross(u, v) * centre).sum(1, keepdims=True))  # counterclockwise
    corners = np.stack([centre + x * u / 2 + y * v / 2 for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], 1)
    counts = [PANES] * len(PANE_WIDTHS) + [2 * WINDOW_PANES, 3 * WINDOW_PANES]
    return corners, np.repeat(np.arange(len(CLASS_WEIGHTS)), counts)


def clip_to_horizon(corners: F64) -> tuple[F64, NDArray[np.bool_]]:
    """Unit vectors to the corners of the parts above the horizon, shape (N, 5, 3), some twice; which panes have any."""
    after = np.roll(corners, -1, 1)
    height, height_after = corners[..., 2], after[..., 2]
    is_above, crosses = height > 0, (height > 0) != (height_after > 0)
    share = np.divide(height, height - height_after, out=np.zeros_like(height), where=crosses)
    points = np.stack([corners, corners + share[..., None] * (after - corners)], 2).reshape(-1, 8, 3)
    is_kept = np.stack([is_above, crosses], 2).reshape(-1, 8)
    order = np.argsort(~is_kept, axis=1, kind="stable")[:, :5]
    order = np.where(np.take_along_axis(is_kept, order, 1), order, order[:, :1])
    found = np.take_along_axis(points, order[..., None], 1)
    return found / np.linalg.norm(found, axis=-1, keepdims=True), is_kept.sum(1) > 0


def integrate_cosine(corners: F64, a: F64, b: F64, c: F64) -> tuple[F64, F64]:
    """Integrals over panes of a transformed cosine whose weight is the x axis, or the z axis; shape (V, N) each.

    ``corners`` are in the lobes' frames, shape (V, N, 5, 3), counterclockwise; a, b and c are those of V matrices.
    """
    a, b, c = (t[:, None, None] for t in (a, b, c))
    x, y, z = a * corners[..., 0] + b * corners[..., 2], c * corners[..., 1], corners[..., 2]
    x1, y1, z1 = (np.concatenate([t[..., 1:], t[..., :1]], -1) for t in (x, y, z))
    across = y * z1 - z * y1, z * x1 - x * z1, x * y1 - y * x1
    sine = np.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
    share = 0.5 * np.arctan2(sine, x * x1 + y * y1 + z * z1) / np.maximum(sine, 1e-200)
    return (share * across[0]).sum(-1), (share * across[2]).sum(-1)


def measure_lobe(view: View, parameters: F64) -> tuple[float, float]:
    """Directional albedo of GGX over that of the approximation, and the mean of Schlick's (1 - v·h)⁵ over the lobe."""
    light, power = sample_lobe(view)
    half = light + view.view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    matrices, weights = evaluate_cosines(view, parameters)
    x, z = integrate_cosine(HORIZON @ view.frame.T, *(matrices[:, i, j] for i, j in ((0, 0), (0, 2), (1, 1))))
    albedo = weights[:, 0] @ x[:, 0] + weights[:, 2] @ z[:, 0]
    return float(power.sum() / albedo), float(power @ (1 - half @ view.view) ** 5 / power.sum())


class Refinement:
    """Errors over rectangles of a whole region of the table, and the parameters in it that make them least.

    What is interpolated, and refined, are a, b, c, w_x and w_z: shape (cells of the table, 15).

    Parameters
    ----------
    cells : list of (row, column)
        Whose parameters may change.
    """

    def __init__(self, cells: list[Cell]) -> None:
        self._cells = np.array([i * ANGLES + j for i, j in cells])
        steps = (-0.5, 0.0, 0.5)
        points = sorted({(i + di, j + dj) for i, j in cells for di in steps for dj in steps
                         if 0 <= i + di < ROUGHNESSES - 0.5 and 0 <= j + dj < ANGLES - 0.5})
        self._at = sparse.csr_array(np.array([_bilinear(point) for point in points]))
        views = [view_of(point) for point in points]
        self._slopes = np.array([view.slopes for view in views])
        parts = [self._panes(view, int(2 * i), int(2 * j)) for view, (i, j) in zip(views, points, strict=True)]
        most = max(len(part[0]) for part in parts)
        self._corners = np.zeros((len(views), most, 5, 3))
        self._exact, self._shares, self._weights = np.zeros((3, len(views), most))
        self._corners[..., 2] = 1  # panes of no size fill up
        for k, (corners, exact, shares, weights) in enumerate(parts):
            used = slice(len(exact))
            self._corners[k, used], self._exact[k, used] = corners, exact
            self._shares[k, used], self._weights[k, used] = shares, weights
        spread = self._at[:, self._cells]
        self._spread = sparse.kron(spread, sparse.eye_array(5 * LOBES), "csr")
        grid = np.eye(ROUGHNESSES * ANGLES).reshape(ROUGHNESSES, ANGLES, -1)
        roughening = sparse.csr_array(np.eye(ROUGHNESSES * ANGLES)[self._cells]
                                      - [mean_of_neighbours(grid, cell) for cell in cells])
        self._roughening = roughening * REFINED_SMOOTHNESS

    @staticmethod
    def _panes(view: View, *seed: int) -> tuple[F64, F64, F64, F64]:
        """Corners, exact integrals, the inverse of the largest of each class, and weights."""
        corners, classes = sample_panes(view, np.random.default_rng(seed))
        clipped, is_lit = clip_to_horizon(corners)
        light, weight = sample_lobe(view)
        light = light.T.astype(np.float32)
        normals = np.cross(corners, np.roll(corners, -1, 1))[is_lit].astype(np.float32)
        inside = np.ones((len(normals), light.shape[1]), bool)
        for k in range(4):
            inside &= normals[:, k] @ light >= 0
        exact, classes = inside @ weight, classes[is_lit]
        largest = np.array([exact[classes == k].max(initial=0) for k in range(len(CLASS_WEIGHTS))])
        count = np.bincount(classes, minlength=len(CLASS_WEIGHTS))
        albedo = weight.sum()
        corners = np.concatenate([clipped[is_lit], HORIZON[None]]) @ view.frame.T
        weights = np.append(CLASS_WEIGHTS[classes] / np.sqrt(count[classes]), REFINED_ALBEDO_WEIGHT)
        return corners, np.append(exact, albedo), 1 / np.append(largest[classes], albedo), weights

    def errors(self, parameters: F64) -> F64:
        """Of all integrals, as shares of the largest of their class at that point; shape (V, N)."""
        return (self._integrate(self._at @ parameters) - self._exact) * self._shares

    def refine(self, parameters: F64) -> F64:
        """Parameters of all cells, shape (cells, 15), by Levenberg's and Marquardt's steps from those given."""
        damping, cost = 0.01, self._cost(parameters)
        rough = self._roughening[:, self._cells]
        for _ in range(MAX_REFINING_STEPS):
            errors = self.errors(parameters) / REFINED_ERROR
            slopes = self._error_slopes(self._at @ parameters) / REFINED_ERROR
            emphasis = np.sqrt(1 + errors**2)
            slopes *= (self._weights * (2 * emphasis - 1 / emphasis))[..., None]
            down = -np.einsum("vpi,vp->vi", slopes, self._weights * errors * emphasis).ravel()
            squares = np.einsum("vpi,vpj->vij", slopes, slopes, optimize=True)
            blocks = sparse.bsr_array((squares, np.arange(len(squares)), np.arange(len(squares) + 1)))
            curvature = self._spread.T @ blocks @ self._spread + sparse.kron(rough.T @ rough,
                                                                             sparse.diags_array(REFINED_SCALES**-2))
            down = self._spread.T @ down - (rough.T @ (self._roughening @ parameters) / REFINED_SCALES**2).ravel()
            diagonal = curvature.diagonal()
            while True:
                damped = curvature + sparse.diags_array(damping * (diagonal + 0.02 * np.median(diagonal) + 1))
                change = splu(damped.tocsc()).solve(down).reshape(-1, 5 * LOBES)
                changed = parameters.copy()
                changed[self._cells] += np.clip(change, *self._limits(parameters[self._cells]))
                changed_cost = self._cost(changed)
                if changed_cost < cost:
                    break
                damping *= 4
                if damping > 1e6:
                    return parameters
            gain = cost - changed_cost
            parameters, cost, damping = changed, changed_cost, max(damping / 3, 1e-6)
            if gain < MIN_GAIN * cost:
                break
        return parameters

    def _cost(self, parameters: F64) -> float:
        errors = self.errors(parameters) / REFINED_ERROR
        rough = self._roughening @ parameters / REFINED_SCALES
        return float((self._weights**2 * errors**2 * (1 + errors**2)).sum() + (rough**2).sum())

    @staticmethod
    def _limits(parameters: F64) -> tuple[F64, F64]:
        """Least and largest step: a and c stay positive."""
        most = np.broadcast_to(np.tile([0, 0.15, 0, 0.1, 0.1], LOBES), parameters.shape).copy()
        for k in (0, 2):
            most[:, k::5] = 0.3 * parameters[:, k::5]
        return -most, most

    def _integrate(self, parameters: F64) -> F64:
        """Of all lobes over all panes, shape (V, N), for parameters at all points, shape (V, 15)."""
        lobes = np.split(parameters, LOBES, axis=1)
        return np.sum([_weigh(lobe, *self._integrate_lobe(lobe)) for lobe in lobes], axis=0)

    def _integrate_lobe(self, lobe: F64) -> tuple[F64, F64]:
        return integrate_cosine(self._corners, lobe[:, 0] * self._slopes[:, 0], lobe[:, 1],
                                lobe[:, 2] * self._slopes[:, 1])

    def _error_slopes(self, parameters: F64) -> F64:
        """Derivatives of the errors by the parameters at each point, shape (V, N, 15)."""
        columns = []
        for lobe in np.split(parameters, LOBES, axis=1):
            x, z = self._integrate_lobe(lobe)
            for k in range(3):
                near = lobe.copy()
                near[:, k] += DIFFERENCE
                columns.append((_weigh(lobe, *self._integrate_lobe(near)) - _weigh(lobe, x, z)) / DIFFERENCE)
            columns += [x, z]
        return np.stack(columns, -1) * self._shares[..., None]


def _weigh(lobe: F64, x: F64, z: F64) -> F64:
    return lobe[:, 3, None] * x + lobe[:, 4, None] * z


def _bilinear(point: tuple[float, float]) -> F64:
    """Shares of all cells in what is interpolated at a point, shape (cells,)."""
    weights = np.zeros((ROUGHNESSES, ANGLES))
    i, j = (int(x) for x in point)
    for di, dj in ((0, 0), (0, 1), (1, 0), (1, 1)):
        share = abs(1 - di - (point[0] - i)) * abs(1 - dj - (point[1] - j))
        if share:
            weights[i + di, j + dj] = share
    return weights.ravel()


def order_lobes(table: F64) -> None:
    """Let lobes change places, so that each is like that of the column before, with which it is interpolated."""
    for i, j in np.ndindex(ROUGHNESSES, ANGLES):
        if j > SMOOTH_COLUMN:
            lobes, before = table[i, j].reshape(LOBES, 5), table[i, j - 1].reshape(LOBES, 5)
            orders = [list(order) for order in itertools.permutations(range(LOBES))]
            distances = [np.abs(lobes[order] - before).sum() for order in orders]
            best = int(np.argmin(distances))
            if distances[best] < distances[0] - MIN_SWAP_GAIN:
                table[i, j] = lobes[orders[best]].ravel()


def refine_table(table: F64) -> F64:
    """The table with its refined cells."""
    table = table.copy()
    order_lobes(table)
    cells = [(i, j) for i in range(ROUGHNESSES)
             for j in range(ROUGH_COLUMN if i >= REFINED_ROW else SMOOTH_COLUMN, ANGLES)]
    refined = Refinement(cells).refine(without_logarithms(table)).reshape(table.shape)
    for cell in cells:
        table[cell] = np.where(LOGARITHMIC, np.log(np.maximum(refined[cell], 1e-9)), refined[cell])
    return table


def without_logarithms(table: F64) -> F64:
    """Parameters as they are interpolated, shape (cells, 15)."""
    return np.where(LOGARITHMIC, np.exp(table), table).reshape(-1, 5 * LOBES)


def pack(table: F64) -> NDArray[np.float16]:
    """Texels of ``shaders/include/ltc.glsl``, of the exact albedo; shape (ROUGHNESSES, ANGLES, 4, 4)."""
    texels = np.zeros((ROUGHNESSES, ANGLES, LOBES + 1, 4))
    for cell in np.ndindex(ROUGHNESSES, ANGLES):
        scale, fresnel = measure_lobe(view_of(cell), table[cell])
        for lobe, (log_a, b, log_c, w_x, w_z) in enumerate(table[cell].reshape(LOBES, 5)):
            texels[cell][lobe] = math.exp(log_a), b, math.exp(log_c), w_x * scale
            texels[cell][LOBES, lobe] = w_z * scale
        texels[cell][LOBES, LOBES] = fresnel
    return texels.astype(np.float16)


def unpack(texels: NDArray[np.float16]) -> F64:
    """Parameters of all cells, shape (ROUGHNESSES, ANGLES, 15); the inverse of ``pack``."""
    lobes = [np.stack([np.log(a), b, np.log(c), w_x, w_z], -1)
             for (a, b, c, w_x), w_z in ((np.moveaxis(texels[..., lobe, :].astype(np.float64), -1, 0),
                                          texels[..., LOBES, lobe].astype(np.float64)) for lobe in range(LOBES))]
    return np.concatenate(lobes, -1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=data_dir() / "ltc.npy", help="the table's file")
    parser.add_argument("--workers", type=int, default=2, help="processes; they do not change the result")
    parser.add_argument("--refine", action="store_true", help="begin with the table that is there")
    arguments = parser.parse_args()
    table = unpack(np.load(data_dir() / "ltc.npy")) if arguments.refine else fit_table(arguments.workers)
    table = refine_table(table)
    with replace_file(arguments.out) as temporary, temporary.open("wb") as file:
        np.save(file, pack(table))


if __name__ == "__main__":
    main()
