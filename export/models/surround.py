"""Surrounding-aware indirect light: a U-Net whose input is a panorama of six views around the camera.

Mahmud et al. 2022, "Surrounding-aware screen-space-global-illumination using generative adversarial networks", with the
networks of pix2pix (Isola et al. 2017). Choices that the thesis leaves open are documented in this module.
"""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from app.network.channels import PANORAMA
from app.network.contract import ModelContract, TensorSpec
from export.models.channel_normalization import MIN_MEAN, denormalize_channels
from export.models.network import EXTENT, MAX_POSITION, Network, sanitize
from export.models.panorama import project_to_panorama, solid_angles, unoccluded_mean_radiance
from export.models.pix2pix import Generator

PANORAMA_CHANNELS = ("albedo.rgb", "normal.view.xyz", "depth", "surface_and_sky_radiance.rgb")
SUPERSAMPLING = 2   # rows of the exported file's panorama for each row that the generator sees
MIN_ALBEDO = 0.02   # divisors of surface_and_sky_radiance are raised to this
MU, MAX_RADIANCE = 16.0, 1024.0  # μ-law between light in means of the sphere and the range of Tanh


@dataclass(frozen=True)
class Preset:
    """Channels after each halving, and the height of the panorama."""

    widths: tuple[int, ...]
    height: int


PRESETS = {
    "surround-paper": Preset((64, 128, 256, 512, 512, 512, 512, 512), 512),
    "surround-16": Preset((16, 32, 64, 128, 128, 128), 128),
}


