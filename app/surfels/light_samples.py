"""The mean direct light of surfels, from that of their light samples."""

import numpy as np

from app.arrays import F32
from app.surfels.world import WorldSurfels


def mean_light(samples: F32, world: WorldSurfels) -> F32:
    """Irradiance / π of each surfel, shape (S, 3): the mean over its light samples, without that of the environment.

    Parameters
    ----------
    samples : ndarray, float32, shape (N, 3)
        Irradiance / π at the light samples, which come first.
    """
    samples = samples[:len(world.light_sample_surfel)]
    count = np.maximum(np.bincount(world.light_sample_surfel, minlength=world.count), 1)
    return np.stack([np.bincount(world.light_sample_surfel, samples[:, c], world.count) / count for c in range(3)],
                    axis=1).astype(np.float32)
