"""A robot that has reached one goal is sent to another, in the paper's room."""

from __future__ import annotations

from pathlib import Path

import navloom.config
from navloom.config import load_config
from navloom.runs.episode import run_episode

PAPER = Path(navloom.config.__file__).parent / "shipped" / "paper.toml"
SECOND = """
[[event]]
at = 34.0
do = "goal"
x = 0.0
y = 2.0
"""


def test_a_goal_that_the_avoider_leaves_beside_the_path_is_reached_without_a_recovery(tmp_path: Path) -> None:
    """The avoider hands back 1 m before the goal, 0.8 m beside the path, whose end the robot then passes."""
    config = tmp_path / "two_goals.toml"
    config.write_text(PAPER.read_text("utf-8") + SECOND, "utf-8")
    episode = run_episode(load_config(str(config)))
    assert [result.outcome for result in episode.log.results] == ["succeeded", "succeeded"]
    assert episode.summary()["truly_reached"]
    assert episode.recorder.recoveries == 0
    assert episode.log.ticks * 0.05 - 34.0 < 45.0  # s; 56 s if it recovers after 15 s without progress
