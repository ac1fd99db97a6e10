"""The networks of pix2pix (Isola et al. 2017, "Image-to-Image Translation with Conditional Adversarial Networks")."""

import torch
from torch import Tensor, nn
from torch.nn import functional

FEATURES, COLORS = 12, 3  # input channels; channels of a light map
NEGATIVE_SLOPE = 0.2      # of LeakyReLU
DROPOUT_BLOCKS = 3        # decoder blocks with dropout
EPSILON = 1e-5


class Generator(nn.Module):
    """U-Net of 4×4 convolutions that halve, then double the resolution, with skips and a final Tanh.

    Layers of equal width share one batch norm, which matches the weight counts of Mahmud et al.; hence there are no
    running statistics, and each image is always normalized by its own.
    """

    def __init__(self, widths: tuple[int, ...], dropout: float) -> None:
        super().__init__()
        self.down = nn.ModuleList(nn.Conv2d(i, o, 4, 2, 1) for i, o in
                                  zip((FEATURES, *widths[:-1]), widths, strict=True))
        ups = (*widths[-2::-1], COLORS)
        skips = (0, *widths[-2::-1])
        self.up = nn.ModuleList(nn.ConvTranspose2d(before + skip, o, 4, 2, 1) for before, skip, o in
                                zip((widths[-1], *ups[:-1]), skips, ups, strict=True))
        self.norms = nn.ModuleDict({str(width): Norm(width) for width in dict.fromkeys((*widths[1:-1], *ups[:-1]))})
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor) -> Tensor:
        """A light map [B, 3, H, W] with values in (-1, 1), from features [B, 12, H, W]."""
        skips: list[Tensor] = []
        for number, convolve in enumerate(self.down):
            x = convolve(x if number == 0 else functional.leaky_relu(x, NEGATIVE_SLOPE))
            if 0 < number < len(self.down) - 1:
                x = self.norms[str(convolve.out_channels)](x)
            skips.append(x)
        for number, convolve in enumerate(self.up):
            joined = x if number == 0 else torch.cat([x, skips[-1 - number]], 1)
            x = convolve(functional.relu(joined))
            if number < len(self.up) - 1:
                x = self.norms[str(convolve.out_channels)](x)
            if 0 < number <= DROPOUT_BLOCKS:
                x = self.dropout(x)
        return torch.tanh(x)


class ConditionalPatchGan(nn.Module):
    """PatchGAN discriminator of light maps, conditioned on the generator's input; each output sees 70×70 texels."""

    def __init__(self, widths: tuple[int, ...] = (64, 128, 256, 512)) -> None:
        super().__init__()
        strides = (*[2] * (len(widths) - 1), 1)
        self.layers = nn.ModuleList(nn.Conv2d(i, o, 4, s, 1) for i, o, s in
                                    zip((FEATURES + COLORS, *widths[:-1]), widths, strides, strict=True))
        self.norms = nn.ModuleList(Norm(width) for width in widths[1:])
        self.last = nn.Conv2d(widths[-1], 1, 4, 1, 1)

    def forward(self, features: Tensor, light: Tensor) -> Tensor:
        """Logits that a patch is real; ``features`` [B, 12, h, w], ``light`` [B, 3, h, w] on the scale of Tanh."""
        x = torch.cat([features, light], 1)
        for number, convolve in enumerate(self.layers):
            x = convolve(x)
            x = functional.leaky_relu(self.norms[number - 1](x) if number else x, NEGATIVE_SLOPE)
        return torch.as_tensor(self.last(x))


class Norm(nn.Module):
    """Batch norm for single images: each is normalized by its own mean and variance, in training and inference."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.weight, self.bias = nn.Parameter(torch.ones(width)), nn.Parameter(torch.zeros(width))

    def forward(self, x: Tensor) -> Tensor:
        """[B, C, h, w]."""
        off = x.float() - x.float().mean((2, 3), keepdim=True)
        relative = off * torch.rsqrt(off.square().mean((2, 3), keepdim=True) + EPSILON)
        return relative.to(x.dtype) * self.weight.reshape(1, -1, 1, 1) + self.bias.reshape(1, -1, 1, 1)
