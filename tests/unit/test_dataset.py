"""The dataset: the same bytes from the same seed, whatever died, was cut or was changed on the way."""

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
from export.dataset.config import DEFAULT, Config, Share, from_table, read_config
from export.dataset.key import scene_key
from export.dataset.make import make_group
from export.dataset.plan import Choice, Group, pair_at, plan
from export.dataset.run import make_dataset
from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.open_box import open_box
from export.dataset.scenes.sources import SOURCES
from export.dataset.scenes.walls import THICKNESS, Wall
from export.dataset.store import Origin, encode, item_path, read_origin, read_target, write_item
from export.dataset.target import Target, picked

pytestmark = pytest.mark.usefixtures("path_tracer")

SMALL = Config((64, 48), paths=4, max_bounces=4, denoised=False,
               sources=(Share("room", 2, 2), Share("corridor", 1, 2)))
PAIRS = 6
TOML = """
size = [64, 48]
paths = 4
max_bounces = 4
denoised = false
[sources]
room = {share = 2, pairs = 2}
corridor = {share = 1, pairs = 2}
"""


@pytest.fixture(scope="module")
def expected() -> dict[int, bytes]:
    """Every file, made in this very process."""
    return {i: content for group in plan(SMALL, PAIRS) for i, content in made(SMALL, 0, group).items()}


def made(config: Config, seed: int, group: Group, known: dict[int, Origin] | None = None) -> dict[int, bytes]:
    return make_group(config, seed, group, group.within(PAIRS), known or {})


def files(folder: Path) -> dict[int, bytes]:
    return {int(path.stem): path.read_bytes() for path in sorted(folder.glob("*/[0-9]*.exr"))}


def test_the_same_seed_gives_the_same_bytes(expected: dict[int, bytes]) -> None:
    group = plan(SMALL, PAIRS)[1]
    again = made(SMALL, 0, group)
    other = made(SMALL, 1, group)
    assert again == {i: expected[i] for i in again}
    assert all(other[i] != expected[i] for i in other)


def test_a_longer_dataset_begins_like_a_shorter_one() -> None:
    long, short = plan(SMALL, 40), plan(SMALL, 9)
    assert [g.source for g in long[:len(short)]] == [g.source for g in short]
    rooms = sum(g.pairs for g in long if g.source == "room")
    assert abs(rooms - 40 * 2 / 3) <= 2


@pytest.mark.parametrize("source", SOURCES)
def test_a_source_makes_what_its_seed_says(source: str) -> None:
    one, same, other = (SOURCES[source](np.random.default_rng(seed)).scene for seed in (1, 1, 2))
    assert scene_key(one) == scene_key(same) != scene_key(other)
    assert one.lights or any(m.emits for m in one.materials) or source == "primitives"  # it is for environments
    for mesh in one.meshes:  # faces and normals agree, or the path tracer would light the wrong side
        a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
        facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.normals[mesh.triangles[:, 0]])
        assert (facing >= -1e-9).all()


def test_eyes_in_a_suite_keep_out_of_its_walls_and_shutters_leave_a_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    walls: list[Wall] = []
    monkeypatch.setattr(connected_rooms, "build", lambda assembly, built, paint: walls.extend(built))
    open_shares = []
    for seed in range(60):
        walls.clear()
        rng, assembly = np.random.default_rng(seed), Assembly(np.random.default_rng(0))
        free = connected_rooms.connected_rooms(rng).free
        for box in (part.box for wall in walls for part in wall.parts()):
            assert not ((box[0] < free[:, 1]) & (box[1] > free[:, 0])).all(axis=1).any()
        for opening in walls[0].openings:
            connected_rooms._shutter(rng, assembly, walls[0], opening)
            low, high = assembly.place("shutter", []).scene.bounds
            left = walls[0].start[0] + opening.left
            expected = left, left + opening.right - opening.left, opening.top
            np.testing.assert_allclose((low[0], high[0], high[1]), expected, rtol=1e-6)
            assert walls[0].start[1] - THICKNESS <= low[2] + 1e-6 < high[2] < walls[0].start[1]
            open_shares.append((low[1] - opening.bottom) / (opening.top - opening.bottom))
            assembly = Assembly(np.random.default_rng(0))
    assert 0.02 < min(open_shares) < 0.1 and max(open_shares) > 0.8 and np.median(open_shares) < 0.5


def test_a_diorama_is_seen_from_its_open_side() -> None:
    suns = 0
    for seed in range(40):
        place = open_box(np.random.default_rng(seed))
        (_, _, back), (_, _, front) = place.scene.bounds
        assert place.free[0, 0, 2] > front - THICKNESS > back
        directions = [light.direction for light in place.scene.lights if isinstance(light, DirectionalLight)]
        assert all(direction[2] < 0 for direction in directions)
        suns += len(directions)
    assert 2 <= suns <= 20


