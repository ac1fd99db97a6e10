"""How near do surrounding-aware networks come to the light maps of the pairs that none of them was trained on?

    python scripts/light_maps.py DATASET CHECKPOINT…

For each checkpoint of `python -m export train`: mean PSNR of the light map, direct and indirect light without albedo on
Tanh's scale, where the screen shows surfaces; its difference from the first checkpoint's, with the standard error over
groups of pairs, since the pairs of a group show one scene; and in how many pairs it is the better.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import torch
from torch import Tensor

from export.dataset import Dataset
from export.dataset.plan import plan
from export.losses import Views
from export.losses.surround import light_maps
from export.losses.views import mean_where
from export.models.surround import Surround
from export.training.config import held_out
from export.training.examples import examples_for, tensors_of
from export.training.state import load

LEAST_SEEN = 0.3   # share of texels with a surface
RANGE = 2.0        # of Tanh


@torch.no_grad()
def main(folder: Path, paths: list[Path]) -> None:
    checkpoints = [load(path) for path in paths]
    dataset = Dataset(folder)
    held = held_out(len(dataset), min(checkpoint.config.data.validation for checkpoint in checkpoints))
    ends = [group.first + group.pairs for group in plan(dataset.config, len(dataset))]
    scenes = [end - held.start for end in ends if end > held.start]  # where each one's held-out pairs end
    first = None
    print(f"{'':24} {'pairs':>6} {'PSNR':>7} {'gain':>7} {'± 1 σ':>6} {'better':>7}")
    for path, checkpoint in zip(paths, checkpoints, strict=True):
        network = checkpoint.network()
        if not isinstance(network, Surround):
            sys.exit(f"{path} holds {checkpoint.config.network.preset}, expected a surrounding-aware network")
        examples = examples_for(dataset, network.contract, previous=False)
        if examples.missing:
            sys.exit(f"{len(examples.missing)} pairs are not drawn yet for {path}; train on {folder}, which draws them")
        found = torch.tensor([psnr(network, examples.batch([i])) for i in held])
        first = found if first is None else first
        gain = found - first
        seen = ~gain.isnan()
        groups = torch.stack([gain[at:end].nanmean() for at, end in pairwise([0, *scenes])])
        groups = groups[~groups.isnan()]
        error = f"{groups.std() / len(groups)**0.5:.2f}" if len(groups) > 1 else "–"
        print(f"{path.parent.name:24} {int(seen.sum()):6} {found[seen].mean():7.2f} {gain[seen].mean():+7.2f} "
              f"{error:>6} {int((gain[seen] > 0).sum()):7}")


def psnr(network: Surround, batch: dict[str, Tensor]) -> float:
    """Of one pair, in decibels; NaN where it shows little."""
    if batch["seen"].mean() <= LEAST_SEEN:
        return float("nan")
    tensors = tensors_of(batch, "current")
    views = Views(network(**tensors), batch["target"], None, batch["seen"], None, network.condition(**tensors))
    made, true = light_maps(views)
    return float(10 * torch.log10(RANGE**2 / mean_where((made - true).square(), views.seen)))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
