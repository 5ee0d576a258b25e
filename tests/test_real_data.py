"""Real input: a pitched laser's sweep, maps of real buildings, and the Moving AI benchmarks."""

from __future__ import annotations

import json
import math
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from navloom import Path as PathFound
from navloom import PlanRequest, Pose2D
from navloom.cli import main
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble, grid_of
from navloom.engine.plugin_factory import make_plugins
from navloom.geometry.world import Place, World
from navloom.roles import PlannerInput
from navloom.runs.episode import run_episode
from navloom.runs.single_plan import map_update
from navloom_maps.movingai import scenario_place
from navloom_maps.rosmap import load_raster, rosmap_world
from navloom_optimal.shortest_path import optimal_length
from navloom_study.recorded_sweeps import find_floor, map_sweep, read_recording, sweep_of
from scipy.ndimage import distance_transform_edt

CONFIG = """
[run]
seed = {seed}
stop_after = 900.0
[robot]
footprint = {{ length = 0.5, width = 0.5 }}
height = 0.6
half_track = 0.2
max_angular_deg = 60.0
[world]
ref = "rosmap:{map}"
[[sensor]]
name = "laser"
kind = "laser_2d"
beams = 271
field_of_view_deg = 270.0
range_max = 20.0
[localizer]
plugin = "{localizer}"
[mapper]
plugin = "known_map"
[planner]
plugin = "astar"
inflation_margin = 0.05
[navigation]
start = {{ x = {x}, y = {y}, heading_deg = {heading} }}
goal = {{ x = {gx}, y = {gy} }}
"""
BUILDINGS = {"willow_full_0.1.yaml": 30.0, "aws_small_house.yaml": 8.0}
"""Map -> least length of an optimal path, m."""


def pairs(file: Path, least: float, seed: int, count: int) -> list[tuple[Place, Place]]:
    """Seeded pairs of free places whose optimal path has at least a length, m.

    The path is that of a disc of radius 0.35 m, in which the square robot of 0.5 m can turn. On cells of 0.1 m the
    planner finds no path through gaps of 0.6 m, which leave 5 cm on either side.
    """
    raster = load_raster(file)
    gap = distance_transform_edt(~raster.occupied) * raster.resolution
    cells = np.argwhere(gap > 0.45)
    stream = np.random.default_rng(seed)
    world = rosmap_world(str(file), Path())
    found: list[tuple[Place, Place]] = []
    while len(found) < count:
        ends = [
            (raster.origin.x + (col + 0.5) * raster.resolution, raster.origin.y + (row + 0.5) * raster.resolution)
            for row, col in cells[stream.integers(len(cells), size=2)]
        ]
        start, goal = Place(*ends[0], float(stream.uniform(-math.pi, math.pi))), Place(*ends[1])
        if math.dist(*ends) > 0.3 * least and is_long(world, start, goal, least):
            found.append((start, goal))
    return found


def is_long(world: World, start: Place, goal: Place, least: float) -> bool:
    length = optimal_length(world, start, goal, 0.35, 0.6)
    return length is not None and length >= least


def drive(file: Path, start: Place, goal: Place, seed: int, localizer: str, folder: Path) -> tuple[str, int, float]:
    """Outcome by ground truth, contacts and least clearance of one drive."""
    heading = math.degrees(start.heading)
    path = folder / f"{file.stem}-{seed}-{localizer}.toml"
    path.write_text(
        CONFIG.format(
            seed=seed, map=file, localizer=localizer, x=start.x, y=start.y, heading=heading, gx=goal.x, gy=goal.y
        ),
        "utf-8",
    )
    episode = run_episode(load_config(str(path)))
    summary = episode.summary()
    return episode.trail.outcome, summary["collisions"], summary["min_clearance_m"]


def test_one_drive_through_a_real_house(data: Path, tmp_path: Path) -> None:
    file = data / "rosmaps" / "aws_small_house.yaml"
    ((start, goal),) = pairs(file, BUILDINGS[file.name], 3, 1)
    outcome, contacts, _ = drive(file, start, goal, 3, "scan_matching", tmp_path)
    assert (outcome, contacts) == ("succeeded", 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILDINGS)
def test_ten_drives_through_real_buildings(data: Path, tmp_path: Path, name: str) -> None:
    file = data / "rosmaps" / name
    tasks = pairs(file, BUILDINGS[name], 0, 10)
    with ProcessPoolExecutor(2) as pool:
        jobs = [
            pool.submit(drive, file, start, goal, k, "scan_matching", tmp_path) for k, (start, goal) in enumerate(tasks)
        ]
        rows = [job.result() for job in jobs]
    print(name, rows)
    assert [row for row in rows if row[1]] == []
    assert sum(row[0] == "succeeded" for row in rows) >= 9


