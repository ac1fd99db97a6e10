"""Where the shadow map of each light lies in the atlas, and how large it is."""

from dataclasses import dataclass, replace

from app.scene import DirectionalLight, Light, RectLight, SpotLight

SINGLE_MAP, CUBE_MAP, PARALLEL_MAP = 1, 2, 3
MAX_SINGLE_MAP_DEG = 55.0  # outer half angle of a spot that one map covers
FACE_TEXELS = {CUBE_MAP: 1024, SINGLE_MAP: 2048, PARALLEL_MAP: 4096}  # a side
HARD_CUBE_TEXELS = 1536  # a hard shadow's filter is no wider than a texel
KEPT_HALVINGS = 2  # of all other maps, before those of directional lights are halved too
MAX_ATLAS_TEXELS = 2**25
MAX_ATLAS_WIDTH = 8192


@dataclass(frozen=True)
class Tile:
    """Where a light's map lies: lower left corner and face size in texels, and its kind."""

    corner: tuple[int, int]
    face: int
    kind: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in texels: six faces are 3×2."""
        return (3 * self.face, 2 * self.face) if self.kind == CUBE_MAP else (self.face, self.face)


def lay_out(lights: tuple[Light, ...], max_size: int) -> tuple[list[Tile], tuple[int, int]]:
    """Shelves of tiles: finer ones for hard six-face maps if the atlas fits then, and coarser ones until it does.

    Maps of directional lights are halved last, because they cover the whole scene.

    Returns
    -------
    tiles : list of Tile
        One for each light.
    size : tuple of int
        Width and height of the atlas, in texels.
    """
    usual = FACE_TEXELS[CUBE_MAP]
    for hard, shrink in ((HARD_CUBE_TEXELS, 0), *((usual, shrink) for shrink in range(9 + KEPT_HALVINGS))):
        tiles, size = _shelves([_tile(light, hard, shrink) for light in lights], min(max_size, MAX_ATLAS_WIDTH))
        if size[0] * size[1] <= MAX_ATLAS_TEXELS and max(size) <= max_size:
            break
    return tiles, size


def _tile(light: Light, hard: int, shrink: int) -> Tile:
    kind = map_kind(light)
    if kind == PARALLEL_MAP:
        return Tile((0, 0), FACE_TEXELS[kind] >> max(0, shrink - KEPT_HALVINGS), kind)
    return Tile((0, 0), (hard if kind == CUBE_MAP and size_of(light) <= 0 else FACE_TEXELS[kind]) >> shrink, kind)


def _shelves(tiles: list[Tile], limit: int) -> tuple[list[Tile], tuple[int, int]]:
    """Place tiles, the highest first, on shelves, and on top of each other where a shelf is high enough."""
    placed = list(tiles)
    shelf = height = left = right = top = width = 0  # y of the shelf, its height; the column's sides; where it is free
    for index in sorted(range(len(tiles)), key=lambda k: -tiles[k].size[1]):
        w, h = tiles[index].size
        if top + h > shelf + height or left + w > right:  # not on top of the column
            left, top = right, shelf
            right += w
            if right > limit:
                shelf, left, right = shelf + height, 0, w
                top = shelf
            height = height if left else h
        placed[index] = replace(tiles[index], corner=(left, top))
        top += h
        width = max(width, right)
    return placed, (max(1, width), max(1, shelf + height))


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
