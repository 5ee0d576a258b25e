"""The reference node live: a restart during a drive."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cell_rig import give, silent_bus
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import own_node
from navloom.engine.streams import STEP
from navloom.messages import Drive, Odometry, Path, Pose2D, PoseEstimate, Reference, StepReport, Twist2D
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import make_cell
from navloom_live.live.live_runner import LiveRunner
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.run_clock import RunClock
from navloom_live.transport.keyspace import KeySpace

PERIOD = 0.05
KEYS = KeySpace("lab", "r1")
SYSTEM = assemble(load_config("paper"))
STILL = Twist2D(0.0, 0.0, 0.0)


class Follower:
    """A reference node that has just started, with a path of the planner that the goal authorises."""

    def __init__(self, points: list[tuple[float, float]]) -> None:
        node = own_node(SYSTEM, "reference", lambda role, name: False, is_live=True)
        self.cell = make_cell(SYSTEM, ("reference", "main"), node, Switchboard(silent_bus(), KEYS, lossless=False))
        self.runner = LiveRunner(self.cell, RunClock(), PERIOD, lambda: False)
        config = SYSTEM.config
        self._give(("planner", config.planner.instance), "path", Path(1, np.array(points), 0.0, None), 0)
        self._give(("goal", "main"), "drive", Drive(1, 1, None, False), 0)

    def at(self, x: float, y: float, heading: float, tick: int) -> Reference:
        stamp, pose = round(tick * PERIOD * 1e9), Pose2D(x, y, heading)
        config = SYSTEM.config
        self._give(("platform", config.platform.instance), "odometry", Odometry(stamp, pose, STILL), tick)
        estimate = PoseEstimate(stamp, pose, STILL, np.zeros((3, 3)))
        self._give(("localizer", config.role_table("localizer").instance), "pose", estimate, tick)
        for source in self.cell.cell.reports:
            self._give(source, STEP, StepReport("tick", (), (), True, 0, 0, 0, "", ""), tick)
        self.runner.take_in()
        self.runner.act()
        said = self.cell.cell.outlets["reference"].last
        assert said is not None and isinstance(said[0], Reference) and said[1].tick == tick
        return said[0]

    def _give(self, source: Source, port: str, message: Any, tick: int) -> None:
        stamp = round(tick * PERIOD * 1e9)
        give(self.cell.cell, KEYS.port(*source, port), message, tick, stamp_ns=stamp)


def test_after_a_restart_it_goes_on_where_the_robot_is() -> None:
    """If it began at the start of the path, the robot would drive backwards until the reference has caught up."""
    follower = Follower([(0.0, 0.0), (30.0, 0.0)])
    assert follower.at(22.0, -0.3, 0.2, 1).progress == pytest.approx(22.0, abs=0.01)
    assert follower.at(22.02, -0.3, 0.2, 2).progress == pytest.approx(22.02, abs=0.01)


def test_after_a_restart_it_takes_the_leg_that_points_as_the_robot_does() -> None:
    there_and_back = [(0.0, 0.0), (20.0, 0.0), (20.0, 1.0), (0.0, 1.0)]
    there = Follower(there_and_back).at(8.0, 0.5, 0.0, 1)
    back = Follower(there_and_back).at(8.0, 0.5, 3.1, 1)
    assert there.progress == pytest.approx(8.0, abs=0.1) and back.pose.y == pytest.approx(1.0, abs=0.05)


def test_a_trajectory_near_the_robot_begins_at_its_start() -> None:
    loop = [(0.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (0.0, 0.1)]
    assert Follower(loop).at(0.0, 0.06, -1.5, 1).progress < 0.5
