"""Networks that return what they must not.

Rows "exponential head overflows" and "fireflies" of the table of hazards. Networks with an exponential head have tests
of their own where they are made; here the renderer's guards are tested with tiny networks of that kind.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import ModelError
from app.network.channels import HALF_MAX
from app.network.selection import find_model
from app.network.session import Network
from app.radiance_scale import radiance_scale
from app.renderer import Renderer
from app.scene import Camera
from app.settings import Settings
from tests.gl.scenes import draw
from tests.override import override
from tests.robustness.networks import Node, constant, write_network
from tests.robustness.scenes import CAMERA, LAMP, SIZE, beyond, lit_corner
from tests.tiny_network import write_tiny_network

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

PICTURES = ("final", "direct", "indirect", "albedo", "depth")
SKY = Camera((0.0, 1.5, 1.0), (0.0, 5.0, 1.1))


@pytest.mark.parametrize("value", [np.nan, -np.inf, -100.0])
def test_nan_and_less_than_nothing_count_as_no_light(value: float, tmp_path: Path) -> None:
    """The picture is that of direct light alone, to the bit."""
    images = draw(lit_corner(), SIZE, PICTURES, model=constant(tmp_path / "net.onnx", value))
    assert not images["indirect"].any()
    np.testing.assert_array_equal(images["final"], draw(lit_corner(), SIZE)["final"])


@pytest.mark.parametrize("value", [np.inf, 1e30])
def test_infinite_light_is_the_most_that_the_range_holds(value: float, tmp_path: Path) -> None:
    """Times the frame's exposure, on every surface the same, never on the sky."""
    images = draw(lit_corner(), SIZE, PICTURES, model=constant(tmp_path / "net.onnx", value))
    most = draw(lit_corner(), SIZE, PICTURES, model=constant(tmp_path / "most.onnx", HALF_MAX))
    seen = images["depth"][..., 0] > 0
    assert images["indirect"][seen].min() > 0.999 * images["indirect"].max() > 100
    for name in PICTURES:
        np.testing.assert_array_equal(images[name], most[name], name)
    assert images["final"].max() <= HALF_MAX / radiance_scale(lit_corner())
    assert not images["final"][~seen].any()


def test_a_network_that_breaks_leaves_no_trace_in_history(tmp_path: Path) -> None:
    """Three frames of NaN and Infinity from it, and the direct light stays what it is."""
    for value in (np.nan, -100.0):
        path = constant(tmp_path / "net.onnx", value)
        with (Renderer(lit_corner(), Settings(size=SIZE, provider="cpu"), path) as odd,
              Renderer(lit_corner(), Settings(size=SIZE, provider="cpu")) as plain):
            for _ in range(3):
                np.testing.assert_array_equal(odd.render(CAMERA)["final"], plain.render(CAMERA)["final"])


def test_another_shape_at_the_second_frame_is_one_line_and_the_renderer_goes_on(tmp_path: Path) -> None:
    """The network returns what was agreed as long as its first input is 0: over the sky."""
    path = write_tiny_network(tmp_path / "net.onnx", output_width="first")
    bright_corner = Camera((0.0, 1.2, 0.3), (0.0, 0.0, 0.0))
    with Renderer(lit_corner(), Settings(size=SIZE, provider="cpu"), path) as renderer:
        first = renderer.render(SKY)["final"]
        with pytest.raises(ModelError, match=r"has the shape \[1, 3, .*expected \[1, 3, "):
            renderer.render(bright_corner)
        renderer.cut()
        np.testing.assert_array_equal(renderer.render(SKY)["final"], first)


def head(*nodes: Node) -> list[Node]:
    """An exponential head: the logit is 40 times the light, 1 in the mean."""
    return [("Mul", ["light", "forty"], "logit"), *nodes]


CLAMPED = head(("Min", ["logit", "most"], "held"), ("Exp", ["held"], "y"))
FREE = head(("Exp", ["logit"], "y"))


