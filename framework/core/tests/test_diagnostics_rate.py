"""When an avoider gives diagnostics: at the declared rate, and when it becomes trapped."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import Avoidance, Avoider, AvoiderInput, Context, Pose2D, RobotSpec, Twist2D
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble

TICK_NS = 50_000_000
ROBOT = RobotSpec(np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]]), 0.3, 0.05, 0.1, 0.5, 1.0, 0.5, 1.0)


class Still(Avoider):
    """Stays where it is."""

    name = "still"

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return Avoidance(Twist2D(0.0, 0.0, 0.0), "clear")


def ticks_explained(rate_hz: float, statuses: list[str]) -> list[int]:
    """Ticks of 0.05 s in which an avoider with these statuses gives diagnostics."""
    context = Context(
        "main", 0.05, ROBOT, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0), diagnostics_rate_hz=rate_hz
    )
    avoider = Still(Still.Params(), context)
    return [tick for tick, status in enumerate(statuses) if avoider.is_to_explain(tick * TICK_NS, status)]


@pytest.mark.parametrize(
    ("rate_hz", "ticks"),
    [(2.0, [0, 10, 20]), (20.0, list(range(21))), (1000.0, list(range(21))), (math.inf, list(range(21))), (0.0, [])],
)
def test_diagnostics_are_due_at_the_declared_rate(rate_hz: float, ticks: list[int]) -> None:
    assert ticks_explained(rate_hz, ["clear"] * 21) == ticks


def test_a_robot_that_becomes_trapped_gives_diagnostics_at_once_and_once() -> None:
    assert ticks_explained(2.0, ["steering", "steering", "trapped", "trapped", "steering", "trapped"]) == [0, 2, 5]


def test_only_an_avoider_has_a_rate_of_diagnostics() -> None:
    with pytest.raises(ConfigError, match=r"mapper\.diagnostics_rate_hz: only the avoider gives diagnostics"):
        assemble(load_config("paper", ["mapper.diagnostics_rate_hz=2.0"]))
