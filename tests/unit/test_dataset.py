"""The dataset: the same seed gives the same bytes, also after a crash, truncation or corruption."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

if any(importlib.util.find_spec(name) is None for name in ("mitsuba", "distributed")):
    pytest.skip("the extra 'export' is not installed", allow_module_level=True)

import export.dataset.scenes.connected_rooms as connected_rooms
from app.errors import SettingsError
from app.scene import DirectionalLight
from export.dataset import Dataset
from export.dataset.config import DEFAULT, Config, Source, config_from_table, read_config
from export.dataset.dataset import About, write_about
from export.dataset.pair_worker import make_group
from export.dataset.plan import Choice, Group, generate_pair, generate_scene, plan_groups
from export.dataset.scene_key import scene_key
from export.dataset.scenes.generated_scene import GeneratedSceneBuilder
from export.dataset.scenes.open_box import open_box
from export.dataset.scenes.sources import SOURCES
from export.dataset.scenes.walls import THICKNESS, Wall
from export.dataset.scheduler import make_dataset
from export.dataset.store import Origin, encode, item_path, read_origin, read_target, write_item
from export.dataset.target import Target, texel_positions

pytestmark = pytest.mark.usefixtures("path_tracer")

SMALL = Config(size=(64, 48), spp=4, max_bounces=4, denoise=False, sources=(
    Source(name="room", weight=2, pairs_per_scene=2), Source(name="corridor", weight=1, pairs_per_scene=2)))
PAIRS = 6
TOML = """
size = [64, 48]
spp = 4
max_bounces = 4
denoise = false
[sources]
room = {weight = 2, pairs_per_scene = 2}
corridor = {weight = 1, pairs_per_scene = 2}
"""


@pytest.fixture(scope="module")
def expected() -> dict[int, bytes]:
    """Every file, made in this process."""
    return {i: content for group in plan_groups(SMALL, PAIRS) for i, content in make(SMALL, 0, group).items()}


def make(config: Config, seed: int, group: Group, known: dict[int, Origin] | None = None) -> dict[int, bytes]:
    return make_group(config, seed, group, group.within(PAIRS), known or {})


def files(folder: Path) -> dict[int, bytes]:
    return {int(path.stem): path.read_bytes() for path in sorted(folder.glob("*/[0-9]*.exr"))}


def test_the_same_seed_gives_the_same_bytes(expected: dict[int, bytes]) -> None:
    group = plan_groups(SMALL, PAIRS)[1]
    again = make(SMALL, 0, group)
    other = make(SMALL, 1, group)
    assert again == {i: expected[i] for i in again}
    assert all(other[i] != expected[i] for i in other)


def test_a_longer_dataset_begins_like_a_shorter_one() -> None:
    long, short = plan_groups(SMALL, 40), plan_groups(SMALL, 9)
    assert [g.source for g in long[:len(short)]] == [g.source for g in short]
    rooms = sum(g.pairs for g in long if g.source == "room")
    assert abs(rooms - 40 * 2 / 3) <= 2


@pytest.mark.parametrize("source", SOURCES)
def test_a_source_is_determined_by_its_seed(source: str) -> None:
    one, same, other = (SOURCES[source](np.random.default_rng(seed)).scene for seed in (1, 1, 2))
    assert scene_key(one) == scene_key(same) != scene_key(other)
    assert one.lights or any(m.emits for m in one.materials) or source == "primitives"  # lit by environments only
    for mesh in one.meshes:  # otherwise the path tracer would light the wrong side
        a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
        facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.normals[mesh.triangles[:, 0]])
        assert (facing >= -1e-9).all()


def test_cameras_in_connected_rooms_avoid_walls_and_shutters_leave_a_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    walls: list[Wall] = []
    monkeypatch.setattr(connected_rooms, "add_walls", lambda builder, added, materials: walls.extend(added))
    open_shares = []
    for seed in range(60):
        walls.clear()
        rng, builder = np.random.default_rng(seed), GeneratedSceneBuilder(np.random.default_rng(0))
        volumes = connected_rooms.connected_rooms(rng).camera_volumes
        for low, high in (part.bounds for wall in walls for part in wall.parts()):
            assert not ((low < volumes[:, 1]) & (high > volumes[:, 0])).all(axis=1).any()
        for opening in walls[0].openings:
            connected_rooms._add_shutter(rng, builder, walls[0], opening)
            low, high = builder.build("shutter", []).scene.bounds
            left = walls[0].start[0] + opening.left
            expected = left, left + opening.right - opening.left, opening.top
            np.testing.assert_allclose((low[0], high[0], high[1]), expected, rtol=1e-6)
            assert walls[0].start[1] - THICKNESS <= low[2] + 1e-6 < high[2] < walls[0].start[1]
            open_shares.append((low[1] - opening.bottom) / (opening.top - opening.bottom))
            builder = GeneratedSceneBuilder(np.random.default_rng(0))
    assert 0.02 < min(open_shares) < 0.1 and max(open_shares) > 0.8 and np.median(open_shares) < 0.5


def test_an_open_box_is_seen_from_its_open_side() -> None:
    suns = 0
    for seed in range(40):
        generated = open_box(np.random.default_rng(seed))
        (_, _, back), (_, _, front) = generated.scene.bounds
        assert generated.camera_volumes[0, 0, 2] > front - THICKNESS > back
        directions = [light.direction for light in generated.scene.lights if isinstance(light, DirectionalLight)]
        assert all(direction[2] < 0 for direction in directions)
        suns += len(directions)
    assert 2 <= suns <= 20


def test_frames_of_a_pair_are_neighbours_and_share_their_scene() -> None:
    group, moved = plan_groups(SMALL, PAIRS)[0], set()
    for k in range(40):
        pair = generate_pair(SMALL, 0, group, Choice(0, k))
        before, now = pair.previous, pair.current
        assert np.abs(np.subtract(before.camera.eye, now.camera.eye)).max() <= 0.06
        assert before.camera.fov_y_deg == now.camera.fov_y_deg
        if before.scene is not now.scene:
            moved.add("light")
            assert before.scene.meshes is now.scene.meshes
            assert sum(a != b for a, b in zip(before.scene.lights, now.scene.lights, strict=True)) == 1
        moved |= {"camera"} if before.camera != now.camera else set()
        moved |= {"objects"} if before.time != now.time else set()
    assert moved == {"light", "camera", "objects"}


def test_a_worker_that_is_killed_loses_nothing(tmp_path: Path, expected: dict[int, bytes]) -> None:
    from distributed import LocalCluster

    killed: list[int] = []
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster:
        def kill_one(done: int) -> None:
            if not killed:
                killed.append(cluster.workers[0].pid)
                os.kill(killed[0], signal.SIGKILL)

        assert make_dataset(tmp_path, SMALL, 0, PAIRS, cluster.scheduler_address, progress=kill_one) == PAIRS
    assert killed and files(tmp_path) == expected


def test_a_killed_command_resumes_to_the_same_bytes(tmp_path: Path, expected: dict[int, bytes]) -> None:
    config, out = tmp_path / "small.toml", tmp_path / "out"
    config.write_text(TOML)
    command = [sys.executable, "-m", "export", "dataset", "make", "--out", str(out), "--frames", str(PAIRS),
               "--config", str(config), "--workers", "1"]
    running = subprocess.Popen(command, start_new_session=True)
    try:
        deadline = time.monotonic() + 120
        while not files(out) and time.monotonic() < deadline:
            time.sleep(0.02)
    finally:
        os.killpg(running.pid, signal.SIGKILL)
        running.wait()
    assert 0 < len(files(out)) < PAIRS
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert files(out) == expected
    assert f"{PAIRS} pairs, {PAIRS} of them" not in done.stdout


def test_corrupt_and_outdated_items_are_made_again(tmp_path: Path, expected: dict[int, bytes],
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    for i, content in expected.items():
        write_item(item_path(tmp_path, i), content)
    flipped = bytearray(expected[2])
    flipped[700] ^= 1
    broken = {0: expected[0][:300], 1: b"", 2: bytes(flipped), 3: expected[3].replace(b'"camera": ', b'"camera": 1')}
    for i, content in broken.items():
        item_path(tmp_path, i).write_bytes(content)
        assert read_origin(item_path(tmp_path, i)) is None
    known = {i: origin for i in expected if (origin := read_origin(item_path(tmp_path, i))) is not None}
    assert sorted(known) == sorted(set(expected) - set(broken))
    groups = plan_groups(SMALL, PAIRS)
    again = {i: c for group in groups[:2] for i, c in make(SMALL, 0, group, known).items()}
    assert again == {i: expected[i] for i in broken}
    corridor = SOURCES["corridor"]
    monkeypatch.setitem(SOURCES, "corridor", lambda rng: replace(p := corridor(rng), scene=replace(
        p.scene, lights=(*p.scene.lights, *p.scene.lights))))
    generate_scene.cache_clear()
    outdated = next(group for group in groups if group.source == "corridor")
    assert len(make(SMALL, 0, outdated, known)) == outdated.pairs
    generate_scene.cache_clear()


def test_a_dataset_gives_pairs_and_targets(tmp_path: Path, expected: dict[int, bytes]) -> None:
    with pytest.raises(SettingsError, match="no dataset"):
        Dataset(tmp_path)
    write_about(tmp_path, About(SMALL, 0, PAIRS))
    with pytest.raises(SettingsError, match="lacks pair 0 of 6"):
        Dataset(tmp_path)
    for i, content in expected.items():
        write_item(item_path(tmp_path, i), content)
    dataset = Dataset(tmp_path)
    assert len(dataset) == PAIRS
    assert [dataset.source(i) for i in range(PAIRS)].count("corridor") == 2
    for i in (0, 3):
        target, pair = dataset.target(i), dataset.pair(i)
        assert {name: light.shape for name, light in target.layers.items()} == dict.fromkeys(
            ("indirect", "indirect_single"), (24, 32, 3))
        indirect, single = target.layers["indirect"], target.layers["indirect_single"]
        assert pair.current.size == (64, 48)
        assert target.seen.mean() > 0.4
        assert (indirect[~target.seen] == 0).all()
        # All bounces give more light than one, up to the error of the compression.
        assert (indirect >= 0.9 * single - 0.05 * indirect.max()).all()
        assert indirect.mean() > 0


def test_a_dataset_of_another_version_is_named(tmp_path: Path) -> None:
    write_about(tmp_path, About(SMALL, 0, PAIRS))
    file = tmp_path / "dataset.json"
    file.write_text(file.read_text("utf-8").replace('"spp"', '"paths"'))
    with pytest.raises(SettingsError, match=r"dataset\.json: made by another version .*make it again with python -m"):
        Dataset(tmp_path)


def test_stored_targets_are_close_to_the_traced_ones(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    x = np.linspace(0, 4, 128)[None, :, None]
    light = (np.exp(np.sin(x) + np.cos(np.linspace(0, 3, 96))[:, None, None]) * rng.uniform(0.5, 1, 3)).astype("f4")
    seen = rng.random((96, 128)) < 0.9
    target = Target({"indirect": np.where(seen[..., None], light, 0),
                     "indirect_single": np.where(seen[..., None], 0.4 * light, 0)}, seen)
    origin = Origin(Choice(1, 23), "key")
    write_item(tmp_path / "a" / "item.exr", encode(target, origin))
    back = read_target(tmp_path / "a" / "item.exr")
    assert read_origin(tmp_path / "a" / "item.exr") == origin
    assert (back.seen == seen).all()
    assert list(back.layers) == list(target.layers)
    for a, b in ((back.layers[name], target.layers[name]) for name in target.layers):
        assert np.sqrt(((a - b) ** 2).mean()) < 0.02 * b.mean()


def test_a_folder_of_another_configuration_is_refused(tmp_path: Path) -> None:
    write_about(tmp_path, About(SMALL, 3, PAIRS))
    with pytest.raises(SettingsError, match="another configuration or seed"):
        make_dataset(tmp_path, SMALL, 0, PAIRS)


def test_texels_of_targets_are_those_of_the_shader() -> None:
    columns, rows = np.moveaxis(texel_positions((64, 48)) * (64, 48), -1, 0)
    assert columns[0, :3].tolist() == [1.5, 3.5, 5.5]
    assert rows[:3, 0].tolist() == [0.5, 2.5, 4.5]


def bad_tables() -> Iterator[tuple[dict[str, object], str]]:
    source = {"weight": 1, "pairs_per_scene": 2}
    table = {"size": [64, 48], "spp": 4, "max_bounces": 4, "denoise": False, "sources": {"room": source}}
    yield {**table, "size": [63, 48]}, "size"
    yield {**table, "spp": 0}, "spp"
    yield {**table, "sppp": 3}, "sppp"
    yield {**table, "min_lit_share": 1.5}, "min_lit_share"
    yield {**table, "min_lit_share": True}, "min_lit_share"
    yield {**table, "min_mean_luminance_share": 0}, "min_mean_luminance_share"
    yield {**table, "denoise": 1}, "denoise"
    yield {**table, "sources": 5}, "sources"
    yield {**table, "sources": {}}, "sources"
    yield {**table, "sources": {"room": 5}}, "sources"
    yield {**table, "sources": {"room": {**source, "pairs_per_scene": 0}}}, "pairs_per_scene"
    yield {**table, "sources": {"roon": source}}, "no source 'roon'"
    yield {**table, "sources": {"files": source}}, "the source 'files' needs"
    yield {key: value for key, value in table.items() if key != "size"}, "size"


@pytest.mark.parametrize(("table", "named"), list(bad_tables()))
def test_a_bad_configuration_is_refused(table: dict[str, object], named: str) -> None:
    with pytest.raises(SettingsError, match=rf"^small\.toml: bad .*{named}"):
        config_from_table(table, "small.toml")


def test_the_default_configuration_mixes_sources() -> None:
    names = {source.name for source in read_config(None).sources}
    assert names == {"room", "corridor", "hall", "courtyard", "blocks", "files"}


def test_other_configurations_are_valid_and_demand_less_light() -> None:
    default = read_config(None)
    for name in ("environment", "surround"):
        config = read_config(DEFAULT.with_name(f"{name}.toml"))
        assert config.min_lit_share < default.min_lit_share
        assert config.min_mean_luminance_share <= default.min_mean_luminance_share
        assert config.environment == (name == "environment")


def test_held_out_scenes_are_refused(tmp_path: Path) -> None:
    from export.dataset.held_out import LIST, refuse_held_out
    from export.dataset.scenes.files import load_random_file

    listed = {name for name, file in json.loads(LIST.read_text())["files"].items() if file["held_out"]}
    assert listed == {"sponza", "breakfast-room", "country-kitchen", "cornell-box", "stanford"}
    for name in listed:
        file = tmp_path / name / "scene.obj"
        file.parent.mkdir()
        file.write_text("")
        with pytest.raises(SettingsError, match="held out"):
            load_random_file(np.random.default_rng(0), (file,))
    other = tmp_path / "mine.obj"
    other.write_text("")
    refuse_held_out(other)


def test_held_out_scenes_are_refused_under_other_names(tmp_path: Path, scenes: Path) -> None:
    from export.dataset.held_out import refuse_held_out

    file = tmp_path / "mine.obj"
    file.write_bytes((scenes / "cornell-box" / "CornellBox-Original.obj").read_bytes())
    with pytest.raises(SettingsError, match="held out"):
        refuse_held_out(file)


@pytest.mark.long
def test_a_thousand_pairs_fit_into_sixty_mebibytes() -> None:
    sources = tuple(Source(name=name, weight=1, pairs_per_scene=1) for name in ("room", "blocks", "hall"))
    config = replace(read_config(None), spp=16, sources=sources)
    sizes = [len(content) for group in plan_groups(config, 3) for content in make(config, 7, group).values()]
    assert np.mean(sizes) * 1000 < 60 * 2**20


def test_an_unusable_llvm_library_is_named(tmp_path: Path) -> None:
    (file := tmp_path / "libLLVM.so").write_bytes(b"no library")
    run = subprocess.run([sys.executable, "-m", "export", "dataset", "make", "--out", tmp_path / "data", "--frames",
                          "1"], env={**os.environ, "DRJIT_LIBLLVM_PATH": str(file)}, capture_output=True, text=True,
                         check=False)
    assert run.returncode == 2
    errors = [line for line in run.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1 and str(file) in errors[0] and "Traceback" not in run.stderr
    assert not (tmp_path / "data").exists()
