"""How near do surrounding-aware networks come to the light maps of the pairs that none of them was trained on?

    python scripts/light_maps.py DATASET CHECKPOINT…

For each checkpoint of `python -m export train`: mean PSNR of the light map, direct and indirect light without albedo on
Tanh's scale, where the screen shows surfaces; its difference from the first checkpoint's, with the standard error over
groups of pairs, since the pairs of a group show one scene; and in how many pairs it is the better.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import torch  # noqa: E402
from torch import Tensor  # noqa: E402

from export.dataset import Dataset  # noqa: E402
from export.dataset.plan import plan  # noqa: E402
from export.losses import Views  # noqa: E402
from export.losses.surround import light_maps  # noqa: E402
from export.losses.views import mean_where  # noqa: E402
from export.models.surround import Surround  # noqa: E402
from export.training.examples import Examples, tensors_of  # noqa: E402
from export.training.state import load  # noqa: E402

LEAST_SEEN = 0.3   # share of texels with a surface
RANGE = 2.0        # of Tanh


@torch.no_grad()
def main(folder: Path, paths: list[Path]) -> None:
    checkpoints = [load(path) for path in paths]
    dataset = Dataset(folder)
    share = min(checkpoint.config.data.validation for checkpoint in checkpoints)
    others = len(dataset) - max(1, round(share * len(dataset)))
    scenes = [group for group in plan(dataset.config, len(dataset)) if group.first + group.pairs > others]
    first = None
    print(f"{'':24} {'pairs':>6} {'PSNR':>7} {'gain':>7} {'± 1 σ':>6} {'better':>7}")
    for path, checkpoint in zip(paths, checkpoints, strict=True):
        network = checkpoint.network()
        if not isinstance(network, Surround):
            sys.exit(f"{path} holds {checkpoint.config.network.preset}, expected a surrounding-aware network")
        examples = Examples(dataset, network.contract, previous=False)
        if examples.missing:
            sys.exit(f"{len(examples.missing)} pairs are not drawn yet for {path}; train on {folder}, which draws them")
        found = torch.tensor([psnr(network, examples.batch([i])) for i in range(others, len(dataset))])
        first = found if first is None else first
        gain = found - first
        seen = ~gain.isnan()
        groups = torch.stack([gain[max(0, g.first - others):g.first - others + g.pairs].nanmean() for g in scenes])
        groups = groups[~groups.isnan()]
        error = f"{groups.std() / len(groups)**0.5:.2f}" if len(groups) > 1 else "–"
        print(f"{path.parent.name:24} {int(seen.sum()):6} {found[seen].mean():7.2f} {gain[seen].mean():+7.2f} "
              f"{error:>6} {int((gain[seen] > 0).sum()):7}")


def psnr(network: Surround, batch: dict[str, Tensor]) -> float:
    """Of one pair, in decibels; NaN where it shows little."""
    if batch["seen"].mean() <= LEAST_SEEN:
        return float("nan")
    tensors = tensors_of(batch, "current")
    views = Views(network(**tensors), batch["target"], None, batch["seen"], None,
                  network.condition(**tensors))
    made, true = light_maps(views)
    return float(10 * torch.log10(RANGE**2 / mean_where((made - true).square(), views.seen)))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
