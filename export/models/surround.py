"""Surrounding-aware light: a U-Net that sees six views around the camera as one picture.

Mahmud et al. 2022, "Surrounding-aware screen-space-global-illumination using generative adversarial networks", whose
networks are those of pix2pix (Isola et al. 2017). Where the text is silent the choice is named here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.network.channels import PANORAMA
from app.network.contract import ModelContract, TensorSpec
from export.models.channel_normalization import DARKEST as DARKEST_MEAN
from export.models.channel_normalization import times_means
from export.models.finite import finite
from export.models.network import Network
from export.models.panorama import solid_angles
from export.models.unoccluded_mean_radiance import unoccluded_mean_radiance

EXTENT = 40.0
FARTHEST = 2.0   # extents
SLOPE = 0.2      # of LeakyReLU below 0, as in pix2pix
AROUND = ("albedo.rgb", "normal.view.xyz", "depth", "surface_and_sky_radiance.rgb")
SCREEN = ("position.view.xyz",)
SEEN, COLORS = 12, 3    # channels: those of AROUND with azimuth and height; a light map's
DROPPED = 3             # decoder blocks with dropout
SHARPER = 2             # panorama that is drawn for users, to that which the generator sees
DARKEST = 0.02          # albedo that surface_and_sky_radiance is divided by, at least
MU, BRIGHTEST = 16.0, 1024.0  # of the μ-law between Tanh and light in means of the sphere, and where it ends
EPSILON = 1e-5


@dataclass(frozen=True)
class Preset:
    """Channels of each halving, and the height of the panorama."""

    widths: tuple[int, ...]
    height: int


PRESETS = {
    "surround-paper": Preset((64, 128, 256, 512, 512, 512, 512, 512), 512),
    "surround-16": Preset((16, 32, 64, 128, 128, 128), 128),
}


class Surround(Network):
    """A light map of all that surrounds the camera, of which the screen takes its part.

    The thesis's map is of direct and indirect light together. What is known of it the panorama tells, surface_and_sky_radiance
    (direct light, and what glows) / albedo, so that the generator gives the rest, and loss and discriminator see the sum:
    nothing is to be taken off, which would leave what the generator errs by where light is strong.

    The generator is shown light in means of the sphere, of each colour, and gives it relative to ``unoccluded_mean_radiance``: what the
    lit places would send by the inverse square law. So how much light there is, and how far away, it need not learn,
    but what shadows, angles and further bounces make of it.

    Attributes
    ----------
    contract : ModelContract
    height : int
        Of the panorama that the generator sees, in texels.
    front_alone : bool
        Shows it nothing but the front view, for comparison: then it is DeepIllumination (Thomas and Forbes 2017). What
        it gives is in means of the sphere: it is told how much light there is, not where.
    """

    remark = ("of the light map the generator gives what is indirect, which is looked up where the screen's texels "
              "lie around the camera, relative to what the lit places around it would send there by the inverse "
              "square law (of the front alone: to the mean light of the sphere); for loss and discriminator the known part is "
              f"added, surface_and_sky_radiance / albedo, of an albedo of at least {DARKEST:g}, so that none is to be removed")

    def __init__(self, name: str, front_alone: bool = False, dropout: float = 0.5) -> None:
        super().__init__()
        preset = PRESETS[name]
        self.front_alone, self.height = front_alone, preset.height
        self.contract = ModelContract(
            name=name + "-front" * front_alone,
            paper="Mahmud et al. 2022, Surrounding-Aware Screen-Space Global Illumination",
            inputs={"around": TensorSpec(AROUND, PANORAMA, preset.height), "screen": TensorSpec(SCREEN)},
            outputs={"y": TensorSpec(("indirect.rgb",))}, scale=1 / 4, exposure="mean-radiance", bounces="multi",
            scene_extent=EXTENT, cube_axes="camera", licence="MIT")
        self.generator = Generator(preset.widths, dropout)
        h, w = preset.height, 2 * preset.height
        down, right = torch.meshgrid(torch.linspace(-1, 1, h), torch.linspace(-1, 1, w), indexing="ij")
        self.register_buffer("angles", torch.stack([right, down])[None], persistent=False)
        front = torch.zeros(1, 1, h, w)
        front[..., h // 4:3 * h // 4, 3 * w // 8:5 * w // 8] = 1.0
        self.register_buffer("front", front, persistent=False)
        self.register_buffer("solid_angle", torch.from_numpy(solid_angles(h)).float(), persistent=False)

    def forward(self, around: Tensor, screen: Tensor) -> Tensor:
        """Infer one batch of frames.

        Parameters
        ----------
        around : Tensor, shape (B, 10, H, 2 H)
        screen : Tensor, shape (B, 3, h, w)

        Returns
        -------
        Tensor, shape (B, 3, h, w)
            Indirect radiance / albedo in the unit of ``around``, at least 0; 0 in the sky.
        """
        position = self._position(screen)
        light = functional.grid_sample(self.relative_map(around), places(position), align_corners=False,
                                       padding_mode="border")
        surface = (position.abs().sum(1, keepdim=True) > 0).to(position.dtype)
        return times_means(light * surface, self._unit(around, position)).to(around.dtype)

    def export_contract(self) -> ModelContract:
        """With a panorama of more texels, over which light is averaged: a strip of sun sends as much as it is wide.

        The twin of the front alone is not told where the lit places lie, so its panorama stays as it is.
        """
        if self.front_alone:
            return self.contract
        around = self.contract.inputs["around"]
        return replace(self.contract, inputs={**self.contract.inputs,
                                              "around": replace(around, size=SHARPER * self.height)})

    def condition(self, around: Tensor, screen: Tensor) -> Tensor:
        """What the loss needs beside light, [B, 16, h, w], on the screen.

        ``seen``, and known light, surface_and_sky_radiance / albedo, in a unit that is the last channel: the mean light of the whole
        sphere over all colours, so that colours are weighed by their light.
        """
        albedo, _, _, surface_and_sky_radiance = self._split(around)
        seen, means = self._exposed(around)
        unit = means.mean(1, keepdim=True).clamp(min=DARKEST_MEAN)
        known = surface_and_sky_radiance.float() / albedo.float().clamp(min=DARKEST) / unit
        found = torch.cat([seen.float(), known, unit.expand_as(known[:, :1])], 1)
        return functional.grid_sample(found, places(self._position(screen)), mode="nearest", align_corners=False,
                                      padding_mode="border")

    def relative_map(self, around: Tensor) -> Tensor:
        """Indirect light [B, 3, H, 2 H] without albedo over that of the unit at each place, in single precision."""
        return from_tanh(smooth(self.generator(self.seen(around)).float()))

    def seen(self, around: Tensor) -> Tensor:
        """What generator and discriminator look at, [B, 12, H, 2 H], each channel of about unit size."""
        return self._exposed(around)[0]

    def _exposed(self, around: Tensor) -> tuple[Tensor, Tensor]:
        """``seen``, and each colour's mean over the sphere by solid angle, [B, 3, 1, 1], in single precision."""
        albedo, normal, depth, light = self._split(around)
        means = self._means(light)
        relative = self._shown(light.float() / means.clamp(min=DARKEST_MEAN))
        surfaces = self._shown(torch.cat([albedo, normal, (depth / EXTENT).clamp(max=FARTHEST)], 1))
        found = torch.cat([surfaces, to_tanh(relative).to(depth)], 1)
        return torch.cat([found, self.get_buffer("angles").to(found).expand(len(found), -1, -1, -1)], 1), means

    def _shown(self, x: Tensor) -> Tensor:
        return x * self.get_buffer("front").to(x) if self.front_alone else x

    def _means(self, light: Tensor) -> Tensor:
        share = self.get_buffer("solid_angle").float() / (4 * math.pi)
        return (light.float() * share).sum((2, 3), keepdim=True)

    def _unit(self, around: Tensor, position: Tensor) -> Tensor:
        """What the generator's light is relative to, of each colour, [B, 3, h, w]; of the front alone [B, 3, 1, 1]."""
        _, normal, depth, light = (x.float() for x in self._split(around))
        means = self._means(light)
        if self.front_alone:
            return means
        relative = light / means.clamp(min=DARKEST_MEAN)
        return means * unoccluded_mean_radiance(relative, normal, depth, self.get_buffer("solid_angle").float(), position)

    def _split(self, around: Tensor) -> tuple[Tensor, ...]:
        """Albedo, normal, depth, surface_and_sky_radiance of the generator's size: of more texels light's mean, one of the rest."""
        albedo, normal, depth, light = torch.split(finite(around, self.contract.inputs["around"]), [3, 3, 1, 3], dim=1)
        every = around.shape[2] // self.height
        if every == 1:
            return albedo, normal, depth, light
        picked = (x[..., every // 2::every, every // 2::every] for x in (albedo, normal, depth))
        return *picked, functional.avg_pool2d(light.float(), every).to(light.dtype)

    def _position(self, screen: Tensor) -> Tensor:
        """In single precision, [B, 3, h, w]."""
        return finite(screen, self.contract.inputs["screen"]).float()


class Generator(nn.Module):
    """pix2pix's U-Net: 4×4 convolutions that halve, then double, with skips; Tanh at the end.

    Layers of one width share one batch norm, as the thesis's counts of weights tell, and so no running statistics: a
    picture is always normed by its own.
    """

    def __init__(self, widths: tuple[int, ...], dropout: float) -> None:
        super().__init__()
        self.down = nn.ModuleList(nn.Conv2d(i, o, 4, 2, 1) for i, o in zip((SEEN, *widths[:-1]), widths, strict=True))
        ups = (*widths[-2::-1], COLORS)
        skips = (0, *widths[-2::-1])
        self.up = nn.ModuleList(nn.ConvTranspose2d(before + skip, o, 4, 2, 1) for before, skip, o in
                                zip((widths[-1], *ups[:-1]), skips, ups, strict=True))
        self.norms = nn.ModuleDict({str(width): Norm(width) for width in dict.fromkeys((*widths[1:-1], *ups[:-1]))})
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor) -> Tensor:
        """A picture [B, 3, H, W] of values in (-1, 1), of [B, 12, H, W]."""
        skips: list[Tensor] = []
        for number, convolve in enumerate(self.down):
            x = convolve(x if number == 0 else functional.leaky_relu(x, SLOPE))
            if 0 < number < len(self.down) - 1:
                x = self.norms[str(convolve.out_channels)](x)
            skips.append(x)
        for number, convolve in enumerate(self.up):
            joined = x if number == 0 else torch.cat([x, skips[-1 - number]], 1)
            x = convolve(functional.relu(joined))
            if number < len(self.up) - 1:
                x = self.norms[str(convolve.out_channels)](x)
            if 0 < number <= DROPPED:
                x = self.dropout(x)
        return torch.tanh(x)


class Discriminator(nn.Module):
    """pix2pix's PatchGAN on what the generator saw and a light map; each output looks at 70×70 texels."""

    def __init__(self, widths: tuple[int, ...] = (64, 128, 256, 512)) -> None:
        super().__init__()
        strides = (*[2] * (len(widths) - 1), 1)
        self.layers = nn.ModuleList(nn.Conv2d(i, o, 4, s, 1) for i, o, s in
                                    zip((SEEN + COLORS, *widths[:-1]), widths, strides, strict=True))
        self.norms = nn.ModuleList(Norm(width) for width in widths[1:])
        self.last = nn.Conv2d(widths[-1], 1, 4, 1, 1)

    def forward(self, seen: Tensor, light: Tensor) -> Tensor:
        """Logits of how true each patch looks; ``seen`` [B, 12, h, w], ``light`` [B, 3, h, w] as Tanh has it."""
        x = torch.cat([seen, light], 1)
        for number, convolve in enumerate(self.layers):
            x = convolve(x)
            x = functional.leaky_relu(self.norms[number - 1](x) if number else x, SLOPE)
        return torch.as_tensor(self.last(x))


class Norm(nn.Module):
    """Batch norm of a batch of one: each picture by its own mean and variance, in training as later."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.weight, self.bias = nn.Parameter(torch.ones(width)), nn.Parameter(torch.zeros(width))

    def forward(self, x: Tensor) -> Tensor:
        """[B, C, h, w]."""
        off = x.float() - x.float().mean((2, 3), keepdim=True)
        relative = off * torch.rsqrt(off.square().mean((2, 3), keepdim=True) + EPSILON)
        return relative.to(x.dtype) * self.weight.reshape(1, -1, 1, 1) + self.bias.reshape(1, -1, 1, 1)


def places(position: Tensor) -> Tensor:
    """Where the panorama shows points, [B, h, w, 2] for ``grid_sample``; position [B, 3, h, w] in camera space.

    See ``shaders/include/panorama.glsl``. All views are looked into, so that no field of view is too wide.
    """
    x, y, z = position.unbind(1)
    largest = position.abs().amax(1).clamp(min=1e-12)
    x, y, z = x / largest, y / largest, z / largest
    level = torch.maximum(x.abs(), z.abs()) >= y.abs()
    aside, ahead, side = x.abs() > z.abs(), z < 0, x.sign()
    # Units: half the edge of a view. The middle of the front is the origin; the whole is 8 wide and 4 high.
    across = torch.where(aside, side * (2 + z), torch.where(ahead, x, side * (4 - x.abs())))
    turned = torch.where(level, across, 4 * x)
    down = torch.where(level, -y, torch.where(y > 0, -1.5 - z / 2, 1.5 + z / 2))
    return torch.stack([turned / 4, down / 2], -1)


def smooth(picture: Tensor) -> Tensor:
    """Without what repeats after two or four texels, as transposed convolutions leave it: [1 2 2 2 1] / 8."""
    return functional.avg_pool2d(functional.avg_pool2d(functional.pad(picture, (2, 2, 2, 2), "replicate"), 4, 1), 2, 1)


def to_tanh(light: Tensor) -> Tensor:
    """Light in means, of one colour or of all, on Tanh's scale: logarithmic, -1 is black."""
    return 2 * torch.log1p(MU * light.clamp(0, BRIGHTEST)) / math.log1p(MU * BRIGHTEST) - 1


def from_tanh(value: Tensor) -> Tensor:
    """What ``to_tanh`` made of light."""
    return (((value + 1) / 2 * math.log1p(MU * BRIGHTEST)).exp() - 1) / MU
