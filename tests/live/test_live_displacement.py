"""A live robot that is displaced: by its own platform, after its first tick, and not counted as driven."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from live_rig import EMPTY, up

CONFIG = EMPTY.replace("drive = false\n", "goal = { x = 1.5, y = 0.0 }\n")


def result_of(event: str, folder: Path, world: str = "empty") -> dict[str, Any]:
    config = folder / "robot.toml"
    config.write_text(CONFIG.replace('"empty"', f'"{world}"') + event, "utf-8")
    with up(str(config), "--json", "--set", "run.stop_after=30") as robot:
        assert robot.process.stdout is not None
        found: dict[str, Any] = json.loads(robot.process.stdout.read())
    return found


def test_a_live_robot_is_displaced_and_drives_no_further(tmp_path: Path) -> None:
    found = result_of("[[event]]\nat = 1.0\ndo = 'displace'\nby = { y = 3.0 }\nover = 0.5\n", tmp_path)
    # It believes its wheels: it stops beside its goal, and has driven no more than the way to it.
    assert (found["outcome"], found["truly_reached"], found["collisions"]) == ("succeeded", False, 0)
    assert 2.8 < found["goal_error_m"] < 3.2
    assert found["path_length_m"] < 1.6


@pytest.mark.slow
def test_a_live_robot_that_is_put_into_an_obstacle_says_so(tmp_path: Path) -> None:
    event = "[[event]]\nat = 2.0\ndo = 'displace'\nx = 4.0\ny = 0.0\nheading_deg = 0.0\n"
    found = result_of(event, tmp_path, "doorway")
    assert found["outcome"] == "error"
    assert "displace at 2 s: at (4.00, 0.00), 0°, the robot touches right wall" in found["reason"]
