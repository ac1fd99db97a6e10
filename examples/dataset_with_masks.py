"""Pictures of a room from random places, with masks of its objects, depth, normals and the cameras in the EXR files."""

from dataclasses import replace
from pathlib import Path

import afterglow
import numpy as np


def main(out: Path = Path(), size: tuple[int, int] = (320, 240), count: int = 8) -> None:
    rng = np.random.default_rng(0)
    scene = afterglow.load()
    base = next(iter(scene.cameras.values())).at(0.0)
    reach = 0.05 * np.linalg.norm(np.subtract(base.target, base.eye))
    cameras = [replace(base, eye=tuple(base.eye + reach * rng.normal(size=3))) for _ in range(count)]
    with afterglow.Renderer(scene, size, outputs=("final", "instance", "depth", "normal")) as renderer:
        for index, frame in enumerate(renderer.render_batch(cameras)):
            frame.save(out / f"{index:04d}.exr")
            for number in np.unique(frame["instance"][frame["instance"] > 0]):
                share = (frame["instance"] == number).mean()
                print(f"{index:04d}: {frame.instances[number - 1]} covers {share:.1%}")


if __name__ == "__main__":
    main()
