"""StaticCache references depend on just those shaders that draw what the renderer adds to them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from app.evaluation.reference import OWN_SHADERS, SKY_SHADERS, renderer_version
from app.gl import shader
from app.golden.scenes import dusk, room
from app.load import embedded_scene
from app.renderer import Renderer
from app.scene import Scene
from app.settings import Settings

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]
TRIVIAL = {"fullscreen.vert"}


@pytest.mark.parametrize(("scene", "outputs", "listed"), [
    (room(), ("emission", "specular"), OWN_SHADERS), (dusk(), ("background",), SKY_SHADERS)], ids=["own", "sky"])
def test_the_listed_shaders_are_those_that_the_reference_takes_from(
        scene: Scene, outputs: tuple[str, ...], listed: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: set[str] = set()
    resolve = shader.resolve

    def spy(path: Path, defines: Mapping[str, object], files: list[Path]) -> Any:
        compiled.add(path.name)
        return resolve(path, defines, files)

    monkeypatch.setattr(shader, "resolve", spy)
    with Renderer(scene, Settings((32, 24), outputs, taa=False)) as renderer:
        renderer.render(scene.cameras[scene.default_camera].at(0.0))
    assert compiled - TRIVIAL == set(listed)


def test_only_what_the_renderer_adds_ties_a_reference_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "shaders"
    (folder / "include").mkdir(parents=True)
    for path in shader.shader_dir().rglob("*.*"):
        (folder / path.relative_to(shader.shader_dir())).write_text(path.read_text())
    monkeypatch.setattr("app.evaluation.reference.shader_dir", lambda: folder)
    monkeypatch.setattr(shader, "shader_dir", lambda: folder)
    version, plain = renderer_version(room()), renderer_version(embedded_scene())
    for name, changes in (("upsample.frag", False), ("include/ggx.glsl", True), ("gbuffer.frag", True)):
        text = (folder / name).read_text()
        (folder / name).write_text(text + "// another\n")
        assert (renderer_version(room()) != version) == changes
        assert renderer_version(embedded_scene()) == plain
        (folder / name).write_text(text)
