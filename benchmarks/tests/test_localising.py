"""The campaign of localizers: its drives, what hides the view, the table; and one drive of it."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from navloom.geometry.world import Box, Place, Raster, World

sys.path.insert(0, str(Path(__file__).parents[1]))
from localising import COUNTS, drive, table, tasks
from localising_scenes import PARTS, Task, alike, coverage, ground_of, scene_of

FLOORS = [f"floor:{seed}" for seed in range(1000, 1010)]


def hall() -> World:
    """A hall of 10 m by 10 m with walls of 0.1 m."""
    occupied = np.ones((100, 100), dtype=np.bool_)
    occupied[1:-1, 1:-1] = False
    return World("hall", (Box("table", (4.0, 5.0), (4.0, 4.5)),), Raster("wall", occupied, 0.1))


def test_the_whole_campaign_has_the_drives_that_are_asked_for() -> None:
    found = list(tasks(PARTS, ["willow", "house", "floors"], FLOORS, None))
    counted = {part: sum(task.part == part for task in found) for part in PARTS}
    assert counted == {**COUNTS, "global": 150} and len({task.key for task in found}) == len(found)
    assert sum(task.map == "floor:1003" and task.part == "global" for task in found) == 5


def test_a_drive_does_not_depend_on_how_many_there_are(tmp_path: Path) -> None:
    few, many = (list(tasks(["turn"], ["floors"], FLOORS, count)) for count in (3, 12))
    assert many[:3] == few
    assert scene_of(few[1], tmp_path).changes == scene_of(many[1], tmp_path).changes


def test_a_robot_stands_where_it_fits() -> None:
    ground = ground_of(hall())
    assert ground.room_at(4.5, 4.2) == 0.0 and ground.room_at(2.0, 4.25) == pytest.approx(1.95, abs=0.15)
    assert all(ground.room_at(*ground.at(cell)) > 0.5 for cell in ground.places)


def test_the_covered_share_is_that_of_beams_that_end_before_their_wall() -> None:
    """A plate 1 m ahead, from 45 degrees to the right to 45 to the left, hides 90 of 270 degrees."""
    ground, things = ground_of(hall()), np.zeros((100, 100), dtype=np.bool_)
    things[30 - 10 : 30 + 10, 30] = True
    share = coverage(ground, things, np.array([[2.0, 3.0, 0.0], [8.0, 8.0, 0.5 * math.pi]]))
    assert share == pytest.approx(90.0 / 270.0, abs=0.03)


@pytest.mark.parametrize("number", range(4))
def test_unmapped_things_hide_at_most_70_percent_and_leave_the_way_free(number: int, tmp_path: Path) -> None:
    scene = scene_of(Task("unmapped", "floor:3", number), tmp_path)
    assert 0.2 < scene.covered <= 0.7 and "is_mapped = false" in (tmp_path / "world.toml").read_text("utf-8")


def test_a_wrong_start_is_a_metre_and_30_degrees_off(tmp_path: Path) -> None:
    scene = scene_of(Task("wrong_start", "floor:3", 0), tmp_path)
    numbers = scene.changes[-1].partition("=")[2].strip("{} ").split(", ")
    x, y, heading_deg = (float(text.partition(" = ")[2]) for text in numbers)
    assert math.dist((x, y), (scene.start.x, scene.start.y)) == pytest.approx(1.0, abs=1e-3)
    off = math.remainder(heading_deg - math.degrees(scene.start.heading), 360.0)
    assert abs(off) == pytest.approx(30.0, abs=1e-2)


def test_a_kidnapped_robot_is_put_down_away_from_its_way(tmp_path: Path) -> None:
    scene = scene_of(Task("kidnapped", "floor:3", 0), tmp_path)
    assert scene.end is not None and math.dist((scene.end.x, scene.end.y), (scene.start.x, scene.start.y)) > 2.0


def test_a_map_that_is_no_floor_has_no_rooms_that_look_alike() -> None:
    assert alike(Task("global", "house", 0), Place(0.0, 0.0)) == ()


def test_the_table_counts_look_alikes_apart() -> None:
    row = {"part": "global", "map": "floor:1", "success": 1.0, "found_time": 6.0, "found_distance": 1.0,
           "false_tracking_time": 0.0, "collisions": 0.0, "lost_while_right": 0.0, "within_3_sigma": 1.0,
           "sigma_median": 0.01, "pose_error_rms": 0.005}  # fmt: skip
    twin = row | {"alike": True, "success": 0.0, "found_time": 120.0, "false_tracking_time": 9.0}
    head, *lines = (line.split() for line in table([row, row, twin]).splitlines())
    assert head[2:7] == ["drives", "reached", "found", "false", "contact"]
    assert lines[0][:7] == ["global", "floors", "2", "2", "2", "0", "0"]
    assert lines[1][:8] == ["global", "floors", "alike", "1", "0", "0", "1", "0"]


@pytest.mark.slow
def test_a_robot_that_knows_nothing_of_its_start_reaches_its_goal() -> None:
    found = drive(Task("global", "floor:2", 2), "global_matching")
    assert found["success"] == 1.0 and found["false_tracking_time"] == 0.0 and found["collisions"] == 0.0


@pytest.mark.slow
def test_the_peer_gets_the_scans_of_our_drive() -> None:
    pytest.importorskip("amcl", reason="amcl is not installed: it is GPL, and for this comparison only")
    found = drive(Task("turn", "floor:2", 2), "global_matching", peer=True)
    assert found["amcl"]["error_median"] is not None
