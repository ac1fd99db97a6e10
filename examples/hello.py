"""A picture of a trimesh object; without any light of its own it is shown in a studio."""

from pathlib import Path

import afterglow
import trimesh


def main(out: Path = Path(), size: tuple[int, int] = (640, 480)) -> None:
    scene = afterglow.Scene()
    scene.add(trimesh.creation.torus(0.5, 0.2), afterglow.Material(albedo=(0.7, 0.3, 0.1)), smooth=True)
    with afterglow.Renderer(scene, size) as renderer:
        renderer.render().save(out / "hello.png")


if __name__ == "__main__":
    main()
