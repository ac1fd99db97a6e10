"""Closed white rooms, bounce by bounce: every model that takes a number of them against the geometric series.

``./test.sh -n 0 -m gl -s tests/gl/test_bounces.py`` prints the table of docs/accuracy.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.errors import SettingsError
from app.load import embedded_scene
from app.network.bounces import with_bounces
from app.network.channels import ALL_BOUNCES
from app.network.selection import bundled_models, find_model
from app.network.session import Network
from app.renderer import Renderer
from app.scene import Camera, Material, PointLight, Scene
from tests.gl.scenes import box, make_scene
from tests.gl.test_indirect import WALLS, mean_around
from tests.override import override

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

RHO = 0.9
INTENSITY = 100.0
BOUNCES = range(1, 9)
ROUNDING = 2.0**-11  # of half floats, relative
ROOMS = {  # size, lamp, eye
    "lamp aside": ((40, 30, 40), (12, 22, 17), (24, 12, 30)),
    "lamp in the middle": ((40, 30, 40), (20, 15, 20), (20, 15, 20)),
    "long and low": ((80, 20, 40), (20, 12, 20), (50, 10, 20)),
}
COUNTING = ("ember", "radiosity")
NETWORKS = (*COUNTING, "gather", "bcnn-8-single")  # all that take a number, gather only 1; and one in half precision


def series(bounces: int) -> float:
    """1 + ρ + … + ρᴺ⁻¹"""
    return sum(RHO**k for k in range(bounces))


def renderers(scene: Scene, name: str) -> Iterator[tuple[int, Renderer]]:
    """A renderer for each number; networks that count are told by their tensor, so that surfels are made once."""
    if name not in COUNTING:
        for bounces in BOUNCES if name != "gather" else [1]:
            with Renderer(scene, replace(WALLS, bounces=bounces), find_model(name)) as renderer:
                yield bounces, renderer
        return
    with Renderer(scene, WALLS, find_model(name)) as renderer:
        for bounces in BOUNCES:
            override(renderer, "tensor_bounces", bounces)
            yield bounces, renderer


def test_these_are_all_networks_that_take_a_number() -> None:
    taking = []
    for name, file in bundled_models().items():
        network = Network(file, (8, 8), "cpu")
        with suppress(SettingsError):
            if not network.contract.shades_environment:  # no indirect light
                with_bounces(network, 1)
                taking.append(name)
    assert sorted(taking) == sorted([*NETWORKS, "bcnn-8-single-half"])


def lit(room: str, *names: str, marks: Sequence[pytest.MarkDecorator] = ()) -> list[Any]:
    return [pytest.param(name, room, marks=marks) for name in names]


@pytest.mark.parametrize(("name", "room"), [
    *lit("lamp aside", *NETWORKS),
    *lit("lamp in the middle", "ember", "bcnn-8-single", marks=[pytest.mark.long]),
    *lit("lamp in the middle", "radiosity", marks=[pytest.mark.long, pytest.mark.xfail(reason=(
        "one bounce is 0.4 % above"))]),
    *lit("long and low", *COUNTING, "bcnn-8-single", marks=[pytest.mark.long]),
])
def test_a_lit_white_room_never_has_more_light_than_the_series(name: str, room: str) -> None:
    """All flux Φ lands on the walls, and so does what they reflect: the mean is Φ/A (ρ + … + ρᴺ)."""
    (x, y, z), lamp, eye = ROOMS[room]
    scene = make_scene([box((0, 0, 0), (x, y, z), Material(albedo=(RHO,) * 3))], [PointLight(lamp, (INTENSITY,) * 3)])
    irradiance = 4 * np.pi * INTENSITY / (2 * (x * y + y * z + z * x)) / np.pi
    means = {bounces: mean_around(renderer, eye) for bounces, renderer in renderers(scene, name)}
    found = np.array(list(means.values()))
    share = found / [irradiance * RHO * series(bounces) for bounces in means]
    print(f"WHITE ROOM {name}, {room}: " + " ".join(f"{s:.3f}" for s in share))
    assert (np.diff(found) > 0).all()
    assert (share >= 0.7).all()
    assert (share <= 1.0).all()


@pytest.mark.parametrize("name", COUNTING)
def test_a_glowing_white_room_never_has_more_light_than_the_series(name: str) -> None:
    """Every wall sends 1, of which each bounce brings ρ times as much as the one before: to every pixel the same."""
    scene = make_scene([box((0, 0, 0), (40, 30, 40), Material(albedo=(RHO,) * 3, emission=(1.0,) * 3))])
    camera = Camera((20, 15, 35), (20, 15, 0), fov_y_deg=60)
    for bounces, renderer in renderers(scene, name):
        share = renderer.render(camera)["indirect"] / series(bounces)
        print(f"GLOWING ROOM {name} {bounces}: mean {share.mean():.4f}, {share.min():.4f} to {share.max():.4f}")
        assert share.max() <= 1 + ROUNDING
        assert 0.9 <= share.mean() <= 1 + ROUNDING


@pytest.mark.usefixtures("path_tracer")
def test_the_path_tracer_counts_alike() -> None:
    """In the Cornell box, where nothing glows that is no light: what the tracer calls one bounce is one."""
    from export.reference.path_tracer import PathTracer
    from export.reference.still import Still
    from export.reference.trace import mean_samples

    scene, size = embedded_scene(), (128, 96)
    still = Still(scene, scene.cameras[scene.default_camera].at(0.0), size)
    with Renderer(scene, replace(WALLS, size=size), find_model("ember")) as renderer:
        for bounces in (1, 2, 4):
            override(renderer, "tensor_bounces", bounces)
            found = renderer.render(still.camera)["indirect"].mean()
            reference = mean_samples(PathTracer(scene, max_bounces=bounces), still, 32)["indirect"].mean()
            print(f"TRACED {bounces}: {found / reference - 1:+.2%}")
            assert found == pytest.approx(reference, rel=0.05)


def drawn(name: str, bounces: int | None) -> Renderer:
    walls = box((0, 0, 0), (4, 3, 4), Material(albedo=(RHO,) * 3))
    renderer = Renderer(make_scene([walls], [PointLight((2, 2, 2), (1.0,) * 3)]),
                        replace(WALLS, size=(32, 24), bounces=bounces), find_model(name))
    renderer.advance(Camera((2, 1, 3), (2, 1, 0)))
    return renderer


@pytest.mark.parametrize(("bounces", "expected"), [(None, ALL_BOUNCES), (1, 1), (5, 5)])
def test_the_number_reaches_a_network_that_counts(bounces: int | None, expected: float) -> None:
    with drawn("radiosity", bounces) as renderer:
        np.testing.assert_array_equal(renderer.resource("tensor_bounces"), [expected])


@pytest.mark.parametrize(("bounces", "packed"), [(None, False), (1, False), (2, True)])
def test_albedo_is_packed_only_for_a_network_that_is_applied_again(bounces: int | None, packed: bool) -> None:
    with drawn("bcnn-8-single", bounces) as renderer:
        assert ("tensor_bounces.albedo" in renderer.plan.resources) == packed
        assert renderer.plan.culled["pack_globals"] == "the network reads no globals"
        if packed:
            np.testing.assert_allclose(renderer.resource("tensor_bounces.albedo"), RHO, rtol=2e-3)
