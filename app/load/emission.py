"""What surfaces emit: at their texture coordinates, and on the mean over triangles."""

from dataclasses import replace

import numpy as np

from app.arrays import F32, F64, Bools, Bytes, Ints
from app.load.geometry import face_vectors
from app.load.images import to_linear
from app.scene import Material, Mesh, Texture

OPAQUE = 255              # of alpha in 8 bits
MAX_SIDE = 512            # of the copies of textures that are read, in texels that are means
LEVELS = 9                # of their mipmaps
SAMPLES_PER_TEXEL = 8.0   # of a triangle, so that no bright spot is missed
MAX_SAMPLES = 2**20       # of all triangles; if there are more, they read a coarser level
CHUNK = 2**20             # samples at once, which bounds the memory
DARK = 0.01               # of the largest radiance of a mesh,
DARK_SHARE = 1e-3         # and of its power, below which the darkest triangles are black but for a texture's noise
MAX_COORDINATE = 1e9      # of texture coordinates
R2 = np.array([0.7548776662466927, 0.5698402909980532])  # Roberts 2018, "The Unreasonable Effectiveness of Quasirandom
                                                         # Sequences"


class SurfaceEmission:
    """Radiance that a material emits, of what it covers of its surface."""

    def __init__(self, material: Material) -> None:
        self._emission = np.array(material.emission, np.float64)
        maps = material.emission_map, _coverage(material)
        self._maps = [_pyramid(texture) for texture in maps if texture is not None]
        if material.alpha_cutoff is not None:
            self._emission *= material.albedo_map is not None or material.alpha >= material.alpha_cutoff
        elif material.is_blended:
            self._emission *= material.alpha

    @property
    def is_textured(self) -> bool:
        return bool(self._maps)

    def at(self, uvs: F64, level: int = 0) -> F64:
        """Radiance at N places, shape (N, 3), W/(sr m²).

        Parameters
        ----------
        uvs : ndarray, float64, shape (2, N, 2)
            Coordinates in both sets.
        level : int
            Of mipmaps, whose texels are 2**level times as wide.
        """
        radiance = np.tile(self._emission, (uvs.shape[1], 1))
        for pyramid in self._maps:
            texture = pyramid[min(level, len(pyramid) - 1)]
            radiance *= _interpolate(texture, uvs[texture.uv_set])
        return radiance

    def texels(self, uvs: F64) -> F64:
        """About how many texels T triangles show, shape (T,); ``uvs`` of their corners, shape (2, T, 3, 2)."""
        most = np.ones(uvs.shape[1])
        for texture, *_ in self._maps:
            size = np.array(texture.pixels.shape[1::-1])
            a, b, c = np.moveaxis(_transform(texture, uvs[texture.uv_set]) * size, 1, 0)
            (x, y), (z, w) = (b - a).T, (c - a).T
            longest = np.max([np.linalg.norm(edge, axis=1) for edge in (b - a, c - a, c - b)], axis=0)  # uvs on a line
            most = np.maximum(most, np.maximum(np.abs(x * w - y * z) / 2, longest))
        return most

    def mean(self, uvs: F64) -> F64:
        """Mean radiance of T triangles, shape (T, 3), whose corners have ``uvs`` in both sets, shape (2, T, 3, 2)."""
        out = np.tile(self._emission, (uvs.shape[1], 1))
        if not self._maps:
            return out
        texels, level = self.texels(uvs), 0
        while (wanted := np.maximum(SAMPLES_PER_TEXEL * texels / 4**level, 1.0)).sum() > MAX_SAMPLES and level < LEVELS:
            level += 1
        power = np.ceil(np.log2(np.minimum(wanted, MAX_SAMPLES))).astype(np.int64)
        for exponent in np.unique(power):
            shares = spread_over_triangle(2**int(exponent))
            rows = np.flatnonzero(power == exponent)
            for part in np.array_split(rows, -(-len(rows) * len(shares) // CHUNK)):
                places = np.einsum("sk,utkd->utsd", shares, uvs[:, part]).reshape(2, -1, 2)
                out[part] = self.at(places, level).reshape(len(part), len(shares), 3).mean(axis=1)
        return out


def triangle_radiance(mesh: Mesh, emission: SurfaceEmission) -> F64:
    """Mean emitted radiance of each triangle of a mesh, shape (T, 3), W/(sr m²); exactly 0 where it is next to none."""
    radiance = emission.mean(corner_uvs(mesh, np.arange(len(mesh.triangles))))
    area = np.linalg.norm(face_vectors(mesh.positions.astype(np.float64), mesh.triangles), axis=1)
    radiance[is_dark(radiance, area)] = 0
    return radiance


def is_dark(radiance: F64, area: F64) -> Bools:
    """Which of T parts, of some radiance, shape (T, 3), and area, shape (T,), give next to nothing of the power."""
    brightness = radiance.sum(axis=1)
    order = np.argsort(brightness, kind="stable")
    power = np.cumsum((brightness * area)[order])
    dark = np.empty(len(order), bool)
    dark[order] = power <= DARK_SHARE * power[-1:]
    return np.asarray(dark & (brightness <= DARK * brightness.max(initial=0)))


def corner_uvs(mesh: Mesh, rows: Ints) -> F64:
    """Texture coordinates at the corners of so many triangles, in both sets; shape (2, T, 3, 2)."""
    corners = mesh.triangles[rows]
    none = np.zeros((*corners.shape, 2))
    return np.stack([none if uvs is None else uvs[corners].astype(np.float64) for uvs in (mesh.uvs, mesh.second_uvs)])


def spread_over_triangle(count: int) -> F64:
    """Barycentric coordinates of points spread evenly over a triangle, shape (count, 3)."""
    if count == 1:
        return np.full((1, 3), 1 / 3)
    u, v = ((0.5 + R2 * np.arange(count)[:, None]) % 1.0).T
    root = np.sqrt(u)
    return np.stack([1 - root, root * (1 - v), root * v], axis=1)


def _coverage(material: Material) -> Texture | None:
    """How much a material with a texture covers of its surface, as a texture; None if that is the same everywhere."""
    texture = material.albedo_map
    if texture is None or not (material.is_blended or material.alpha_cutoff is not None):
        return None
    alpha = texture.pixels[..., 3:] / np.float32(OPAQUE if texture.pixels.dtype == np.uint8 else 1)
    if material.alpha_cutoff is not None:
        alpha = (alpha * material.alpha >= material.alpha_cutoff).astype(np.float32)
    is_whole = alpha.min() == alpha.max() == 1
    return None if is_whole else replace(texture, pixels=np.broadcast_to(alpha, texture.pixels.shape))


def _pyramid(texture: Texture) -> list[Texture]:
    """Mipmaps of a texture: copies whose texels are linear means of blocks, of ``MAX_SIDE`` texels a side at most."""
    height, width = (min(MAX_SIDE, size) for size in texture.pixels.shape[:2])
    levels = [_means(texture, height, width)]
    while max(height, width) > 1 and len(levels) <= LEVELS:
        height, width = max(height // 2, 1), max(width // 2, 1)
        levels.append(_means(replace(levels[-1], is_color=False), height, width))
    return levels


def _means(texture: Texture, height: int, width: int) -> Texture:
    """A smaller copy with linear pixels."""
    rows, columns = (np.linspace(0, size, count + 1).astype(int)
                     for size, count in zip(texture.pixels.shape, (height, width), strict=False))
    means = np.empty((height, width, 3), np.float32)
    for mean, first, end in zip(means, rows[:-1], rows[1:], strict=True):  # a few rows at once, which bounds the memory
        of_columns = _linear(texture.pixels[first:end, :, :3], texture.is_color).mean(axis=0)
        mean[:] = np.add.reduceat(of_columns, columns[:-1]) / np.diff(columns)[:, None]
    return replace(texture, pixels=means)


def _linear(color: Bytes | F32, is_color: bool) -> F64:
    if color.dtype != np.uint8:
        return np.asarray(np.nan_to_num(color.astype(np.float64)).clip(0, None))
    encoded = color.astype(np.uint8)
    return to_linear(encoded) if is_color else encoded / np.float64(OPAQUE)


@np.errstate(over="ignore", invalid="ignore")
def _transform(texture: Texture, uv: F64) -> F64:
    transformed = uv @ texture.transform[:2, :2].T + texture.transform[:2, 2]
    return np.asarray(np.nan_to_num(transformed).clip(-MAX_COORDINATE, MAX_COORDINATE))


def _interpolate(texture: Texture, uv: F64) -> F64:
    """A texture of linear pixels at coordinates of shape (N, 2), as shaders magnify it; shape (N, 3)."""
    height, width = texture.pixels.shape[:2]
    flat = texture.pixels.reshape(-1, 3)
    u, v = _transform(texture, uv).T
    at = np.stack([(1 - v) * height, u * width]) - (0.5 if texture.magnified == "linear" else 0.0)
    low = np.floor(at)
    share = at - low if texture.magnified == "linear" else np.zeros_like(at)

    def index(corner: F64, size: int, repeats: bool) -> Ints:
        return np.asarray((corner % size if repeats else corner.clip(0, size - 1)).astype(np.int64))

    rows, columns = ([index(low[axis] + step, size, repeats) for step in (0, 1)]
                     for axis, (size, repeats) in enumerate(((height, texture.repeat[1]), (width, texture.repeat[0]))))
    y, x = share[..., None]
    upper, lower = (flat[row * width + columns[0]] * (1 - x) + flat[row * width + columns[1]] * x for row in rows)
    return np.asarray(upper * (1 - y) + lower * y)