def test_frames_of_a_pair_are_neighbours_and_share_their_scene() -> None:
    group, moved = plan(SMALL, PAIRS)[0], set()
    for k in range(40):
        pair = pair_at(SMALL, 0, group, Choice(0, k))
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
    command = [sys.executable, "-m", "export", "dataset", "--out", str(out), "--frames", str(PAIRS), "--config",
               str(config), "--workers", "1"]
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
    groups = plan(SMALL, PAIRS)
    again = {i: c for group in groups[:2] for i, c in made(SMALL, 0, group, known).items()}
    assert again == {i: expected[i] for i in broken}
    corridor = SOURCES["corridor"]
    monkeypatch.setitem(SOURCES, "corridor", lambda rng: replace(p := corridor(rng), scene=replace(
        p.scene, lights=(*p.scene.lights, *p.scene.lights))))
    pair_at.__globals__["place_of"].cache_clear()
    outdated = next(group for group in groups if group.source == "corridor")
    assert len(made(SMALL, 0, outdated, known)) == outdated.pairs
    pair_at.__globals__["place_of"].cache_clear()


def test_a_dataset_gives_pairs_and_targets(tmp_path: Path, expected: dict[int, bytes]) -> None:
    from export.dataset.dataset import write_about

    with pytest.raises(SettingsError, match="no dataset"):
        Dataset(tmp_path)
    write_about(tmp_path, SMALL, 0, PAIRS)
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
        # All bounces are more than one; what is stored is a little off.
        assert (indirect >= 0.9 * single - 0.05 * indirect.max()).all()
        assert indirect.mean() > 0


def test_what_is_stored_is_near_what_was_traced(tmp_path: Path) -> None:
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
    from export.dataset.dataset import write_about

    write_about(tmp_path, SMALL, 3, PAIRS)
    with pytest.raises(SettingsError, match="another configuration or seed"):
        make_dataset(tmp_path, SMALL, 0, PAIRS)


def test_picked_texels_are_the_odd_ones_of_the_shader() -> None:
    columns, rows = np.moveaxis(picked((64, 48)) * (64, 48), -1, 0)
    assert columns[0, :3].tolist() == [1.5, 3.5, 5.5]
    assert rows[:3, 0].tolist() == [0.5, 2.5, 4.5]


def bad_tables() -> Iterator[tuple[dict[str, object], str]]:
    table = {"size": [64, 48], "paths": 4, "max_bounces": 4, "denoised": False,
             "sources": {"room": {"share": 1, "pairs": 2}}}
    yield {**table, "size": [63, 48]}, "size"
    yield {**table, "paths": 0}, "paths"
    yield {**table, "pathes": 3}, "pathes"
    yield {**table, "least_lit": 1.5}, "least_lit"
    yield {**table, "least_lit": True}, "least_lit"
    yield {**table, "darkest": 0}, "darkest"
    yield {**table, "sources": 5}, "table of names"
    yield {**table, "sources": {"roon": {"share": 1, "pairs": 2}}}, "roon"
    yield {**table, "sources": {"files": {"share": 1, "pairs": 2}}}, "files"
    yield {key: value for key, value in table.items() if key != "size"}, "size"


@pytest.mark.parametrize(("table", "named"), list(bad_tables()))
def test_a_bad_configuration_is_refused(table: dict[str, object], named: str) -> None:
    with pytest.raises(SettingsError, match=named):
        from_table(table)


def test_the_default_configuration_mixes_sources() -> None:
    names = {share.source for share in read_config(None).sources}
    assert names == {"room", "corridor", "hall", "courtyard", "blocks", "files"}


def test_other_configurations_are_sound_and_ask_less_of_cameras() -> None:
    usual = read_config(None)
    for name in ("sky", "around"):
        config = read_config(DEFAULT.with_name(f"{name}.toml"))
        assert config.least_lit < usual.least_lit and config.darkest <= usual.darkest
        assert config.environment == (name == "sky")


def test_held_out_scenes_are_refused(tmp_path: Path) -> None:
    from export.dataset.held_out import LIST, refuse_held_out
    from export.dataset.scenes.files import open_file

    listed = json.loads(LIST.read_text())["files"]
    assert set(listed) == {"sponza", "breakfast-room", "country-kitchen", "cornell-box", "stanford"}
    for name in listed:
        file = tmp_path / name / "scene.obj"
        file.parent.mkdir()
        file.write_text("")
        with pytest.raises(SettingsError, match="held out"):
            open_file(np.random.default_rng(0), (str(file),))
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
    config = replace(read_config(None), paths=16, sources=tuple(Share(s, 1, 1) for s in ("room", "blocks", "hall")))
    sizes = [len(content) for group in plan(config, 3) for content in made(config, 7, group).values()]
    assert np.mean(sizes) * 1000 < 60 * 2**20


def test_an_llvm_that_is_none_is_named(tmp_path: Path) -> None:
    (file := tmp_path / "libLLVM.so").write_bytes(b"no library")
    run = subprocess.run([sys.executable, "-m", "export", "dataset", "--out", tmp_path / "data", "--frames", "1"],
                         env={**os.environ, "DRJIT_LIBLLVM_PATH": str(file)}, capture_output=True, text=True,
                         check=False)
    assert run.returncode == 2
    errors = [line for line in run.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1 and str(file) in errors[0] and "Traceback" not in run.stderr
    assert not (tmp_path / "data").exists()