class Surround(Network):
    """A light map of everything around the camera, which the screen's texels look up.

    The thesis generates direct and indirect light together. Here the generator predicts indirect light alone; loss and
    discriminator add the known part, surface_and_sky_radiance / albedo. Subtracting direct light from a generated sum
    would leave the generator's errors where direct light is strong.

    The generator sees light relative to the mean over the sphere, colour by colour, and predicts light relative to
    ``unoccluded_mean_radiance``, which accounts for the amount and the distance of light. What is left to learn are
    shadows, angles and further bounces.

    Attributes
    ----------
    height : int
        Of the generator's panorama, in texels.
    front_only : bool
        The generator sees the front view only, as in DeepIllumination (Thomas and Forbes 2017), and its output is
        relative to the mean over the sphere: it knows how much light there is, but not where. For ablations.
    """

    remark = ("the generator predicts indirect light as a panorama, relative to what the lit surfaces around the "
              "camera would send to each point by the inverse square law (the front-only variant: relative to the mean "
              "light of the sphere), and the screen's texels look it up; for loss and discriminator the known part, "
              f"surface_and_sky_radiance / albedo, is added, with albedo raised to at least {MIN_ALBEDO:g}")

    def __init__(self, name: str, front_only: bool = False, dropout: float = 0.5) -> None:
        super().__init__()
        preset = PRESETS[name]
        self.front_only, self.height = front_only, preset.height
        self.contract = ModelContract(
            name=name + "-front" * front_only,
            paper="Mahmud et al. 2022, Surrounding-Aware Screen-Space Global Illumination",
            inputs={"around": TensorSpec(PANORAMA_CHANNELS, PANORAMA, preset.height),
                    "screen": TensorSpec(("position.view.xyz",))},
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
        light = functional.grid_sample(self.relative_map(around), project_to_panorama(position), align_corners=False,
                                       padding_mode="border")
        surface = (position.abs().sum(1, keepdim=True) > 0).to(position.dtype)
        return denormalize_channels(light * surface, self._unit(around, position)).to(around.dtype)

    def export_contract(self) -> ModelContract:
        """With a panorama of higher resolution, whose light is averaged, so that a narrow strip of sun keeps its flux.

        The front-only variant does not use the position of lit texels, so its panorama stays as it is.
        """
        if self.front_only:
            return self.contract
        around = self.contract.inputs["around"]
        return replace(self.contract, inputs={**self.contract.inputs,
                                              "around": replace(around, size=SUPERSAMPLING * self.height)})

    def condition(self, around: Tensor, screen: Tensor) -> Tensor:
        """What the loss reads besides light, on the screen, [B, 16, h, w].

        The ``features``, the known light surface_and_sky_radiance / albedo, and last the unit of that light: the mean
        over the whole sphere and all colours, so that colours are weighted by their light.
        """
        albedo, _, _, radiance = self._split(around)
        features, means = self._features(around)
        unit = means.mean(1, keepdim=True).clamp(min=MIN_MEAN)
        known = radiance.float() / albedo.float().clamp(min=MIN_ALBEDO) / unit
        panorama = torch.cat([features.float(), known, unit.expand_as(known[:, :1])], 1)
        return functional.grid_sample(panorama, project_to_panorama(self._position(screen)), mode="nearest",
                                      align_corners=False, padding_mode="border")

    def relative_map(self, around: Tensor) -> Tensor:
        """Indirect light / albedo [B, 3, H, 2 H], relative to the unit of each point, in single precision."""
        return from_tanh(smooth(self.generator(self.features(around)).float()))

    def features(self, around: Tensor) -> Tensor:
        """Input of generator and discriminator, [B, 12, H, 2 H], each channel of about unit scale."""
        return self._features(around)[0]

    def _features(self, around: Tensor) -> tuple[Tensor, Tensor]:
        """``features``, and the mean of each colour over the sphere, float32 [B, 3, 1, 1]."""
        albedo, normal, depth, light = self._split(around)
        means = self._means(light)
        relative = self._visible(light.float() / means.clamp(min=MIN_MEAN))
        surfaces = self._visible(torch.cat([albedo, normal, (depth / EXTENT).clamp(max=MAX_POSITION)], 1))
        panorama = torch.cat([surfaces, to_tanh(relative).to(depth)], 1)
        return torch.cat([panorama, self.get_buffer("angles").to(panorama).expand(len(panorama), -1, -1, -1)], 1), means

    def _visible(self, x: Tensor) -> Tensor:
        return x * self.get_buffer("front").to(x) if self.front_only else x

    def _means(self, light: Tensor) -> Tensor:
        share = self.get_buffer("solid_angle").float() / (4 * math.pi)
        return (light.float() * share).sum((2, 3), keepdim=True)

    def _unit(self, around: Tensor, position: Tensor) -> Tensor:
        """Unit of the generated light, [B, 3, h, w]; [B, 3, 1, 1] for the front-only variant."""
        _, normal, depth, light = (x.float() for x in self._split(around))
        means = self._means(light)
        if self.front_only:
            return means
        relative = light / means.clamp(min=MIN_MEAN)
        solid_angle = self.get_buffer("solid_angle").float()
        return means * unoccluded_mean_radiance(relative, normal, depth, solid_angle, position)

    def _split(self, around: Tensor) -> tuple[Tensor, ...]:
        """Albedo, normal, depth (subsampled) and radiance (averaged) at the generator's resolution."""
        around = sanitize(around, self.contract.inputs["around"])
        albedo, normal, depth, light = torch.split(around, [3, 3, 1, 3], dim=1)
        stride = around.shape[2] // self.height
        if stride == 1:
            return albedo, normal, depth, light
        subsampled = (x[..., stride // 2::stride, stride // 2::stride] for x in (albedo, normal, depth))
        return *subsampled, functional.avg_pool2d(light.float(), stride).to(light.dtype)

    def _position(self, screen: Tensor) -> Tensor:
        """In single precision, [B, 3, h, w]."""
        return sanitize(screen, self.contract.inputs["screen"]).float()


def smooth(image: Tensor) -> Tensor:
    """Remove the checkerboard of transposed convolutions, of period 2 or 4, by the filter [1 2 2 2 1] / 8."""
    return functional.avg_pool2d(functional.avg_pool2d(functional.pad(image, (2, 2, 2, 2), "replicate"), 4, 1), 2, 1)


def to_tanh(light: Tensor) -> Tensor:
    """Light in means of the sphere on the μ-law scale from -1, black, to 1, ``MAX_RADIANCE``."""
    return 2 * torch.log1p(MU * light.clamp(0, MAX_RADIANCE)) / math.log1p(MU * MAX_RADIANCE) - 1


def from_tanh(value: Tensor) -> Tensor:
    """The inverse of ``to_tanh``."""
    return (((value + 1) / 2 * math.log1p(MU * MAX_RADIANCE)).exp() - 1) / MU
