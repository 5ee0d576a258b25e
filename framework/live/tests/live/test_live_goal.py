"""The live goal node: the ticks of its steps, for platforms of any period and under many requests."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from cell_rig import give, silent_bus
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import own_node
from navloom.engine.nodes.goal_node import GoalNode
from navloom.messages import OperatorRequest, Pose2D, PoseEstimate, Twist2D
from navloom_live.live import live_goal
from navloom_live.live.live_goal import LiveGoal
from navloom_live.live.live_node_builder import Hosted, make_cell
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.run_clock import RunClock
from navloom_live.transport.keyspace import KeySpace

KEYS = KeySpace("lab", "r1")
LOOKS = 20
"""Times that the goal looks at its inputs within a tick."""


class Goal:
    """The runner of the goal, on a clock that the test sets.

    Args:
        period: Control period, s.
    """

    def __init__(self, period: float, monkeypatch: pytest.MonkeyPatch) -> None:
        self.system = assemble(load_config("paper", [f"run.period={period}", "navigation.drive=false"]))
        self.period, self.now_s = period, 100.0
        monkeypatch.setattr(live_goal, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        self.clock = RunClock(lambda: round(self.now_s * 1e9))
        node = own_node(self.system, "goal", lambda role, name: False, is_live=True)
        assert isinstance(node, GoalNode)
        self.hosted: Hosted = make_cell(
            self.system, ("goal", "main"), node, Switchboard(silent_bus(), KEYS, lossless=False)
        )
        self.runner = LiveGoal(self.hosted, self.clock, period, lambda: False)

    @property
    def stepped(self) -> int:
        """Tick of its last step."""
        return self.runner.stepper.stepped

    def tick(self, number: int, requests: int = 0, is_posed: bool = True) -> None:
        """One tick of the platform and its pose, and looks until the next, with requests spread over them."""
        stamp = round(number * self.period * 1e9)
        self.clock.observe(stamp, round(self.now_s * 1e9), number)
        if is_posed:
            name = self.system.config.localizer.instance
            pose = PoseEstimate(stamp, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
            give(self.hosted.cell, KEYS.port("localizer", name, "pose"), pose, number, stamp_ns=stamp)
        for look in range(LOOKS):
            if look < requests:
                self.runner.submit(OperatorRequest("cancel"))
            self.runner.take_in()
            self.runner.act()
            self.now_s += self.period / LOOKS


@pytest.mark.parametrize("period", [0.05, 0.2, 0.5, 1.0])
def test_its_steps_keep_to_the_ticks_of_the_platform(period: float, monkeypatch: pytest.MonkeyPatch) -> None:
    goal = Goal(period, monkeypatch)
    for number in range(40):
        goal.tick(number)
        assert goal.stepped == number


@pytest.mark.parametrize("period", [0.05, 0.5])
def test_many_requests_do_not_move_it_ahead_of_the_platform(period: float, monkeypatch: pytest.MonkeyPatch) -> None:
    goal = Goal(period, monkeypatch)
    for number in range(20):
        goal.tick(number, requests=LOOKS)
        assert goal.stepped <= number + 1
    goal.tick(20)
    assert goal.runner.goal.submitted == []  # none waits


def test_without_poses_it_still_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    goal = Goal(0.5, monkeypatch)
    for number in range(10):
        goal.tick(number, is_posed=False)
    assert 6 <= goal.stepped <= 9
