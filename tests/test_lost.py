"""A robot that starts elsewhere than it believes corrects its pose or ends lost; it never reports a false success."""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navloom.config import load_config
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import rectangle
from navloom.geometry.world import Place
from navloom.plugins import Discovery
from navloom.runs.episode import run_episode
from navloom.runs.metrics import measure
from typer.testing import CliRunner

BODY = rectangle(0.5, 0.5)
BUILDINGS = ["aws_small_house.yaml", "willow_full_0.1.yaml"]
NOISE = ["sensor.laser.sigma=0.03", "platform.slip=0.01"]


def test_a_wrong_start_is_corrected_and_the_goal_truly_reached() -> None:
    offset = "world.start_offset={x=-0.3,y=0.35,heading_deg=15}"
    summary = run_episode(load_config("building", [offset, *NOISE, "run.stop_after=60"])).summary()
    assert (summary["outcome"], summary["truly_reached"], summary["collisions"]) == ("succeeded", True, 0)


def test_on_the_map_of_another_building_it_ends_lost_near_its_start() -> None:
    matched = "localizer.plugin=scan_matching"
    episode = run_episode(load_config("building", ["map.ref=paper_gates", "run.stop_after=60", matched]))
    assert episode.result.outcome == "lost" and episode.summary()["truly_reached"] is False
    assert "less than 5% of the beams have seen the map at this place" in episode.result.reason
    truth = np.array([row[1:3] for row in episode.recorder.truth])
    assert np.hypot(*(truth[-1] - truth[0])) < 0.3


def test_a_robot_that_looks_around_there_ends_lost_after_its_time_and_touches_nothing() -> None:
    changes = ["map.ref=paper_gates", "run.stop_after=60", "navigation.localizer_timeout=30"]
    episode = run_episode(load_config("building", changes))
    assert episode.result.outcome == "lost" and episode.summary()["collisions"] == 0
    assert episode.result.reason.startswith("the localizer has not been tracking for 30 s: ")


def test_on_the_map_of_another_building_a_search_finds_no_place() -> None:
    episode = run_episode(load_config("building", ["map.ref=paper_gates", "run.stop_after=60"]))
    assert episode.result.outcome != "succeeded"
    assert measure(episode.trail)["false_tracking_time"] < 1.0


def test_the_command_says_lost_and_exits_with_1() -> None:
    from navloom.cli.main import app

    changes = ["map.ref=paper_gates", "run.stop_after=60", "localizer.plugin=scan_matching"]
    done = CliRunner().invoke(app, ["run", "building", *(part for change in changes for part in ("--set", change))])
    assert done.exit_code == 1
    assert "lost" in done.output and "of the beams have seen the map" in done.output


@pytest.mark.parametrize(
    ("world", "x", "y", "heading"), [("floor:1", 17.33, 8.76, 14.0), ("floor:2", 25.54, 0.72, 98.0)]
)
def test_a_robot_that_starts_anywhere_finds_itself_and_reaches_its_goal(
    world: str, x: float, y: float, heading: float
) -> None:
    start = f"world.start={{x={x},y={y},heading_deg={heading}}}"
    changes = [f"world.ref={world}", "navigation.start=unknown", start, "run.stop_after=200"]
    summary = run_episode(load_config("building", changes)).summary()
    assert (summary["outcome"], summary["truly_reached"], summary["collisions"]) == ("succeeded", True, 0)


# --- campaigns ------------------------------------------------------------------------------------------------------


def tasks(file: Path, count: int, seed: int, offset: float) -> list[tuple[float, ...]]:
    """Start x, y, heading, goal x, y, and the offset of the true start x, y, heading; m, degrees, map frame.

    Goals are 3 to 10 m away; some cannot be reached. Both starts are free.
    """
    world = Discovery().world(f"rosmap:{file}", Path())
    left, bottom, right, top = world.bounds
    rng, found = np.random.default_rng(seed), []

    def is_free(x: float, y: float, heading: float, least: float) -> bool:
        inside = left < x < right and bottom < y < top
        return bool(inside and clearance(BODY, Place(x, y, heading), world, height=0.6)[0] >= least)

    while len(found) < count:
        x, y = rng.uniform((left, bottom), (right, top))
        heading, way, bearing, side = rng.uniform(-math.pi, math.pi, 4)
        distance, turn = rng.uniform(3.0, 10.0), math.copysign(15.0, side) * offset
        goal_x, goal_y = x + distance * math.cos(way), y + distance * math.sin(way)
        off_x, off_y = 0.5 * offset * math.cos(bearing), 0.5 * offset * math.sin(bearing)
        if (
            is_free(x, y, heading, 0.3)
            and is_free(goal_x, goal_y, 0.0, 0.3)
            and is_free(x + off_x, y + off_y, heading + math.radians(turn), 0.1)
        ):
            found.append((x, y, math.degrees(heading), goal_x, goal_y, off_x, off_y, turn))
    return found


def drive(file: Path, seed: int, task: tuple[float, ...]) -> dict[str, Any]:
    x, y, heading, goal_x, goal_y, off_x, off_y, turn = task
    changes = [
        f"world.ref='rosmap:{file}'",
        f"run.seed={seed}",
        "run.stop_after=150",
        f"navigation.start={{x={x},y={y},heading_deg={heading}}}",
        f"navigation.goal={{x={goal_x},y={goal_y}}}",
        f"world.start_offset={{x={off_x},y={off_y},heading_deg={turn}}}",
    ]
    return run_episode(load_config("building", [*changes, *NOISE])).summary()


def campaign(file: Path, count: int, seed: int, offset: float) -> list[dict[str, Any]]:
    with ProcessPoolExecutor(2) as pool:
        jobs = [pool.submit(drive, file, k, task) for k, task in enumerate(tasks(file, count, seed, offset))]
        rows = [job.result() for job in jobs]
    counts: dict[str, int] = {}
    for row in rows:
        name = f"{row['outcome']}, truly reached {row['truly_reached']}"
        counts[name] = counts.get(name, 0) + 1
    print(file.name, offset, counts)
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILDINGS)
def test_at_most_one_of_100_wrong_starts_is_a_false_success(data: Path, name: str) -> None:
    rows = campaign(data / "rosmaps" / name, 100, 1, offset=1.0)
    assert sum(row["outcome"] == "succeeded" and not row["truly_reached"] for row in rows) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILDINGS)
def test_right_starts_raise_no_false_alarm(data: Path, name: str) -> None:
    rows = campaign(data / "rosmaps" / name, 50, 2, offset=0.0)
    assert [row["reason"] for row in rows if row["outcome"] == "lost"] == []
    assert [row["reason"] for row in rows if row["outcome"] == "succeeded" and not row["truly_reached"]] == []
