"""Disks that stand for the surfaces of an image, and the form factors between them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import torch
from torch import Tensor
from torch.nn import functional

CANDIDATES = 3  # along the edge of a cell: texels that are tried as the centre of its largest surface
MIN_COSINE = 0.05  # between normal and view direction, for the area of a texel
MAX_PLANE_DISTANCE = 0.15  # in widths of the cell: a texel within it lies on a surface ...
MIN_NORMAL_COSINE = 0.8  # ... if their normals have at least this cosine


@dataclass(frozen=True)
class Disks:
    """Disks that emit light.

    Attributes
    ----------
    position, normal, radiance, albedo : Tensor, float32, shape (S, 3)
    area : Tensor, float32, shape (S, 1)
    share : Tensor, float32, shape (S, 1)
        Share of the cell that the disk stands for; 0 for unused disks.
    """

    position: Tensor
    normal: Tensor
    radiance: Tensor
    albedo: Tensor
    area: Tensor
    share: Tensor

    def select(self, which: Tensor | slice) -> Disks:
        """The disks with these indices."""
        return Disks(*(getattr(self, f.name)[which] for f in fields(self)))


def fit_disks(texels: Tensor, rows: Mapping[str, slice], cell: int) -> Disks:
    """Fit two disks to each square cell of an image, one for each of its two largest surfaces.

    Geometry and radiance are means over the texels of one surface. The areas, sums of r² Ω / cos θ, are scaled so that
    the two disks of a cell fill its whole solid angle.

    Parameters
    ----------
    texels : Tensor, shape (C, H, W)
    rows : mapping of str to slice
        Channels of position, normal, radiance, solid_angle and, if there is one, albedo.
    cell : int
        Texels along the edge of a cell.
    """
    cells = _split_cells(texels, cell)
    texel = split_channels(cells.transpose(0, 1), rows)
    p, n, omega = (texel[key].transpose(0, 1) for key in ("position", "normal", "solid_angle"))
    r2 = (p * p).sum(1, keepdim=True)
    plane = (n * p).sum(1, keepdim=True)
    whole = omega.sum(2, keepdim=True)
    width = (r2 * whole).sqrt()
    centers = _candidates(cell)
    center_normal = n[:, :, centers].transpose(1, 2)
    distance = (center_normal @ p - plane[:, :, centers].transpose(1, 2)).abs()
    same = ((distance <= MAX_PLANE_DISTANCE * width[:, :, centers].transpose(1, 2))
            & (center_normal @ n > MIN_NORMAL_COSINE)).to(p.dtype)
    first = _largest_surface(same, omega) * omega
    remaining = omega - first
    second = _largest_surface(same, remaining) * remaining
    filled = whole / (first + second).sum(2, keepdim=True).clamp(min=1e-12)
    visible = torch.cat([first, second], 1) * filled
    cosine = (-plane * r2.clamp(min=1e-12).rsqrt()).clamp(min=MIN_COSINE)
    area = visible * (r2 / cosine)
    total = area.sum(2, keepdim=True)
    mean = ((area @ cells.transpose(1, 2)) / total.clamp(min=1e-12)).flatten(0, 1)
    disk = {key: value.t() for key, value in split_channels(mean.t(), rows).items()}
    # The disks emit what all texels of the cell emit, whichever surfaces they represent, but none more than the
    # brightest texel.
    texel_radiance = texel["radiance"].transpose(0, 1)
    emitted = texel_radiance @ (omega * (r2 / cosine)).transpose(1, 2)
    radiance = disk["radiance"].reshape(-1, 2, 3).transpose(1, 2)
    radiance = torch.minimum(radiance * (emitted / (radiance @ total).clamp(min=1e-12)),
                             texel_radiance.amax(2, keepdim=True))
    radiance = radiance.transpose(1, 2).flatten(0, 1)
    position = disk["position"]
    # A disk wider than its distance is no longer a small piece of surface.
    area = torch.minimum(total.flatten(0, 1), math.pi * (position * position).sum(1, keepdim=True))
    share = (visible.sum(2, keepdim=True) / whole.clamp(min=1e-12)).flatten(0, 1)
    albedo = disk.get("albedo", torch.zeros_like(radiance))  # one bounce needs none
    return Disks(position, functional.normalize(disk["normal"], dim=1), radiance, albedo, area, share)


def split_channels(texels: Tensor, rows: Mapping[str, slice]) -> dict[str, Tensor]:
    """Channels along the first axis by quantity."""
    return {quantity: texels[at] for quantity, at in rows.items()}


def select_largest(disks: list[Disks], count: int) -> Disks:
    """The ``count`` disks with the largest share of their cells, so that second surfaces are dropped first."""
    everything = Disks(*(torch.cat([getattr(part, f.name) for part in disks]) for f in fields(Disks)))
    return everything.select(everything.share[:, 0].topk(count).indices)


def form_factors(p: Tensor, n: Tensor, disks: Disks) -> Tensor:
    """Form factors [Q, S] from points to surfels as disks, without occlusion.

    They are exact for disks that lie entirely above the receiver's horizon. With R the disk's radius, d the distance,
    a = n·(q − p) and h = m·(p − q) the heights of each above the other's plane, c = n·m, and
    S² = (d² + R²)² − 4 R² (d² − h²), the factors of a parallel and of a perpendicular element (Howell, A Catalog
    of Radiation Heat Transfer Configuration Factors, element to disk) are the components of a vector, which gives

        F = R² h (2 a − 4 c h R² / (S + d² − R²)) / (S (S + d² + R²)).

    Far away it approaches the geometry term a h A / (π d⁴); nearby it stays bounded, where the geometry term does not.
    """
    q, m, r2 = disks.position, disks.normal, disks.area.t() / math.pi
    r = r2.sqrt()
    # One matrix product with an offset for each of r·a, 2·r·h and d² − r².
    ra = torch.addmm(-(n * p).sum(1, keepdim=True) * r, n, q.t() * r)
    hr = torch.relu(torch.addmm(-2 * (q * m).sum(1) * r, p, 2 * m.t() * r))
    e = torch.addmm((q * q).sum(1) - r2, torch.cat([p, (p * p).sum(1, keepdim=True)], 1),
                    torch.cat([-2 * q.t(), torch.ones_like(r)]))
    # Keeps the root above |e| despite rounding, which grows with the coordinates and with the disk.
    margin = (1e-3 * r2 + 1e-5 * (q * q).sum(1) + 1e-4).square()
    root = torch.sqrt(e * e + (hr * hr + margin))
    near = root + e
    lateral = ra - (n @ (m.t() * r2)) * hr / near
    return (hr * lateral / (root * (near + 2 * r2))).clamp(0, 1)


def _largest_surface(same: Tensor, omega: Tensor) -> Tensor:
    """Texels [N, 1, T], 0 or 1, of the surface in each cell that covers the largest solid angle.

    ``same`` [N, K, T] tells which texels lie on the surface through each of the K candidates.
    """
    rows = (same @ omega.transpose(1, 2)).argmax(1, keepdim=True)
    return same.gather(1, rows.expand(-1, 1, same.shape[2]))


def _split_cells(texels: Tensor, cell: int) -> Tensor:
    """An image [C, H, W] as cells [N, C, cell²]."""
    c, h, w = texels.shape
    cells = texels.reshape(c, h // cell, cell, w // cell, cell).permute(1, 3, 0, 2, 4)
    return cells.reshape(-1, c, cell * cell)


def _candidates(cell: int) -> list[int]:
    """Evenly spaced texels of a cell that are tried as the centre of a surface."""
    at = [(2 * i + 1) * cell // (2 * CANDIDATES) for i in range(CANDIDATES)]
    return [row * cell + column for row in at for column in at]
