"""Indirect light without training: surfels seen from the camera light every pixel, by form factors alone.

``gather`` takes one bounce from them; ``radiosity`` first lets them light each other. Geometry stays
float32 throughout: d² = |p|² + |q|² − 2 p·q cancels.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.channels import CHANNELS, CUBE, SCREEN
from app.contract import ModelContract, TensorSpec

FACE = 32  # texels along the edge of a cube face
CELL = 4  # texels along the edge of the cell that becomes one surfel
SCREEN_ROWS, SCREEN_COLUMNS = 48, 64  # texels taken from the screen grid, whatever its size
BOUNCES = 8
GRAZING = 0.05  # smallest cosine: beyond it a texel's area says nothing
FLATNESS = 0.15  # a texel belongs to a cell's surface within this fraction of the cell's width


def _contract(name: str, bounces: str, channels: tuple[str, ...]) -> ModelContract:
    return ModelContract(
        name=name, paper="geometry-term gather and radiosity over surfels, without training",
        inputs={"screen": TensorSpec(channels), "cube": TensorSpec((*channels, "on_screen"), CUBE, FACE)},
        outputs={"indirect": TensorSpec(("indirect.rgb",), SCREEN)},
        scale=1 / 16, exposure="mean-radiance", bounces=bounces, scene_extent=40.0, cube_axes="world",
        trained_on="nothing", licence="MIT")


class Gather(nn.Module):
    """One bounce: each pixel sums radiance × form factor over all surfels, without visibility.

    Up to 576 surfels: 192 from the screen and 384 from those parts of the cube that the screen does not show.

    Inputs (see ``contract``)
    -------------------------
    screen : Tensor, float32, shape (1, C, h, w)
        The points to be lit; they send light too.
    cube : Tensor, float32, shape (1, C + 1, 6, n, n)

    Returns
    -------
    Tensor, float32, shape (1, 3, h, w)
        Indirect radiance / albedo; 0 in the sky. Never more than the largest radiance of a surfel.
    """

    contract = _contract("gather", "single", ("position.view.xyz", "normal.view.xyz", "radiance.rgb", "solid_angle"))

    def forward(self, screen: Tensor, cube: Tensor) -> Tensor:
        screen = _finite(screen, self.contract.inputs["screen"])
        cube = _finite(cube, self.contract.inputs["cube"])
        texels = functional.interpolate(screen, (SCREEN_ROWS, SCREEN_COLUMNS), mode="nearest")
        surfels = [self._surfels(self._named("screen", _cells(texels)), self._kept_total(screen, texels)),
                   self._surfels(self._named("cube", _cells(cube[0].transpose(0, 1))), 1.0)]
        s = {key: torch.cat([part[key] for part in surfels]) for key in surfels[0]}

        q = self._named("screen", screen[0].flatten(1).t())
        # Around the middle of what is seen, so that products of coordinates stay small.
        weight = s["solid_angle"]
        origin = (s["position"] * weight).sum(0) / weight.sum().clamp(min=1e-12)
        s["position"] = s["position"] - origin
        light = _receive(q["position"] - origin, q["normal"], s, self.outgoing(s))
        light = light * (q["solid_angle"] > 0)
        return light.t().reshape(1, 3, screen.shape[2], screen.shape[3])

    def outgoing(self, s: dict[str, Tensor]) -> Tensor:
        """Radiance [S, 3] that the surfels send."""
        return s["radiance"]

    def _named(self, tensor: str, rows: Tensor) -> dict[str, Tensor]:
        """Last-axis columns by quantity: position, normal, radiance, solid_angle …"""
        return {name.split(".")[0]: rows[..., at] for name, at in self.contract.inputs[tensor].rows()}

    def _kept_total(self, screen: Tensor, texels: Tensor) -> Tensor:
        """Factor that gives the picked texels the solid angle of all."""
        at = dict(self.contract.inputs["screen"].rows())["solid_angle"]
        return screen[:, at].sum() / texels[:, at].sum().clamp(min=1e-12)

    def _surfels(self, t: dict[str, Tensor], share: Tensor | float) -> dict[str, Tensor]:
        """One surfel from each cell of texels [cells, T, ·]: the surface that fills most of the cell.

        Geometry and radiance are means over the texels of that surface alone; its area, r² Ω / cos θ summed, is
        extended to the solid angle of the whole cell.
        """
        p, n = t["position"], t["normal"]
        omega = t["solid_angle"] * share
        if "on_screen" in t:
            omega = omega * (1 - t["on_screen"])
        r2 = (p * p).sum(-1, keepdim=True)
        plane = (n * p).sum(-1, keepdim=True)
        width = (r2 * omega.sum(1, keepdim=True)).sqrt()
        same = ((n @ p.transpose(1, 2) - plane).abs() <= FLATNESS * width) & (n @ n.transpose(1, 2) > 0.8)
        same = same.to(p.dtype)
        fullest = (same @ omega).argmax(1, keepdim=True)
        member = same.gather(1, fullest.expand(-1, 1, same.shape[2])).transpose(1, 2)
        seen = member * omega
        area = seen * r2 / (-plane * r2.clamp(min=1e-12).rsqrt()).clamp(min=GRAZING)
        total = area.sum(1)
        of = area / total.unsqueeze(1).clamp(min=1e-12)
        solid_angle = omega.sum(1)
        mean = {key: (of * value).sum(1) for key, value in t.items() if key not in ("solid_angle", "on_screen")}
        mean["normal"] = functional.normalize(mean["normal"], dim=1)
        area = total * solid_angle / seen.sum(1).clamp(min=1e-12)
        # A disk wider than its distance is no longer a small piece of surface.
        farthest = math.pi * (mean["position"] * mean["position"]).sum(1, keepdim=True)
        return mean | {"solid_angle": solid_angle, "area": torch.minimum(area, farthest)}


class Radiosity(Gather):
    """Many bounces: the surfels light each other eight times before the pixels gather."""

    contract = _contract("radiosity", "multi", ("position.view.xyz", "normal.view.xyz", "albedo.rgb", "radiance.rgb",
                                                "solid_angle"))

    def outgoing(self, s: dict[str, Tensor]) -> Tensor:
        factors = _form_factors(s["position"], s["normal"], s)
        # Rows of at most 1: energy can't grow.
        spread = s["albedo"] / factors.sum(1, keepdim=True).clamp(min=1)
        light = s["radiance"]
        for _ in range(BOUNCES):
            light = s["radiance"] + spread * (factors @ light)
        return light


def _receive(p: Tensor, n: Tensor, s: dict[str, Tensor], light: Tensor) -> Tensor:
    """Radiance / albedo [Q, 3] at points ``p`` with normals ``n``; their form factors sum to 1 at most."""
    sums = _form_factors(p, n, s) @ torch.cat([light, torch.ones_like(light[:, :1])], 1)
    return sums[:, :3] / sums[:, 3:].clamp(min=1)


def _form_factors(p: Tensor, n: Tensor, s: dict[str, Tensor]) -> Tensor:
    """Form factors [Q, S] from points to surfels taken as disks, unoccluded.

    The exact factor of a disk that lies wholly above the receiver's horizon. With R its radius, d the distance,
    a = n·(q − p) and h = m·(p − q) the heights of each above the other's plane, c = n·m, and
    S² = (d² + R²)² − 4 R² (d² − h²), the components along and across the disk's axis (Howell's catalogue
    of configuration factors, B-12 and B-15) add up to

        F = R² h (2 a − 4 c h R² / (S + d² − R²)) / (S (S + d² + R²)).

    Far away it is a h A / (π d⁴), the geometry term; nearby it is bounded, where the geometry term is not.
    """
    q, m, r2 = s["position"], s["normal"], s["area"].t() / math.pi
    r = r2.sqrt()
    a = torch.addmm(-(n * p).sum(1, keepdim=True), n, q.t())
    hr = torch.relu(torch.addmm(-(q * m).sum(1) * r, p, (m * r.t()).t())) * 2
    e = torch.addmm((q * q).sum(1) - r2, torch.cat([p, (p * p).sum(1, keepdim=True)], 1),
                    torch.cat([-2 * q, torch.ones_like(q[:, :1])], 1).t())
    c = n @ (m * r.t()).t()
    root = torch.sqrt(e * e + hr * hr)
    near = root + e
    lateral = a - c * hr / (near + 1e-4)
    return (hr * r * lateral / (root * (near + 2 * r2) + 1e-6)).clamp(0, 1)


def _cells(texels: Tensor) -> Tensor:
    """Images [B, C, H, W] as cells [B·H/4·W/4, 16, C]."""
    b, c, h, w = texels.shape
    cells = texels.reshape(b, c, h // CELL, CELL, w // CELL, CELL).permute(0, 2, 4, 3, 5, 1)
    return cells.reshape(-1, CELL * CELL, c)


def _finite(x: Tensor, spec: TensorSpec) -> Tensor:
    """NaN becomes 0, everything else is clamped to its channel's range."""
    ranges = torch.tensor([CHANNELS[n].range for n in spec.channels for _ in range(CHANNELS[n].components)])
    low, high = ranges.t().reshape(2, 1, -1, *[1] * (x.dim() - 2))
    return torch.minimum(torch.maximum(torch.where(torch.isnan(x), torch.zeros_like(x), x), low), high)
