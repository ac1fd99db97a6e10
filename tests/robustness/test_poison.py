"""NaN, infinities and -100 into each pass in turn: the picture stays finite and bounded, and heals.

Radiance is held to 65504 on the GPU, where lights are scaled, so a picture is bounded by 65504 / scale.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from app.golden.scenes import dusk, glass, materials, mirrors, outdoor, room
from app.network.channels import HALF_MAX
from app.network.selection import Model, find_model
from app.passes import gather_turns, shadow_rays
from app.radiance_scale import radiance_scale
from app.renderer import JITTER_PERIOD, Renderer
from app.scene import Camera, CameraPath, RectLight, Scene
from app.settings import Settings
from tests.coarse_shadows import coarse_shadow_maps
from tests.override import is_overridden, override

pytestmark = pytest.mark.gl

POISONS = {"nan": np.nan, "+inf": np.inf, "-inf": -np.inf, "-100": -100.0}
SIZE = (61, 47)
FIRST_SAMPLES = 8  # of what rays gather in a frame without history: one of 64 takes several times as long
POISONED, FADING = 2, 2  # frames: the second one has a history
HEALING = JITTER_PERIOD  # frames, so that the healed picture averages the same samples as the clean one


def materials_from_above() -> Scene:
    """Without sky in the picture, and without traced shadows, whose filter would spread what a texel holds."""
    scene = materials()
    lights = tuple(light for light in scene.lights if not isinstance(light, RectLight))
    above = CameraPath.still(Camera((1.4, 2.4, 1.0), (0.2, 0.1, 0.0), fov_y_deg=34.0))
    return replace(scene, lights=lights, environment=None, cameras={"main": above})


def glass_in_lamplight() -> Scene:
    """Without an environment, whose traced shadows would spread what a texel holds."""
    return replace(glass(), environment=None)


MIRRORS = "mirrors"  # of the scenes, the one with reflections: they show a texel at other places
SCENES = {"room": (room(), "ember"), "gathered": (room(), "final-gather"),
          "outdoor": (outdoor(), "radiosity"), "screen space": (room(), "ssgi"), "sky": (dusk(), "ember"),
          MIRRORS: (mirrors(), "ember"), "materials": (materials_from_above(), "ssgi"),
          "glass": (glass_in_lamplight(), "ssgi")}
G_BUFFER = ("albedo", "normal", "depth", "emission", "specular_roughness", "motion", "occlusion", "clearcoat",
            "sheen")
PER_TEXEL = (*G_BUFFER, "direct", "specular", "indirect", "lit")
REACH = 2                  # texels: a quad, or what filters around it
AT = (17, 17)              # row and column of the one poisoned texel; no low-resolution texel looks there
SEEN = (24, 22)            # a texel that stands for one of the low resolution

Image = NDArray[Any]


class Patient:
    """A renderer with a still camera, and what it draws when nobody poisons it."""

    def __init__(self, scene: Scene, model: Model, reflections: bool) -> None:
        settings = Settings(size=SIZE, outputs=("final", "position"), reflections=reflections)
        self.renderer = Renderer(scene, settings, model)
        self.camera = scene.cameras[scene.default_camera].at(0.0)
        self.bound = HALF_MAX / radiance_scale(scene)
        self.resources = [r for r in self.renderer.plan.resources if r != "display"]
        self.clean = self.draw(POISONED + HEALING)

    def draw(self, frames: int) -> list[Image]:
        """The final images of that many frames from a cut."""
        self.renderer.cut()
        return self.more(frames)

    def more(self, frames: int) -> list[Image]:
        images = [self.renderer.render(self.camera)["final"] for _ in range(frames)]
        for final in images:
            # Otherwise the final image is the poison itself, or what becomes of it.
            if not any(is_overridden(self.renderer, name) for name in ("taa", "sharpened")):
                assert np.isfinite(final).all()
                assert final.min() >= 0
                assert final.max() <= self.bound
        return images

    def poison(self, resources: tuple[str, ...], value: float | Callable[[Image], Image],
               texel: tuple[int, int] | None = None) -> None:
        """All texels, or one by row and column."""
        def one(image: Image) -> Image:
            image = image.astype(np.float32)
            image[texel] = value
            return image

        for resource in resources:
            override(self.renderer, resource, value if texel is None else one)

    def cure(self, resources: tuple[str, ...]) -> None:
        for resource in resources:
            override(self.renderer, resource, None)


def halves(first: float, second: float) -> Callable[[Image], Image]:
    """One in each half along the longest axis: ``inf`` and ``-inf`` make sums over channels infinite too."""
    def poisoned(image: Image) -> Image:
        axis = int(np.argmax(image.shape))
        return np.where(np.indices(image.shape)[axis] < (image.shape[axis] + 1) // 2, first, second)

    return poisoned


@contextmanager
def few_first_samples() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for module in (shadow_rays, gather_turns):
            patch.setattr(module, "RAYS", replace(module.RAYS, max_first_samples=FIRST_SAMPLES))
        yield


@pytest.fixture(scope="module", params=SCENES)
def patient(request: pytest.FixtureRequest, small_ember: Path) -> Iterator[Patient]:
    scene, model = SCENES[request.param]
    with few_first_samples():
        with coarse_shadow_maps():
            patient = Patient(scene, small_ember if model == "ember" else find_model(model),
                              reflections=request.param == MIRRORS)
        yield patient
        patient.renderer.close()


def bounded_and_healing(patient: Patient, resources: tuple[str, ...],
                        value: float | Callable[[Image], Image]) -> None:
    patient.poison(resources, value)
    try:
        patient.draw(POISONED)
    finally:
        patient.cure(resources)
    np.testing.assert_array_less(patient.more(FADING)[-1], 2 * patient.clean[FADING].max())


def has_recovered(patient: Patient) -> None:
    """Nothing is left of any poison after a cut."""
    np.testing.assert_array_equal(patient.draw(1)[0], patient.clean[0])


IN_HALVES = pytest.mark.parametrize("value", [halves(np.nan, -100.0), halves(np.inf, -np.inf)],
                                    ids=["nan and -100", "infinities"])


@IN_HALVES
def test_every_resource(patient: Patient, value: Callable[[Image], Image]) -> None:
    failures = {}
    for resource in patient.resources:
        try:
            bounded_and_healing(patient, (resource,), value)
        except AssertionError as error:
            failures[resource] = error
    assert not failures
    has_recovered(patient)


@pytest.mark.parametrize("poison", ["-inf", "-100"])  # the second halves, which a single number has not
def test_every_single_number(patient: Patient, poison: str) -> None:
    for resource in patient.resources:
        if patient.renderer.resource(resource).size == 1:
            bounded_and_healing(patient, (resource,), POISONS[poison])
    has_recovered(patient)


@pytest.mark.parametrize("poison", POISONS)
def test_the_whole_g_buffer(patient: Patient, poison: str) -> None:
    bounded_and_healing(patient, G_BUFFER, POISONS[poison])
    has_recovered(patient)


@IN_HALVES
def test_history_heals_without_a_cut(patient: Patient, value: Callable[[Image], Image]) -> None:
    everything = tuple(patient.resources)
    patient.poison(everything, value)
    patient.draw(POISONED)
    patient.cure(everything)
    healed, clean = patient.more(HEALING)[-1], patient.clean[-1]
    # Where colours differ a lot around a texel, poisoned frames fade about as 1/n, like any other sample.
    assert np.abs(healed - clean).max() <= 0.07 * clean.max()
    assert np.abs(healed - clean).mean() <= 0.01 * clean.mean()


def shows_others(patient: Patient) -> NDArray[np.bool_]:
    """Pixels whose glass shows other texels, refracted or blurred, and those around them; shape (H, W)."""
    layers = [patient.renderer.resource(r) for r in patient.resources if r.endswith("refraction")]
    shown: NDArray[np.bool_] = np.zeros(SIZE[::-1], np.bool_)
    for refraction in layers:
        shown |= (refraction[..., :3] != 0).any(axis=2)
    return ndimage.binary_dilation(shown, np.ones((3, 3)), iterations=POISONED + 1)


@pytest.mark.parametrize("poison", POISONS)
def test_a_texel_stays_in_its_neighbourhood(patient: Patient, poison: str) -> None:
    if patient.renderer.settings.reflections:
        pytest.skip("mirrors show what a texel holds elsewhere")
    height, width = SIZE[1], SIZE[0]
    rows, columns = np.indices((height, width))
    far = (np.maximum(abs(rows - AT[0]), abs(columns - AT[1])) > REACH) & ~shows_others(patient)
    spread = {}
    for resource in PER_TEXEL:
        patient.poison((resource,), POISONS[poison], AT)
        for drawn, clean in zip(patient.draw(POISONED), patient.clean, strict=False):
            differs = (drawn != clean).any(axis=2)
            if (differs & far).any():
                spread[resource] = int((differs & far).sum())
        patient.cure((resource,))
    assert not spread


@pytest.mark.parametrize("poison", POISONS)
def test_poisoned_history_heals_in_one_frame(patient: Patient, poison: str) -> None:
    patient.poison(("taa",), POISONS[poison])
    patient.draw(POISONED)
    patient.cure(("taa",))
    patient.more(1)
    np.testing.assert_array_equal(patient.renderer.resource("taa")[..., :3], patient.renderer.resource("lit")[..., :3])


@pytest.mark.parametrize("poison", ["nan", "+inf", "-inf"])
@pytest.mark.parametrize(("resource", "channels"), [("taa", [0, 1, 2]), ("motion", [0, 1]), ("motion", [2])],
                         ids=["light", "motion", "inverse_depth"])
def test_history_that_is_no_number_is_dropped(patient: Patient, poison: str, resource: str,
                                              channels: list[int]) -> None:
    """Even where all else about it, such as the number of frames gathered, is as it should be."""
    def broken(image: Image) -> Image:
        image = image.copy()
        image[..., channels] = POISONS[poison]
        return image

    patient.draw(POISONED)
    if resource == "motion" and "front_motion" in patient.resources:
        resource = "front_motion"  # what the history follows
    override(patient.renderer, resource, broken)
    patient.more(1)
    patient.cure((resource,))
    if resource == "taa":  # it is history in the next frame
        patient.renderer.render(patient.camera)
    surface = ndimage.binary_erosion(patient.renderer.resource("depth")[..., 0] > 0, iterations=4)
    found, lit = (patient.renderer.resource(name)[surface, :3] for name in ("taa", "lit"))
    np.testing.assert_array_equal(found, lit)


@pytest.mark.parametrize("length", [0.4, 2.1, 1e4])
def test_a_normal_far_from_unit_length_is_none(patient: Patient, length: float) -> None:
    """Whatever its direction is worth, it counts as no direction at all."""
    def drawn(factor: float) -> Image:
        override(patient.renderer, "normal", lambda image: image * np.array((*[factor] * 3, 1), np.float32))
        final = patient.draw(1)[0]
        override(patient.renderer, "normal", None)
        return final

    np.testing.assert_array_equal(drawn(length), drawn(0.0))


@pytest.mark.parametrize("poison", POISONS)
def test_a_texel_that_the_network_sees(patient: Patient, poison: str) -> None:
    for resource in ("albedo", "normal", "depth", "specular_roughness"):
        patient.poison((resource,), POISONS[poison], SEEN)
        change = np.abs(patient.draw(1)[0] - patient.clean[0]).max(axis=2)
        patient.cure((resource,))
        assert np.quantile(change, 0.99) <= 0.1 * patient.clean[0].max(), resource


def test_the_check_counts_what_is_not_finite() -> None:
    scene, model = SCENES["room"]
    camera = scene.cameras[scene.default_camera].at(0.0)
    with Renderer(scene, Settings(size=SIZE, check=True), find_model(model)) as renderer:
        renderer.render(camera)
        assert not any(_counts(renderer).values())
        override(renderer, "direct", np.nan)
        override(renderer, "indirect", np.inf)
        renderer.render(camera)
        found = {name: n for name, n in _counts(renderer).items() if n}
        assert found == dict.fromkeys(("direct", "upsample"), SIZE[0] * SIZE[1])


def _counts(renderer: Renderer) -> dict[str, int]:
    return {name: stats["non_finite"] for name, stats in renderer.timing()["passes"].items()}