SCENARIOS = ["bg512__AR0011SR", "cities__Berlin_0_512", "dao__arena2", "dao__brc202d", "mazes__maze512-8-0",
             "random__random512-25-0", "rooms__32room_000", "sc1__Aurora"]  # fmt: skip


@pytest.mark.parametrize("name", SCENARIOS)
def test_moving_ai_scenarios_have_the_exact_optimal_length(data: Path, name: str) -> None:
    reference = f"movingai:{data / 'movingai' / f'{name}.map.gz'}"
    words = [
        f"world.ref={reference}",
        "planner.plugin=astar",
        "planner.inflation=none",
        "navigation.start={x=1.5,y=1.5}",
    ]
    system = assemble(load_config("paper", words))
    make_plugins(system)
    planner = system.plugin("planner", "astar")
    assert system.world is not None and system.world.raster is not None
    rows = len(system.world.raster.occupied)
    update = map_update(grid_of(system.world, 1.0, 1.2))
    lines = (data / "movingai" / f"{name}.map.scen").read_text().splitlines()[1:]
    worst = 0.0
    for number, line in enumerate(lines, start=1):
        x, y, gx, gy, length = line.split()[-5:]
        start, goal = scenario_place(int(x), int(y), rows), scenario_place(int(gx), int(gy), rows)
        request = PlanRequest(number, Pose2D(start.x, start.y, 0.0), Pose2D(goal.x, goal.y, 0.0))
        answer = planner.plan(PlannerInput(request, update))  # type: ignore[attr-defined]
        assert isinstance(answer, PathFound), answer
        worst = max(worst, abs(answer.length - float(length)))
    assert len(lines) == 50 and worst <= 0.01


def test_a_real_sweep_is_mapped_without_its_floor(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # The floor of this recording scatters by some centimetres, so its tolerance is twice the default.
    file = data / "scan3d" / "pitching_lms200_0.npz"
    words = ["map", str(file), "--set", "floor_tolerance=0.12", "--set", "cell=0.1", "--out", str(tmp_path), "--json"]
    monkeypatch.setattr(sys, "argv", ["navloom", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    result = json.loads(capsys.readouterr().out)
    assert result["pitch_offset_deg"] == pytest.approx(2.55, abs=0.05)
    assert result["height_m"] == pytest.approx(0.388, abs=0.005)
    counts = result["counts"]
    assert sum(counts.values()) == result["points"] == 226 * 360
    # 1481 returns are at the scanner's greatest number, 1973 are nearer than 0.3 m: counted in the file itself.
    assert (counts["beyond_max"], counts["below_min"]) == (1481, 1973)
    assert counts["floor"] > 15_000
    assert (tmp_path / "map.png").stat().st_size > 5000 and (tmp_path / "map.yaml").exists()


def test_the_floor_between_the_walls_of_the_real_corridor_is_free(data: Path) -> None:
    recording = read_recording(data / "scan3d" / "pitching_lms200_0.npz")
    mapped = map_sweep(sweep_of(recording, *find_floor(recording)), changes=["floor_tolerance=0.12", "cell=0.1"])
    ends = mapped.update.segments.reshape(-1, 2)
    between = (np.abs(ends[:, 1]) < 0.6) & (ends[:, 0] > 0.3) & (ends[:, 0] < 5.0)
    assert not between.any()


def test_a_damaged_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sweep.npz"
    with pytest.raises(ConfigError, match="there is no such file"):
        read_recording(path)
    path.write_bytes(b"PK nonsense")
    with pytest.raises(ConfigError, match=r"damaged \.npz file"):
        read_recording(path)
    np.savez(path, ranges_m=np.ones((3, 4)), pitch_deg=np.ones(3), beam_deg=np.ones(5))
    with pytest.raises(ConfigError, match=r"beam_deg \(5,\)"):
        read_recording(path)
    np.savez(path, ranges_m=np.ones((0, 4)), pitch_deg=np.ones(0), beam_deg=np.ones(4))
    with pytest.raises(ConfigError, match="at least one frame"):
        read_recording(path)
    np.savez(path, ranges_m=np.full((3, 4), np.inf), pitch_deg=np.ones(3), beam_deg=np.ones(4))
    with pytest.raises(ConfigError, match="nothing but inf"):
        read_recording(path)
    bad = np.ones((3, 4))
    bad[2, 1] = np.nan
    np.savez(path, ranges_m=bad, pitch_deg=np.ones(3), beam_deg=np.ones(4))
    with pytest.raises(ConfigError, match=r"sweep\.npz: ranges_m\[2, 1\] is nan"):
        read_recording(path)
    np.savez(path, ranges_m=np.ones((3, 4)))
    with pytest.raises(ConfigError, match="expected ranges_m, pitch_deg and beam_deg"):
        read_recording(path)
