"""What nobody needs is neither run nor allocated."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Material, PointLight, Scene
from app.settings import Settings
from tests.gl.scenes import floor, make_scene
from tests.tiny_network import write_tiny_network

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

PLAIN = make_scene([floor(1.0)], [PointLight((0, 1, 0), (1.0,) * 3)])
SHINING = make_scene([floor(1.0, material=Material(emission=(1.0,) * 3))], [PointLight((0, 1, 0), (1.0,) * 3)])


def plan(scene: Scene, *outputs: str, model: Path | None = None, taa: bool = True) -> dict[str, tuple[str, ...]]:
    """Passes that run, with what each writes; every reason for the others is checked to be there."""
    settings = Settings(size=(32, 24), outputs=outputs or ("final",), taa=taa, provider="cpu")
    with Renderer(scene, settings, model) as renderer:
        images = renderer.render(scene.cameras["main"].at(0.0))
        assert set(images) == {*settings.outputs, *(("display",) if "final" in settings.outputs else ())}
        found = {p.name: p.writes for p in renderer.plan.passes}
        assert all(isinstance(why, str) and why for why in renderer.plan.culled.values())
        assert not set(found) & set(renderer.plan.culled)
        assert set(renderer.plan.resources) == {w for writes in found.values() for w in writes}
        return found


@pytest.mark.parametrize("model", ["none", "radiosity", "ember"])
def test_one_geometry_output_runs_one_pass_with_one_target(model: str) -> None:
    network = None if model == "none" else find_model(model)
    for name in ("normal", "albedo", "depth", "motion"):
        assert plan(SHINING, name, model=network) == {"gbuffer": (name,)}


def test_no_network_no_surround_view() -> None:
    found = plan(SHINING)
    assert not [name for name in found if name.startswith(("cube_", "pack_screen", "network", "upsample"))]
    assert "albedo" in found["gbuffer"]  # direct light needs it


def test_passes_are_culled_under_the_names_that_they_run_by() -> None:
    with Renderer(PLAIN, Settings(size=(32, 24), taa=False)) as renderer:
        culled = set(renderer.plan.culled)
    assert set(plan(PLAIN, model=find_model("gather"), taa=False)) - set(plan(PLAIN, taa=False)) <= culled
    assert set(plan(PLAIN, model=find_model("ember"), taa=False)) - set(plan(PLAIN, taa=False)) <= culled


def test_a_network_that_reads_no_cube_gets_none(tmp_path: Path) -> None:
    found = plan(PLAIN, model=write_tiny_network(tmp_path / "tiny.onnx"))
    assert "network" in found and "pack_screen" in found
    assert not [name for name in found if name.startswith("cube_")]


def test_a_network_that_reads_a_cube_gets_it() -> None:
    found = plan(PLAIN, model=find_model("gather"))
    assert {"cube_gbuffer", "cube_direct"} <= set(found)
    assert not any("specular_roughness" in w or "emission" in w or "motion" in w for w in found["cube_gbuffer"])


def test_only_a_network_that_reads_surfels_has_them_made() -> None:
    """And ``ember`` reads no cube."""
    surfels = {"surfel_light", "pack_surfels"}
    assert surfels <= set(plan(PLAIN, model=find_model("ember")))
    assert not {"cube_gbuffer", "cube_direct"} & set(plan(PLAIN, model=find_model("ember")))
    for model in (None, find_model("gather")):
        assert not surfels & set(plan(PLAIN, model=model))


def test_without_taa_no_motion_and_no_history() -> None:
    found = plan(PLAIN, taa=False)
    assert "taa" not in found and "motion" not in found["gbuffer"]
    assert "motion" in plan(PLAIN)["gbuffer"]


def test_targets_only_for_what_the_scene_has() -> None:
    for model in (None, find_model("gather")):
        assert "emission" not in plan(PLAIN, model=model)["gbuffer"]
        assert "emission" in plan(SHINING, model=model)["gbuffer"]
    assert "specular" not in plan(PLAIN)["direct"] and "specular_roughness" not in plan(PLAIN)["gbuffer"]
    glossy = make_scene([floor(1.0, material=Material(specular=(0.04,) * 3, roughness=0.3))], PLAIN.lights)
    assert "specular" in plan(glossy)["direct"] and "specular_roughness" in plan(glossy)["gbuffer"]
    assert "specular" not in plan(glossy, "direct")["direct"]


def test_without_lights_no_shadow_map() -> None:
    assert "shadow" not in plan(make_scene([floor(1.0)]))
    assert "shadow" in plan(PLAIN)
    assert plan(PLAIN)["shadow"] == ("shadow", "shadow_slope")  # hard light: nothing searches the bounds


def test_intermediate_outputs_leave_out_what_follows() -> None:
    assert set(plan(PLAIN, "direct")) == {"shadow", "gbuffer", "direct"}
    found = plan(PLAIN, "indirect", model=find_model("gather"))
    assert not {"composite", "taa", "tonemap"} & set(found)
