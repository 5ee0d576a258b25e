"""How a robot comes to rest: its way, its angle, its speed for a way, its patience, and when it stands."""

from __future__ import annotations

import math

import pytest
from limits import with_robot
from navloom.messages import Twist2D
from navloom.navigation.braking import Braking, Ending, Standstill
from navloom.testing import robot

SOFT = Braking(
    robot(max_deceleration=0.8, motor_lag=0.15, dead_time=0.06, max_linear=0.6, max_angular_acceleration=1.6), 0.04
)
"""It drives on for 0.04 + 0.06 + 0.15 = 0.25 s before it brakes."""
STILL = Twist2D(0.0, 0.0, 0.0)


def test_a_robot_drives_on_for_a_tick_the_dead_time_and_the_lag() -> None:
    assert SOFT.delay == pytest.approx(0.25)
    assert Braking(robot(), 0.05).delay == pytest.approx(0.05)


def test_the_way_to_standstill_is_that_of_the_delay_and_of_the_ramp() -> None:
    """0.4 m/s · 0.25 s + 0.16 m²/s² / 1.6 m/s²."""
    assert SOFT.way(0.4) == pytest.approx(0.1 + 0.1)
    assert SOFT.speed_within(0.2) == pytest.approx(0.4)
    assert SOFT.speed_within(0.0) == pytest.approx(0.0)


@pytest.mark.parametrize("rate", [0.8, -0.8])
def test_the_angle_to_standstill_has_the_turn_deceleration(rate: float) -> None:
    """0.8 rad/s · 0.25 s + 0.64 rad²/s² / 3.2 rad/s²; without a limit, the delay alone."""
    assert SOFT.turn(rate) == pytest.approx(0.2 + 0.2)
    assert with_robot(SOFT, max_angular_acceleration=math.inf).turn(rate) == pytest.approx(0.2)


def test_the_patience_is_the_longest_ramp_and_all_delays_and_a_second() -> None:
    """0.6 / 0.8 s, 0.25 s, five lags of 0.15 s, and 1 s."""
    assert SOFT.patience == pytest.approx(0.75 + 0.25 + 0.75 + 1.0)


@pytest.mark.parametrize(
    ("vx", "wz", "stands"),
    [
        (0.005, 0.0, True), (-0.005, 0.0, True), (0.0051, 0.0, False), (-0.0051, 0.0, False),
        (0.0, 0.005, True), (0.0, -0.005, True), (0.0, 0.0051, False), (0.0, -0.0051, False),
    ],
)  # fmt: skip
def test_a_robot_stands_below_5_mm_and_5_mrad_a_second(vx: float, wz: float, stands: bool) -> None:
    assert Standstill(SOFT).stands(Twist2D(vx, 0.0, wz), 0.0) is stands


def test_a_robot_does_not_stand_while_a_command_may_be_on_its_way() -> None:
    """A dead time of 0.06 s and a tick of 0.04 s after the last command; a command of zero changes nothing."""
    standstill = Standstill(SOFT)
    standstill.note(True, 2.0)
    standstill.note(False, 2.04)
    assert not standstill.stands(STILL, 2.0999) and standstill.stands(STILL, 2.1)
    standstill.note(True, 2.2)
    assert not standstill.stands(STILL, 2.25)


def over(
    idle: tuple[bool, ...], commanded: tuple[bool, ...], measured: Twist2D | None = STILL, last_request: int = 0
) -> list[bool]:
    """Whether a run of ticks from 1 on ends, tick by tick, with a period of 0.04 s."""
    ending = Ending(SOFT, last_request)
    return [
        ending.is_over(number, is_idle, moves, measured)
        for number, (is_idle, moves) in enumerate(zip(idle, commanded, strict=True), 1)
    ]


def test_a_run_ends_in_the_first_idle_tick_in_which_no_command_is_on_its_way() -> None:
    """The last command is that of tick 2: 0.1 s later is between ticks 4 and 5."""
    assert over((False, True, True, True, True), (True, True, False, False, False)) == [False] * 4 + [True]


def test_a_run_does_not_end_before_its_last_request() -> None:
    assert over((True,) * 4, (False,) * 4, last_request=3) == [False, False, False, True]


def test_a_run_without_odometry_ends_at_once() -> None:
    assert over((False, True), (True, True), None) == [False, True]


def test_a_robot_that_slides_is_waited_for_as_long_as_its_patience() -> None:
    """2.75 s are 68.75 ticks of 0.04 s: from tick 5, in which the second goal ends, to tick 74."""
    idle = (True, True, False, False) + (True,) * 80
    found = over(idle, (False,) * 84, Twist2D(0.1, 0.0, 0.0))
    assert found.index(True) + 1 == 74
