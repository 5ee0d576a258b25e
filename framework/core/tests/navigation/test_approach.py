"""The approach to a goal: only a profile that is too fast for the tolerance is changed."""

from __future__ import annotations

import numpy as np
import pytest
from limits import speed_limits
from navloom.navigation.approach import least_tolerance, slow_down
from navloom.navigation.braking import Braking
from navloom.navigation.trajectory import keep_corners
from navloom.testing import robot

ROBOT = Braking(robot(motor_lag=0.1, dead_time=0.05), 0.05)
"""It drives on for 0.2 s before it brakes at 1 m/s²."""
LINE = keep_corners(np.array([(0.0, 0.0), (3.0, 0.0)]), speed_limits(), 0.01).samples


def test_the_way_to_standstill_and_the_speed_for_a_way_are_inverse() -> None:
    assert ROBOT.way(0.4) == pytest.approx(0.4 * 0.2 + 0.5 * 0.16)
    assert ROBOT.speed_within(0.16) == pytest.approx(0.4)


def test_a_profile_that_is_slow_enough_is_the_same_array() -> None:
    """At 0.2 m from the end the speed is 0.4 m/s: 0.16 m to standstill, of at most 0.3 m."""
    assert slow_down(LINE, ROBOT, 0.2) is LINE


def test_a_small_tolerance_is_entered_with_a_speed_that_it_is_enough_for() -> None:
    """v t + v² / 2a = 0.02 m for v = 0.0828 m/s; half of it at the end."""
    slowed = slow_down(LINE, ROBOT, 0.02)
    left = LINE[-1, 0] - LINE[:, 0]
    assert slowed[np.argmin(np.abs(left - 0.02)), 5] == pytest.approx(0.0828, abs=1e-4)
    assert slowed[-1, 5] == pytest.approx(0.0414, abs=1e-4)
    assert (slowed[:, :5] == LINE[:, :5]).all() and (slowed[:, 5] <= LINE[:, 5]).all() and not slowed.flags.writeable


@pytest.mark.parametrize("tolerance", [0.005, 0.02, 0.05])
def test_the_speed_falls_no_faster_than_the_robot_can_follow(tolerance: float) -> None:
    """v dv/ds is at most v(entry) / 2 in 0.2 s before the tolerance, and at most the deceleration everywhere."""
    slowed = slow_down(LINE, ROBOT, tolerance)
    loss = -0.5 * np.diff(slowed[:, 5] ** 2) / LINE[1, 0]
    v = ROBOT.speed_within(tolerance)
    is_before = LINE[1:, 0] <= 3.0 - tolerance
    changed = slowed[1:, 5] < LINE[1:, 5]
    assert loss[is_before & changed].max() <= 0.5 * v / 0.2 + 1e-6
    assert loss.max() <= 1.0 + 1e-6


def test_the_least_tolerance_is_the_way_to_standstill_from_1_cm_a_second() -> None:
    assert least_tolerance(ROBOT) == pytest.approx(0.01 * 0.2 + 0.5e-4)
