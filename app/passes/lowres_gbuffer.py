"""Normal and depth on a low-resolution grid: one texel represents those around it; none are averaged."""

from app.gl.fullscreen import make_fullscreen, ratio_to
from app.graph import Pass, Resource, Tex

FACES = "lowres_faces"  # normals of the faces, which those of normal maps differ from


def declare(name: str, grid: tuple[int, int], has_faces: bool = False) -> Pass:
    """Over a low-resolution ``grid`` of width and height; pass and resource are called ``name``.

    With ``has_faces``, ``FACES`` too.
    """
    writes: dict[str, Resource] = {name: Tex("f4", 4, size=grid)}
    if has_faces:
        writes[FACES] = Tex("f4", 4, size=grid)
    return Pass(name, reads=("normal", "depth", *(("albedo",) if has_faces else ())), writes=writes,
                make=make_fullscreen("lowres_gbuffer.frag", lambda frame: {"ratio": ratio_to(grid, frame)}))
