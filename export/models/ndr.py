"""NDR: a U-Net with two decoders that adds shadows and detail to unshadowed shading by an environment.

Suppan, Kaplanyan, Chalmers and Hall, "Neural Direct Illumination under distant light": normals, roughness, depth and
unshadowed shading on the screen, the environment's spherical harmonics at the bottleneck, one decoder for diffuse and
one for specular light. The paper leaves widths and activations open; this module documents the choices.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.network.channels import CHANNELS, DIFFUSE, GLOBALS, SPECULAR, UNSHADOWED_CHANNELS
from app.network.contract import ModelContract, TensorSpec
from export.models.network import EXTENT, MAX_LOGIT, MAX_POSITION, NEGATIVE_SLOPE, Network, Preset, sanitize

MIN_SHADING = 1e-3  # means, added to unshadowed shading so that the network can correct black texels
HARMONICS = "environment.sh"
HALVINGS = 3
PRESETS = {
    "ndr-paper": Preset((64, 128, 256, 512), 1.0),
    "ndr-16": Preset((16, 32, 64, 64), 1 / 2),
    "ndr-8": Preset((8, 16, 32, 64), 1 / 2),
}


class Ndr(Network):
    """Diffuse and specular light that arrives directly from an environment, in screen space.

    Both decoders end in I / (1 - I) of a sigmoid I, which is an exponential. Where unshadowed shading is an input, the
    output multiplies it, so that a newly initialised network reproduces the unshadowed shading.

    Attributes
    ----------
    harmonics, depth, unshadowed : bool
        Whether these inputs are read, for ablations. Without unshadowed shading the decoders give the light itself.
    decoders : int
        1 or 2, for ablations.
    """

    def __init__(self, name: str, harmonics: bool = True, depth: bool = True, unshadowed: bool = True,
                 decoders: int = 2) -> None:
        super().__init__()
        if decoders not in (1, 2):
            raise ValueError(f"decoders = {decoders}, expected 1 or 2")
        preset = PRESETS[name]
        self.unshadowed = unshadowed
        channels = ("normal.view.xyz", "roughness", *(("depth",) if depth else ()),
                    *(UNSHADOWED_CHANNELS if unshadowed else ()))
        inputs = {"x": TensorSpec(channels)}
        if harmonics:
            inputs["sky"] = TensorSpec((HARMONICS,), GLOBALS)
        self.contract = ModelContract(
            name=name, paper="Suppan et al., Neural Direct Illumination", inputs=inputs,
            outputs={"y": TensorSpec((DIFFUSE, SPECULAR))}, scale=preset.scale, multiple_of=2**HALVINGS,
            exposure="mean-radiance" if unshadowed else "none", bounces="single", scene_extent=EXTENT,
            licence="MIT")
        w = preset.widths
        self.encoder = nn.ModuleList(_block(i, o) for i, o in zip((inputs["x"].components, *w[:-1]), w, strict=True))
        self.sky = nn.Sequential(nn.Linear(CHANNELS[HARMONICS].components, w[-1]), nn.LeakyReLU(NEGATIVE_SLOPE),
                                 nn.Linear(w[-1], w[-1])) if harmonics else None
        self.merge = nn.Conv2d(w[-1] * (2 if harmonics else 1), w[-1], 1)
        self.decoders = nn.ModuleList(Decoder(w, 6 // decoders) for _ in range(decoders))
        last = {layer.last for layer in self.modules() if isinstance(layer, Decoder)}  # zero, for a logit of 0
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d | nn.Linear):
                (nn.init.zeros_ if layer in last else nn.init.xavier_uniform_)(layer.weight)
                if layer.bias is not None:
                    nn.init.zeros_(layer.bias)

    def forward(self, x: Tensor, sky: Tensor | None = None) -> Tensor:
        """Infer one batch of frames.

        Parameters
        ----------
        x : Tensor, shape (B, 11, h, w)
            The contract's channels; radiance relative to the mean of the frame; h and w multiples of 8.
        sky : Tensor, shape (B, 75)
            Spherical harmonics of the environment, in the same unit.

        Returns
        -------
        Tensor, shape (B, 6, h, w)
            Irradiance / π, and radiance gathered by GGX lobes without the Fresnel term; 0 in the sky.
        """
        spec = self.contract.inputs["x"]
        x = sanitize(x, spec)
        rows = {name: x[:, at] for name, at in spec.rows()}
        surface = (rows["normal.view.xyz"].abs().sum(1, keepdim=True) > 0).to(x.dtype)
        if "depth" in rows:
            rows["depth"] = (rows["depth"] / EXTENT).clamp(0, MAX_POSITION)
        light = [rows[name] for name in UNSHADOWED_CHANNELS] if self.unshadowed else []
        for name in UNSHADOWED_CHANNELS if self.unshadowed else ():
            rows[name] = rows[name] / (1 + rows[name])  # Reinhard's curve, the inverse of the output activation
        features = self._encode(torch.cat([rows[name] for name in spec.channels], 1) * surface)
        if self.sky is not None:
            assert sky is not None
            sky = sanitize(sky, self.contract.inputs["sky"])
            code = self.sky(sky / (1 + sky.abs()))[:, :, None, None]
            features[-1] = torch.cat([features[-1], code.expand(-1, -1, *features[-1].shape[2:])], 1)
        features[-1] = functional.leaky_relu(self.merge(features[-1]), NEGATIVE_SLOPE)
        logits = torch.cat([decoder(features) for decoder in self.decoders], 1).float()
        if light:
            logits = logits + torch.log(torch.cat(light, 1).float() + MIN_SHADING)
        return logits.clamp(max=MAX_LOGIT).exp().to(x.dtype) * surface

    def _encode(self, x: Tensor) -> list[Tensor]:
        """The features of each level, the bottleneck last."""
        features: list[Tensor] = []
        for block in self.encoder:
            x = block(functional.avg_pool2d(x, 2) if features else x)
            features.append(x)
        return features


class Decoder(nn.Module):
    """From the bottleneck up to full size, with the encoder's features at each level."""

    def __init__(self, widths: Sequence[int], outputs: int) -> None:
        super().__init__()
        a, b, c, d = widths
        self.blocks = nn.ModuleList(_block(i, o) for i, o in ((d + c, c), (c + b, b), (b + a, a)))
        self.last = nn.Conv2d(a, outputs, 3, padding=1)

    def forward(self, features: Sequence[Tensor]) -> Tensor:
        x = features[-1]
        for block, skip in zip(self.blocks, features[-2::-1], strict=True):
            x = block(torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1))
        return self.last(x)


def _block(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(inputs, outputs, 3, padding=1), nn.LeakyReLU(NEGATIVE_SLOPE),
                         nn.Conv2d(outputs, outputs, 3, padding=1), nn.LeakyReLU(NEGATIVE_SLOPE))
