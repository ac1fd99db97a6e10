"""Indirect light without training: surfels seen from the camera light every pixel, by form factors alone.

``gather`` takes one bounce from them; ``radiosity`` first lets them light each other. Geometry stays
float32 throughout: d² = |p|² + |q|² − 2 p·q cancels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor
from torch.nn import functional

from app.network.channels import CUBE, GLOBALS
from app.network.contract import ModelContract, TensorSpec
from export.models.finite import finite
from export.models.geometric_tail import rest
from export.models.network import Network

FACE, FACE_CELL = 48, 8  # texels along the edge of a cube face, and of a cell on it
SCREEN_ROWS, SCREEN_COLUMNS, SCREEN_CELL = 48, 64, 4  # texels taken from the screen grid, whatever its size
CANDIDATES = 3  # along the edge of a cell: texels that are tried as the middle of its largest surface
SURFELS = 512  # at most, unless told otherwise
BLOCK = 256  # surfels per block, so that a block's matrices stay in the cache
BOUNCES = 8
LONGEST = 0.95  # largest ratio of one bounce to the one before
LIFT = 0.5  # in widths of a texel, towards the camera
GRAZING = 0.05  # smallest cosine: beyond it a texel's area says nothing
FLATNESS = 0.15  # a texel lies on a surface within this fraction of the cell's width ...
PARALLEL = 0.8  # ... if their normals have this cosine


def _contract(name: str, kind: str, channels: tuple[str, ...], **more: TensorSpec) -> ModelContract:
    return ModelContract(
        name=name, paper="geometry-term gather and radiosity over surfels, without training",
        inputs={"screen": TensorSpec(channels), "cube": TensorSpec((*channels, "on_screen"), CUBE, FACE), **more},
        outputs={"indirect": TensorSpec(("indirect.rgb",))},
        scale=1 / 16, exposure="mean-radiance", bounces=kind, scene_extent=40.0, cube_axes="world",
        trained_on="nothing", licence="MIT")


@dataclass(frozen=True)
class Surfels:
    """Disks that send light.

    Attributes
    ----------
    position, normal, radiance, albedo : Tensor, float32, shape (S, 3)
    area : Tensor, float32, shape (S, 1)
    share : Tensor, float32, shape (S, 1)
        Of the cell that the surfel was taken from; 0 for none at all.
    """

    position: Tensor
    normal: Tensor
    radiance: Tensor
    albedo: Tensor
    area: Tensor
    share: Tensor

    def rows(self, which: Tensor | slice) -> Surfels:
        """Some of them."""
        return Surfels(*(getattr(self, f.name)[which] for f in fields(self)))


class FromSurfels(Network):
    """Each pixel sums radiance × form factor over all surfels, without visibility.

    The surfels come from the screen and from those parts of the cube that the screen does not show.

    Parameters
    ----------
    surfels : int
        How many are kept, at most 816.

    Attributes
    ----------
    contract : ModelContract
        What it reads and writes; the exported file carries it.
    """

    def __init__(self, surfels: int = SURFELS) -> None:
        super().__init__()
        self.surfels = surfels

    def lit(self, screen: Tensor, cube: Tensor, outgoing: Callable[[Surfels], Tensor]) -> Tensor:
        """Light the points on the screen.

        Parameters
        ----------
        screen : Tensor, float32, shape (1, C, h, w)
            The points to be lit; they send light too. View space, scaled to ``contract.scene_extent``.
        cube : Tensor, float32, shape (1, C + 1, 6, FACE, FACE)
        outgoing : callable
            Radiance [S, 3] that surfels send.

        Returns
        -------
        Tensor, float32, shape (1, 3, h, w)
            Indirect radiance / albedo; 0 in the sky. Never more than the largest radiance of a surfel.
        """
        screen = finite(screen, self.contract.inputs["screen"])
        cube = finite(cube, self.contract.inputs["cube"])
        q = self._named(screen[0].flatten(1))
        # A texel is lit a little in front of its surface, or the gaps between disks would show along edges.
        position, normal = (q["position"] * (1 - LIFT * q["solid_angle"].sqrt())).t(), q["normal"].t()
        surfels = _largest([self._surfels(self._screen_texels(screen), SCREEN_CELL),
                            self._surfels(self._cube_texels(cube[0]), FACE_CELL)], self.surfels)
        # Around the middle of the surfels, so that products of coordinates stay small.
        origin = (surfels.position * surfels.area).sum(0) / surfels.area.sum().clamp(min=1e-12)
        surfels = replace(surfels, position=surfels.position - origin)
        light = _receive(position - origin, normal, surfels, outgoing(surfels))
        light = light.t() * (q["solid_angle"] > 0)
        return light.reshape(1, 3, screen.shape[2], screen.shape[3])

    def _screen_texels(self, screen: Tensor) -> Tensor:
        """Image [C, H, W] of picked texels, which get the solid angle of all."""
        texels = functional.interpolate(screen, (SCREEN_ROWS, SCREEN_COLUMNS), mode="nearest")[0]
        omega = self._named(texels)["solid_angle"]
        kept = self._named(screen[0])["solid_angle"].sum() / omega.sum().clamp(min=1e-12)
        return torch.cat([texels[:-1], omega * kept])

    def _cube_texels(self, cube: Tensor) -> Tensor:
        """Image [C, H, W] of the faces above each other, without what the screen shows already."""
        texels = cube.flatten(1, 2)
        return torch.cat([texels[:-2], texels[-2:-1] * (1 - texels[-1:])])

    def _named(self, texels: Tensor) -> dict[str, Tensor]:
        """Tensor channels along the first axis by quantity: position, normal, radiance, solid_angle …"""
        return {name.split(".")[0]: texels[at] for name, at in self.contract.inputs["screen"].rows()}

    def _surfels(self, texels: Tensor, cell: int) -> Surfels:
        """Two surfels from each square cell of an image [C, H, W]: one for each of its two largest surfaces.

        Geometry and radiance are means over the texels of one surface alone; its area, r² Ω / cos θ summed, is
        extended so that a cell's surfels fill the cell's whole solid angle.
        """
        cells = _cells(texels, cell)
        t = self._named(cells.transpose(0, 1))
        p, n, omega = (t[key].transpose(0, 1) for key in ("position", "normal", "solid_angle"))
        r2 = (p * p).sum(1, keepdim=True)
        plane = (n * p).sum(1, keepdim=True)
        whole = omega.sum(2, keepdim=True)
        width = (r2 * whole).sqrt()
        tried = _tried(cell)
        to = n[:, :, tried].transpose(1, 2)
        off = (to @ p - plane[:, :, tried].transpose(1, 2)).abs()
        same = ((off <= FLATNESS * width[:, :, tried].transpose(1, 2)) & (to @ n > PARALLEL)).to(p.dtype)
        first = _fullest(same, omega) * omega
        rest = omega - first
        second = _fullest(same, rest) * rest
        filled = whole / (first + second).sum(2, keepdim=True).clamp(min=1e-12)
        seen = torch.cat([first, second], 1) * filled
        cosine = (-plane * r2.clamp(min=1e-12).rsqrt()).clamp(min=GRAZING)
        area = seen * (r2 / cosine)
        total = area.sum(2, keepdim=True)
        mean = ((area @ cells.transpose(1, 2)) / total.clamp(min=1e-12)).flatten(0, 1)
        s = {key: value.t() for key, value in self._named(mean.t()).items()}
        # Whichever surfaces were taken, the cell sends what all its texels send, but nowhere more than the brightest.
        texel = t["radiance"].transpose(0, 1)
        sent = texel @ (omega * (r2 / cosine)).transpose(1, 2)
        surfel = s["radiance"].reshape(-1, 2, 3).transpose(1, 2)
        surfel = torch.minimum(surfel * (sent / (surfel @ total).clamp(min=1e-12)), texel.amax(2, keepdim=True))
        s["radiance"] = surfel.transpose(1, 2).flatten(0, 1)
        # A disk wider than its distance is no longer a small piece of surface.
        area = torch.minimum(total.flatten(0, 1), math.pi * (s["position"] * s["position"]).sum(1, keepdim=True))
        share = (seen.sum(2, keepdim=True) / whole.clamp(min=1e-12)).flatten(0, 1)
        albedo = s.get("albedo", torch.zeros_like(s["radiance"]))  # one bounce needs none
        return Surfels(s["position"], functional.normalize(s["normal"], dim=1), s["radiance"], albedo, area, share)


class Gather(FromSurfels):
    """One bounce: the surfels send what they send by direct light."""

    contract = _contract("gather", "single", ("position.view.xyz", "normal.view.xyz", "radiance.rgb", "solid_angle"))

    def forward(self, screen: Tensor, cube: Tensor) -> Tensor:
        """See ``lit``."""
        return self.lit(screen, cube, lambda surfels: self.outgoing(surfels))

    def outgoing(self, surfels: Surfels) -> Tensor:
        """Radiance [S, 3] that the surfels send."""
        return surfels.radiance


class Radiosity(FromSurfels):
    """As many bounces as it is told: the surfels light each other before the pixels gather.

    Eight bounces are followed; the rest is the tail of the geometric series that they have become by then.
    """

    contract = _contract("radiosity", "multi", ("position.view.xyz", "normal.view.xyz", "albedo.rgb", "radiance.rgb",
                                                "solid_angle"), bounces=TensorSpec(("bounces",), GLOBALS))

    def forward(self, screen: Tensor, cube: Tensor, bounces: Tensor) -> Tensor:
        """See ``lit``; ``bounces`` is of shape (1, 1)."""
        between = finite(bounces, self.contract.inputs["bounces"]) - 1  # the last one reaches the pixels
        return self.lit(screen, cube, lambda surfels: self.outgoing(surfels, between))

    def outgoing(self, surfels: Surfels, between: Tensor) -> Tensor:
        """Radiance [S, 3] that the surfels send after so many bounces between them."""
        factors = _form_factors(surfels.position, surfels.normal, surfels)
        # Energy can't grow: no surfel receives more than all directions hold, nor all together more than was sent.
        factors = factors / factors.sum(1, keepdim=True).clamp(min=1)
        light = bounce = surfels.radiance
        for number in range(BOUNCES):
            sent = _flux(surfels, bounce)
            received = factors @ bounce
            bounce = surfels.albedo * received * (sent / _flux(surfels, received)).clamp(max=1)
            light = light + bounce * (between > number).to(bounce)
            ratio = _flux(surfels, bounce) / sent
        return light + rest(bounce, ratio.clamp(max=LONGEST), between - BOUNCES)


def _flux(surfels: Surfels, light: Tensor) -> Tensor:
    """Area × radiance, summed over the surfels, never 0; shape (3,)."""
    return (surfels.area * light).sum(0).clamp(min=1e-12)


def _receive(p: Tensor, n: Tensor, surfels: Surfels, light: Tensor) -> Tensor:
    """Radiance / albedo [Q, 3] at points ``p`` with normals ``n``; their form factors sum to 1 at most."""
    light = torch.cat([light, torch.ones_like(light[:, :1])], 1)
    sums = torch.zeros_like(p[:, :1])
    for at in range(0, len(surfels.area), BLOCK):
        rows = slice(at, at + BLOCK)
        sums = sums + _form_factors(p, n, surfels.rows(rows)) @ light[rows]
    return sums[:, :3] / sums[:, 3:].clamp(min=1)


def _form_factors(p: Tensor, n: Tensor, surfels: Surfels) -> Tensor:
    """Form factors [Q, S] from points to surfels taken as disks, unoccluded.

    The exact factor of a disk that lies wholly above the receiver's horizon. With R its radius, d the distance,
    a = n·(q − p) and h = m·(p − q) the heights of each above the other's plane, c = n·m, and
    S² = (d² + R²)² − 4 R² (d² − h²), the factors of a parallel and of a perpendicular element (Howell, A Catalog
    of Radiation Heat Transfer Configuration Factors, element to disk) are the components of a vector, which give

        F = R² h (2 a − 4 c h R² / (S + d² − R²)) / (S (S + d² + R²)).

    Far away it is a h A / (π d⁴), the geometry term; nearby it is bounded, where the geometry term is not.
    """
    q, m, r2 = surfels.position, surfels.normal, surfels.area.t() / math.pi
    r = r2.sqrt()
    # Each is one matrix product with an offset: r·a, 2·r·h and d² − r².
    ra = torch.addmm(-(n * p).sum(1, keepdim=True) * r, n, q.t() * r)
    hr = torch.relu(torch.addmm(-2 * (q * m).sum(1) * r, p, 2 * m.t() * r))
    e = torch.addmm((q * q).sum(1) - r2, torch.cat([p, (p * p).sum(1, keepdim=True)], 1),
                    torch.cat([-2 * q.t(), torch.ones_like(r)]))
    # Keeps the root apart from |e|: rounding grows with the coordinates and with the disk.
    apart = (1e-3 * r2 + 1e-5 * (q * q).sum(1) + 1e-4).square()
    root = torch.sqrt(e * e + (hr * hr + apart))
    near = root + e
    lateral = ra - (n @ (m.t() * r2)) * hr / near
    return (hr * lateral / (root * (near + 2 * r2))).clamp(0, 1)


def _fullest(same: Tensor, omega: Tensor) -> Tensor:
    """Texels [N, 1, T], 0 or 1, of that surface of each cell which fills the largest solid angle.

    ``same`` [N, K, T] says which texels lie on the surface through each of K tried ones.
    """
    rows = (same @ omega.transpose(1, 2)).argmax(1, keepdim=True)
    return same.gather(1, rows.expand(-1, 1, same.shape[2]))


def _largest(parts: list[Surfels], count: int) -> Surfels:
    """Those ``count`` that fill most of their cells, so that a cell's second surface goes first."""
    every = Surfels(*(torch.cat([getattr(part, f.name) for part in parts]) for f in fields(Surfels)))
    return every.rows(every.share[:, 0].topk(count).indices)


def _cells(texels: Tensor, cell: int) -> Tensor:
    """An image [C, H, W] as cells [N, C, cell²]."""
    c, h, w = texels.shape
    cells = texels.reshape(c, h // cell, cell, w // cell, cell).permute(1, 3, 0, 2, 4)
    return cells.reshape(-1, c, cell * cell)


def _tried(cell: int) -> list[int]:
    """Texels of a cell, evenly spread, that are tried as the middle of a surface."""
    at = [(2 * i + 1) * cell // (2 * CANDIDATES) for i in range(CANDIDATES)]
    return [row * cell + column for row in at for column in at]
