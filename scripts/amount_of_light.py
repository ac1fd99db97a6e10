"""How much of the amount of indirect light can be told from the screen?

    python scripts/amount_of_light.py DATASET [NETWORK.onnx]

In stops: the spread of the frames' mean indirect light, in means of direct light, and what is left of it when it is
predicted from what the frame's direct light, normals and positions are like: shares of lit texels, percentiles, means
and spreads; by ridge regression, cross-validated over scenes. With a network that reads what BCNN reads, also its
error on the held-out tenth, beside that of this prediction. BCNN must have been trained on DATASET before.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from export.dataset import Dataset
from export.dataset.plan import plan
from export.models import make_network
from export.training.config import held_out
from export.training.examples import Examples, examples_for

F32 = NDArray[np.float32]
FOLDS = 8
RIDGE = 100.0      # on standardised features
LEAST_SEEN = 0.3   # share of texels with a surface
DARK = 1e-3        # means


def main(folder: Path, network: Path | None) -> None:
    contract = make_network("bcnn-8").contract
    dataset = Dataset(folder)
    examples = examples_for(dataset, contract, previous=False)
    if examples.missing:
        sys.exit(f"{len(examples.missing)} pairs are not drawn yet; train bcnn-8 on {folder}, which draws them")
    batches = ((i, examples.batch([i])) for i in range(len(examples)))
    rows = [(i, *described(b["current.x"][0].numpy(), b["target"][0].numpy(), b["seen"][0, 0].numpy() > 0))
            for i, b in batches if b["seen"].mean() > LEAST_SEEN and b["target"].max() > 0]
    index, stops = np.array([i for i, _, _ in rows]), np.array([y for _, _, y in rows])
    features = np.array([f for _, f, _ in rows])
    firsts = [group.first for group in plan(dataset.config, len(dataset))]
    fold = (np.searchsorted(firsts, index, side="right") - 1) % FOLDS
    found = np.zeros_like(stops)
    for k in range(FOLDS):
        found[fold == k] = predicted(features[fold != k], stops[fold != k], features[fold == k])
    print(f"{len(rows)} frames: spread {stops.std():.2f} stops, left {rms(found - stops):.2f}, "
          f"correlation {np.corrcoef(found, stops)[0, 1]:.2f}")
    held = index >= held_out(len(examples)).start
    told = predicted(features[~held], stops[~held], features[held])
    print(f"{held.sum()} held out: spread {stops[held].std():.2f}, left {rms(told - stops[held]):.2f}, "
          f"correlation {np.corrcoef(told, stops[held])[0, 1]:.2f}")
    if network is not None:
        session = ort.InferenceSession(network, providers=["CPUExecutionProvider"])
        made = np.array([amount(session, examples, i) for i in index[held].tolist()])
        print(f"{network.stem}: spread {made.std():.2f}, error {rms(made - stops[held]):.2f}, "
              f"correlation {np.corrcoef(made, stops[held])[0, 1]:.2f}")


def described(x: F32, target: F32, seen: NDArray[np.bool_]) -> tuple[list[float], float]:
    """Features of a frame's inputs [9, h, w], and log2 of its mean indirect light."""
    light, normal, position = x[:3][:, seen], x[3:6][:, seen], x[6:9][:, seen]
    grey = light.mean(axis=0)
    shares = [float(seen.mean()), *((grey > level).mean() for level in (0.05, 0.5, 2.0))]
    percentiles = np.log2(np.percentile(grey, [10, 25, 50, 75, 90, 95, 99, 100]) + DARK)
    places = [f(v, axis=1) for v in (normal, position) for f in (np.mean, np.std)]
    features = [*shares, *percentiles, *np.log2(light.mean(axis=1) + DARK), *np.concatenate(places)]
    return features, stops_of(target, seen)


def stops_of(light: F32, seen: NDArray[np.bool_]) -> float:
    return float(np.log2(max(float(light[:, seen].mean()), DARK)))


def predicted(known: NDArray[np.float64], stops: NDArray[np.float64],
              asked: NDArray[np.float64]) -> NDArray[np.float64]:
    mean, spread = known.mean(axis=0), known.std(axis=0) + 1e-6
    a, b = (known - mean) / spread, (asked - mean) / spread
    weights = np.linalg.solve(a.T @ a + RIDGE * np.eye(a.shape[1]), a.T @ (stops - stops.mean()))
    return np.asarray(b @ weights + stops.mean())


def amount(session: ort.InferenceSession, examples: Examples, index: int) -> float:
    batch = examples.batch([index])
    made = session.run(None, {"x": batch["current.x"].numpy()})[0][0]
    return stops_of(made, batch["seen"][0, 0].numpy() > 0)


def rms(error: NDArray[np.float64]) -> float:
    return float(np.sqrt((error**2).mean()))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
