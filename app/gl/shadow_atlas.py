"""Where the shadow map of each light lies in the atlas, and how large it is."""

from dataclasses import dataclass, replace

from app.scene import DirectionalLight, Light, RectLight, SpotLight

SINGLE_MAP, CUBE_MAP, PARALLEL_MAP = 1, 2, 3
MAX_SINGLE_MAP_DEG = 55.0  # outer half angle of a spot that one map covers
FACE_TEXELS = {CUBE_MAP: 1024, SINGLE_MAP: 2048, PARALLEL_MAP: 4096}  # a side
HARD_CUBE_TEXELS = 1536  # a hard shadow's filter is no wider than a texel
CASCADE_TEXELS = 2048  # a side; drawing one takes a quarter of the time of the whole map
MIN_CASCADE_TEXELS = 256  # below which there is none
EARLIER_HALVINGS = 2  # of the maps of all other lights, before those of directional ones
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


def lay_out(lights: tuple[Light, ...], max_size: int,
            has_cascades: bool = False) -> tuple[list[Tile], list[Tile | None], tuple[int, int]]:
    """Shelves of tiles: finer ones for hard six-face maps if the atlas fits then, and coarser ones until it does.

    Before the maps of directional lights are halved, because they cover the whole scene, all others are halved up to
    ``EARLIER_HALVINGS`` times.

    Parameters
    ----------
    has_cascades : bool
        Whether directional lights have a second map. These lie above all others, which they don't change.

    Returns
    -------
    tiles : list of Tile
        One for each light.
    cascades : list of Tile or None
        None for lights without a cascade.
    size : tuple of int
        Width and height of the atlas, in texels.
    """
    usual = FACE_TEXELS[CUBE_MAP]
    halvings = ((parallel, parallel + more) for parallel in range(9) for more in range(EARLIER_HALVINGS + 1))
    for hard, parallel, other in ((HARD_CUBE_TEXELS, 0, 0), *((usual, *both) for both in halvings)):
        tiles = [_tile(light, hard, parallel, other) for light in lights]
        tiles, size = _shelves(tiles, min(max_size, MAX_ATLAS_WIDTH))
        if size[0] * size[1] <= MAX_ATLAS_TEXELS and max(size) <= max_size:
            break
    cascades: list[Tile | None] = [None] * len(lights)
    directional = [k for k, light in enumerate(lights) if has_cascades and map_kind(light) == PARALLEL_MAP]
    face = CASCADE_TEXELS
    while directional and (size[1] + face > max_size or len(directional) * face > max_size):
        face //= 2
    if directional and face >= MIN_CASCADE_TEXELS:
        for column, light in enumerate(directional):
            cascades[light] = Tile((column * face, size[1]), face, PARALLEL_MAP)
        size = max(size[0], len(directional) * face), size[1] + face
    return tiles, cascades, size


def _tile(light: Light, hard: int, parallel: int, other: int) -> Tile:
    """Not placed yet, with its side halved so many times."""
    kind = map_kind(light)
    face = hard if kind == CUBE_MAP and size_of(light) <= 0 else FACE_TEXELS[kind]
    return Tile((0, 0), face >> (parallel if kind == PARALLEL_MAP else other), kind)


def _shelves(tiles: list[Tile], limit: int) -> tuple[list[Tile], tuple[int, int]]:
    """Place tiles, the highest first, on shelves, and on top of each other where a shelf is high enough."""
    placed = list(tiles)
    shelf = height = 0  # lower edge of the shelf, and its height
    left = right = top = 0  # sides of the column of tiles on it, and its upper edge
    width = 1
    for index in sorted(range(len(tiles)), key=lambda k: -tiles[k].size[1]):
        w, h = tiles[index].size
        if top + h > shelf + height or left + w > right:  # not on top of the column
            left, top = right, shelf
            right += w
            if right > limit:
                shelf, left, right = shelf + height, 0, w
                top = shelf
            if left == 0:
                height = h
        placed[index] = replace(tiles[index], corner=(left, top))
        top += h
        width = max(width, right)
    return placed, (width, max(1, shelf + height))


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
