"""Where the shadow map of each light lies in the atlas, and how large it is."""

from dataclasses import dataclass

from app.scene import DirectionalLight, Light, RectLight, SpotLight

SINGLE_MAP, CUBE_MAP, PARALLEL_MAP = 1, 2, 3
MAX_SINGLE_MAP_DEG = 55.0  # outer half angle of a spot that one map covers
FACE_TEXELS = {CUBE_MAP: 1024, SINGLE_MAP: 2048, PARALLEL_MAP: 4096}  # a side
HARD_CUBE_TEXELS = 1536  # a hard shadow's filter is no wider than a texel
MAX_ATLAS_TEXELS = 2**25
MAX_ATLAS_WIDTH = 8192


@dataclass(frozen=True)
class Tile:
    """Where a light's map lies: lower left corner and face size in texels, and its kind."""

    corner: tuple[int, int]
    face: int
    kind: int


def lay_out(lights: tuple[Light, ...], max_size: int) -> tuple[list[Tile], tuple[int, int]]:
    """Shelves of tiles: finer ones for hard six-face maps if the atlas fits then, and all halved until it does.

    Returns
    -------
    tiles : list of Tile
        One for each light.
    size : tuple of int
        Width and height of the atlas, in texels.
    """
    usual = FACE_TEXELS[CUBE_MAP]
    for hard, shrink in ((HARD_CUBE_TEXELS, 0), *((usual, shrink) for shrink in range(9))):
        tiles, size = _shelves(lights, hard, shrink, max_size)
        if size[0] * size[1] <= MAX_ATLAS_TEXELS and max(size) <= max_size:
            break
    return tiles, size


def _shelves(lights: tuple[Light, ...], hard: int, shrink: int, max_size: int) -> tuple[list[Tile], tuple[int, int]]:
    limit = min(max_size, MAX_ATLAS_WIDTH)
    tiles, x, y, shelf, width = [], 0, 0, 0, 1
    for light in lights:
        kind = map_kind(light)
        face = (hard if kind == CUBE_MAP and size_of(light) <= 0 else FACE_TEXELS[kind]) >> shrink
        w, h = (3 * face, 2 * face) if kind == CUBE_MAP else (face, face)
        if x + w > limit:
            x, y, shelf = 0, y + shelf, 0
        tiles.append(Tile((x, y), face, kind))
        x, shelf = x + w, max(shelf, h)
        width = max(width, x)
    return tiles, (width, max(1, y + shelf))


def map_kind(light: Light) -> int:
    if isinstance(light, DirectionalLight):
        return PARALLEL_MAP
    if isinstance(light, SpotLight) and light.outer_deg <= MAX_SINGLE_MAP_DEG:
        return SINGLE_MAP
    return CUBE_MAP


def size_of(light: Light) -> float:
    if isinstance(light, DirectionalLight):
        return light.angular_radius_deg
    return 1.0 if isinstance(light, RectLight) else light.radius
