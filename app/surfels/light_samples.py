"""The mean direct light of surfels, from what was drawn at their light samples."""

import numpy as np

from app.arrays import F32
from app.surfels.world import WorldSurfels


def mean_light(texels: F32, world: WorldSurfels) -> F32:
    """Irradiance / π of each surfel, shape (S, 3): the mean over its light samples, without that of the environment.

    Parameters
    ----------
    texels : ndarray, float32, shape (H, W, 4)
        Bottom row first: a quad for each light sample.
    """
    quads = (texels[::2, ::2] + texels[::2, 1::2] + texels[1::2, ::2] + texels[1::2, 1::2]) / 4
    samples = quads.reshape(-1, 4)[:len(world.light_sample_surfel)]
    count = np.maximum(np.bincount(world.light_sample_surfel, minlength=world.count), 1)
    return np.stack([np.bincount(world.light_sample_surfel, samples[:, c], world.count) / count for c in range(3)],
                    axis=1).astype(np.float32)
