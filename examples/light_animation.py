"""A light that fades and a box that turns, as a video."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import afterglow
import trimesh


def draw(renderer: afterglow.Renderer, frames: int) -> Iterator[afterglow.Frame]:
    scene = renderer.scene
    lamp = scene.lights[0]
    times = [index / 30 for index in range(frames)]
    for index, frame in enumerate(renderer.render_video([None] * frames, times)):
        yield frame
        turn = 2 * math.pi * (index + 1) / frames
        scene["box"].transform = trimesh.transformations.rotation_matrix(turn, (0, 1, 0))
        scene.lights[0] = replace(lamp, intensity=tuple(i * (0.6 + 0.4 * math.cos(turn)) for i in lamp.intensity))


def main(out: Path = Path(), size: tuple[int, int] = (320, 240), frames: int = 60) -> None:
    scene = afterglow.Scene()
    scene.add(trimesh.creation.box((4, 0.1, 4)), transform=trimesh.transformations.translation_matrix((0, -0.5, 0)))
    scene.add(trimesh.creation.box((0.8, 0.8, 0.8)), afterglow.Material(albedo=(0.2, 0.4, 0.8)), name="box")
    scene.lights.append(afterglow.PointLight((1.0, 2.0, 1.5), (12.0, 11.0, 9.0), radius=0.1))
    with afterglow.Renderer(scene, size) as renderer:
        afterglow.write_video(out / "light_animation.mp4", draw(renderer, frames))


if __name__ == "__main__":
    main()
