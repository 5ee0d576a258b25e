"""The reference waits for a robot that is slow to turn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from limits import speed_limits
from navloom.engine.nodes.reference_node import ReferenceNode
from navloom.navigation.trajectory import keep_corners
from navloom.navigation.trajectory_projection import project


def speeds(turn_acceleration: float, away: float) -> tuple[float, float]:
    """Speed, m/s, and turn rate, rad/s, of the reference on a line for a robot turned away by an angle, rad."""
    limits = speed_limits(max_angular_acceleration=turn_acceleration)
    samples = keep_corners(np.array([[0.0, 0.0], [4.0, 0.0]]), limits).samples
    return ReferenceNode(limits, 1.0, 0.3)._speeds(project(samples, 2.0, 0.0, away, 2.0, 1.0), away)


def test_a_robot_that_is_turned_away_gets_a_slow_reference() -> None:
    """0.4 rad at 0.4 rad/s² take 2 s; at 0.125 m/s the robot comes 5 cm beside: 0.125 * 0.4 * sqrt(0.4 / 0.4)."""
    assert speeds(0.4, -0.4)[0] == pytest.approx(0.125)


def test_a_reference_keeps_moving() -> None:
    assert speeds(0.1, 3.0)[0] == pytest.approx(0.04), "a tenth of 0.4 m/s"


def test_a_robot_on_its_trajectory_gets_its_speed() -> None:
    assert speeds(0.2, 0.0)[0] == pytest.approx(0.4)


def test_a_robot_without_a_limit_gets_the_speed_of_the_trajectory() -> None:
    assert speeds(math.inf, 3.0)[0] == pytest.approx(0.4)
