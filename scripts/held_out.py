"""What do trained networks make of the pairs that none of them was trained on?

    python scripts/held_out.py DATASET CHECKPOINT…

For each checkpoint of `python -m export train`: SSIM and L1 to the target, and L1 to the previous output where it shows
the same surface, all in the μ-law scale of the losses; the spread of the frames' mean light in stops, and the network's
error of it; and how the colours' shares of the light go with the target's (correlation).
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import torch
from torch import Tensor

from export.dataset import Dataset
from export.losses import Views
from export.losses.bcnn import ssim_map
from export.losses.views import mean_where, tone, toned, warp
from export.models import Network
from export.training.config import held_out
from export.training.examples import examples_for, tensors_of
from export.training.state import load

LEAST_SEEN = 0.3   # share of texels with a surface
DARK = 1e-3        # means


@torch.no_grad()
def main(folder: Path, paths: list[Path]) -> None:
    dataset = Dataset(folder)
    checkpoints = [load(path) for path in paths]
    held = held_out(len(dataset), min(checkpoint.config.data.validation for checkpoint in checkpoints))
    print(f"{'':24} {'frames':>6} {'SSIM':>6} {'L1':>6} {'change':>7} {'spread':>7} {'error':>6} {'colours':>8}")
    for path, checkpoint in zip(paths, checkpoints, strict=True):
        network = checkpoint.network()
        examples = examples_for(dataset, network.contract, previous=False)
        if examples.missing:
            sys.exit(f"{len(examples.missing)} pairs are not drawn yet for {path}; train on {folder}, which draws them")
        found = [views for i in held if (views := seen_by(network, examples.batch([i]))) is not None]
        if len(found) < 2:
            sys.exit(f"{len(found)} lit frames among {len(held)} held out of {folder}, expected at least two")
        errors = torch.tensor([judged(views) for views in found]).mean(dim=0).tolist()
        made, true = (torch.stack([means(getattr(views, light), views.seen) for views in found])
                      for light in ("output", "target"))
        amount, expected = (x.mean(dim=1).clamp(min=DARK).log2() for x in (made, true))
        colours = torch.corrcoef(torch.stack([(x / x.sum(dim=1, keepdim=True).clamp(min=DARK)).flatten()
                                              for x in (made, true)]))[0, 1]
        print(f"{path.parent.name:24} {len(found):6} {errors[0]:6.3f} {errors[1]:6.3f} {errors[2]:7.4f} "
              f"{expected.std():7.2f} {(amount - expected).square().mean().sqrt():6.2f} {colours:8.2f}")


def seen_by(network: Network, batch: dict[str, Tensor]) -> Views | None:
    """What the network makes of a pair; None where it shows little, or nothing that is lit."""
    if batch["seen"].mean() <= LEAST_SEEN or batch["target"].max() <= 0:
        return None
    output, warped = network(**tensors_of(batch, "current")), None
    if "ratio" in batch:
        warped = warp(network(**tensors_of(batch, "previous")) * batch["ratio"], batch["motion"])
    return Views(output, batch["target"], warped, batch["seen"], batch.get("visible"))


def judged(views: Views) -> list[float]:
    """SSIM, L1, change; no number for the last where no frame before is drawn."""
    a, b = toned(views)
    errors = [float(mean_where(values, views.seen)) for values in (ssim_map(a, b), (a - b).abs())]
    if views.warped is None or views.visible is None:
        return [*errors, float("nan")]
    return [*errors, float(mean_where((a - tone(views.warped)).abs(), views.seen * views.visible))]


def means(light: Tensor, seen: Tensor) -> Tensor:
    """Mean light of each colour, shape (3,)."""
    return (light * seen).sum(dim=(0, 2, 3)) / seen.sum()


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
