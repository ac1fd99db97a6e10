"""Cached references depend on exactly the shaders of what the renderer adds to them."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from app.evaluation import versions
from app.evaluation.versions import BACKGROUND_SHADERS, SURFACE_SHADERS, exporter_version, renderer_version
from app.gl import shader
from app.golden.scenes import dusk, room
from app.load import embedded_scene
from app.renderer import Renderer
from app.scene import Scene
from app.settings import Settings

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]
TRIVIAL = {"fullscreen.vert"}


@pytest.mark.parametrize(("scene", "outputs", "listed"), [
    (room(), ("emission", "specular"), SURFACE_SHADERS),
    (dusk(), ("background",), BACKGROUND_SHADERS)], ids=["surface", "background"])
def test_the_listed_shaders_are_those_that_run(
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


def test_a_reference_depends_only_on_what_the_renderer_adds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "shaders"
    (folder / "include").mkdir(parents=True)
    for path in shader.shader_dir().rglob("*.*"):
        (folder / path.relative_to(shader.shader_dir())).write_text(path.read_text())
    monkeypatch.setattr("app.evaluation.versions.shader_dir", lambda: folder)
    monkeypatch.setattr(shader, "shader_dir", lambda: folder)
    version, plain = renderer_version(room()), renderer_version(embedded_scene())
    for name, changes in (("upsample.frag", False), ("include/ggx.glsl", True), ("gbuffer.frag", True)):
        text = (folder / name).read_text()
        (folder / name).write_text(text + "// another\n")
        assert (renderer_version(room()) != version) == changes
        assert renderer_version(embedded_scene()) == plain
        (folder / name).write_text(text)


def test_a_reference_depends_only_on_the_code_that_makes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = ("__init__.py", "cli.py", "environment_tracer.py", "path_tracer.py")
    (tmp_path / "reference").mkdir()
    for name in files:
        (tmp_path / "reference" / name).write_text(name)
    monkeypatch.setattr(versions, "require_path_tracer", lambda: tmp_path)
    monkeypatch.setattr(metadata, "version", lambda package: "1")
    for scene, used in ((room(), files[3:]), (dusk(), files[2:])):
        before = exporter_version(scene)
        for name in files:
            (tmp_path / "reference" / name).write_text("changed")
            assert (exporter_version(scene) != before) == (name in used), name
            (tmp_path / "reference" / name).write_text(name)