@pytest.mark.parametrize("factor", [1e-6, 1e6])
@pytest.mark.parametrize("nodes", [CLAMPED, FREE], ids=["clamped", "overflows"])
def test_an_exponential_head_follows_the_exposure(factor: float, nodes: list[Node], tmp_path: Path) -> None:
    """Row "exponential head": f(a x) = a f(x) for light of 1e-6 and 1e6, where it overflows too."""
    path = write_network(tmp_path / "net.onnx", *nodes, forty=40.0, most=5.0)
    lamp = replace(LAMP, intensity=tuple(c * factor for c in LAMP.intensity))
    one, many = (draw(lit_corner(light), SIZE, PICTURES, model=path) for light in (LAMP, lamp))
    for name in ("final", "indirect"):
        assert one[name].max() > 0.01 and np.isfinite(many[name]).all()
        assert beyond(many[name] / np.float32(factor), one[name], 0.01) == 0, name


def test_an_overflow_in_half_precision_ends_at_the_range(tmp_path: Path) -> None:
    """exp(12) is more than a half holds, exp(10) is not."""
    light = np.full((3, 6, 8), 0.5, np.float32)
    x = {"x": np.concatenate([light, np.ones_like(light)])}
    found = {}
    for power in (10.0, 12.0):
        nodes: list[Node] = [("Mul", ["light", "power"], "logit"), ("Exp", ["logit"], "y")]
        path = write_network(tmp_path / "net.onnx", *nodes, dtype="float16", power=power)
        found[power] = Network(path, (8, 6), "cpu").run(x)["indirect.rgb"]
    np.testing.assert_allclose(found[10.0], 0.5 * np.exp(10.0), rtol=2e-2)
    np.testing.assert_allclose(found[12.0], 0.5 * HALF_MAX, rtol=1e-3)


def firefly(image: np.ndarray) -> np.ndarray:
    """One texel of 1e5 that stands for one of the network's."""
    image = image.astype(np.float32)
    image[24, 30] = 1e5
    return image


@pytest.mark.parametrize("model", ["gather", "radiosity"])
def test_a_firefly_darkens_nothing_and_makes_no_energy(model: str) -> None:
    """Row "fireflies": it lights its surroundings like any bright patch, on average by no more than itself."""
    settings = Settings(size=SIZE, outputs=("indirect", "depth"), taa=False, provider="cpu")
    with Renderer(lit_corner(), settings, find_model(model)) as renderer:
        clean = renderer.render(CAMERA)["indirect"]
        override(renderer, "direct", firefly)
        spoiled = renderer.render(CAMERA)
        override(renderer, "direct", None)
        np.testing.assert_array_equal(renderer.render(CAMERA)["indirect"], clean)
        texels = renderer.resource("tensor_screen").shape[1:]
    seen = spoiled["depth"][..., 0] > 0
    assert (spoiled["indirect"] >= 0.95 * clean).all()
    assert 0.01 < spoiled["indirect"][seen].mean() < HALF_MAX / np.prod(texels) / seen.mean()


def test_a_firefly_fades() -> None:
    """In the frame after, history counts as at most four times what is now; from then on it fades as 1/n."""
    settings = Settings(size=SIZE, outputs=("final", "indirect"), provider="cpu")
    before, since = 8, 30  # frames
    with Renderer(lit_corner(), settings, find_model("radiosity")) as renderer:
        for _ in range(before):
            clean = renderer.render(CAMERA)
        override(renderer, "direct", firefly)
        spoiled = renderer.render(CAMERA)
        override(renderer, "direct", None)
        assert spoiled["indirect"].mean() > 100 * clean["indirect"].mean()
        after = [renderer.render(CAMERA) for _ in range(since)]
    for name in ("final", "indirect"):
        assert after[0][name].max() < 5 * clean[name].max(), name
        assert after[-1][name].mean() < 1.05 * (1 + 3 * before / (before + since)) * clean[name].mean(), name
