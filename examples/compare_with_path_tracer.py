"""How far two models are from the path tracer; needs the extras ``evaluation`` and ``export``."""

from pathlib import Path

import afterglow


def main(out: Path = Path(), size: tuple[int, int] = (256, 192), spp: int = 64) -> None:
    reference = afterglow.path_trace(size=size, spp=spp)["final"]
    for model in (None, "ember"):
        with afterglow.Renderer(afterglow.load(), size, model) as renderer:
            frame = renderer.render()
        frame.save(out / f"{model or 'direct'}.png")
        errors = afterglow.compare(frame, reference)
        print(model or "direct light only", ", ".join(f"{name} {value:.3g}" for name, value in errors.items()))


if __name__ == "__main__":
    main()
