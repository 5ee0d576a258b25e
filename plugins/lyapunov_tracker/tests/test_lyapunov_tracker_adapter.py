"""The tracker as a plugin."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from navloom import (
    Claim,
    Context,
    ControllerInput,
    Discovery,
    Point2D,
    Pose2D,
    PoseEstimate,
    Reference,
    RobotSpec,
    Trajectory,
    Twist2D,
)
from navloom_check.behaviour.behaviour_tier import claims_of
from navloom_lyapunov_tracker.adapter import LyapunovTracker
from navloom_lyapunov_tracker.params import LyapunovTrackerParams
from pydantic import ValidationError

SQUARE = np.array([[-0.4, -0.4], [0.4, -0.4], [0.4, 0.4], [-0.4, 0.4]])
ROBOT = RobotSpec(SQUARE, 1.2, 0.05, 0.3, 0.5, math.radians(25.0), 0.5, 1.0)
TRAJECTORY = Trajectory(1, np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.3], [9.0, 9.0, 0.0, 0.0, 0.0, 0.2]]))
PERIOD = 0.05


def make(**params):
    context = Context("main", PERIOD, ROBOT, np.random.default_rng, Pose2D(0.0, 0.0, 0.0))
    return LyapunovTracker(LyapunovTrackerParams(**params), context)


def seen(x, y, heading, speed=0.3, turn_to=None):
    """The robot at a pose, its reference re-projected on the x axis."""
    twist, covariance = Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3))
    reference = Reference(1, x, 9.0 - x, Pose2D(x, 0.0, 0.0), speed, 0.0, y, Point2D(x + 1.0, 0.0),
                          np.array([[x, 0.0], [x + 1.0, 0.0]]), 0.4, turn_to)  # fmt: skip
    return ControllerInput(0, TRAJECTORY, reference, PoseEstimate(0, Pose2D(x, y, heading), twist, covariance))


def drive(tracker, x, y, heading, seconds):
    """x, y, heading, v over time, (n, 4), of a robot that drives exactly as commanded."""
    track = []
    for _ in range(round(seconds / PERIOD)):
        twist = tracker.control(seen(x, y, heading)).twist
        w = max(-ROBOT.max_angular, min(ROBOT.max_angular, twist.wz))
        x += twist.vx * PERIOD * math.cos(heading + 0.5 * w * PERIOD)
        y += twist.vx * PERIOD * math.sin(heading + 0.5 * w * PERIOD)
        heading = (heading + w * PERIOD + math.pi) % (2.0 * math.pi) - math.pi
        track.append((x, y, heading, twist.vx))
    return np.array(track)


def test_it_is_found_by_its_name():
    assert Discovery().role("controller", "lyapunov_tracker") is LyapunovTracker


def test_the_check_requires_its_role_and_the_symmetries_of_the_plane():
    assert claims_of(LyapunovTracker) == {Claim.SETTLES, Claim.TRANSLATION, Claim.ROTATION, Claim.MIRROR}


def test_the_command_is_law_6_and_carries_the_errors():
    command = make(k1=2.0).control(seen(1.0, -0.2, math.radians(-30.0)))
    assert (command.e1, command.e2, command.e3) == pytest.approx((-0.1, 0.1 * math.sqrt(3.0), math.pi / 6.0))
    assert command.twist.vx == pytest.approx(0.3 * math.sqrt(0.75) - 0.2)
    assert command.twist.vy == 0.0
    assert command.twist.wz == pytest.approx(0.1 * math.pi + 0.3 * 0.1 * math.sqrt(3.0) * 3.0 / math.pi)


@pytest.mark.parametrize("name", ["robust", "printed"])
def test_k1_is_1_and_k3_is_0_6(name: str) -> None:
    """0.1 m behind its reference and 0.5 rad to the left of its heading, on the path: e = (0.1, 0, -0.5)."""
    ahead = seen(0.0, 0.0, 0.5)
    error = replace(
        ahead, reference=replace(ahead.reference, pose=Pose2D(0.1 * math.cos(0.5), 0.1 * math.sin(0.5), 0.0))
    )
    twist = make(**LyapunovTracker.presets[name].values()).control(error).twist
    assert (twist.vx, twist.wz) == (pytest.approx(0.3 * math.cos(0.5) + 0.1), pytest.approx(-0.3))


@pytest.mark.parametrize(("heading", "turn"), [(90.0, -25.0), (-90.0, 25.0)])
def test_it_turns_in_place_to_the_nearer_side_as_fast_as_the_robot_can(heading: float, turn: float) -> None:
    twist = make().control(seen(0.0, 0.0, math.radians(heading))).twist
    assert (twist.vx, math.degrees(twist.wz)) == (0.0, pytest.approx(turn))


def test_it_turns_in_place_from_60_degrees_on_until_20() -> None:
    for heading, is_turning in ((59.0, False), (61.0, True)):
        assert (make().control(seen(0.0, 0.0, math.radians(heading))).twist.vx == 0.0) is is_turning
    tracker = make()
    assert [tracker.control(seen(0.0, 0.0, math.radians(h))).twist.vx == 0.0 for h in (61, 21, 19, 21)] == [
        True, True, False, False,
    ]  # fmt: skip


def test_the_errors_are_those_of_a_reference_off_the_axis() -> None:
    """The robot at (1, 2) looks along y; the reference at (0.5, 2.4) and 100 degrees: 0.4 m ahead, 0.5 m left."""
    ahead = seen(1.0, 2.0, math.radians(90.0))
    reference = replace(ahead.reference, pose=Pose2D(0.5, 2.4, math.radians(100.0)))
    command = make().control(replace(ahead, reference=reference))
    assert (command.e1, command.e2, command.e3) == pytest.approx((0.4, 0.5, math.radians(10.0)))


def test_a_robot_that_faces_away_turns_in_place_and_then_follows():
    track = drive(make(), 0.0, 0.1, math.radians(179.0), 25.0)
    turning = track[:, 3] == 0.0
    ends = int(np.argmin(turning))
    assert not turning[ends:].any(), "it turns once"
    assert ends * PERIOD == pytest.approx((179.0 - 20.0) / 25.0, abs=2 * PERIOD)
    assert track[:ends, :2] == pytest.approx(np.tile([0.0, 0.1], (ends, 1)))
    assert track[:, 3].min() >= 0.0, "it never drives backwards"
    assert track[-1, 1:3] == pytest.approx([0.0, 0.0], abs=0.02)


def test_the_printed_law_drives_backwards_when_it_faces_away():
    command = make(**LyapunovTracker.presets["printed"].values()).control(seen(0.0, 0.0, math.radians(170.0)))
    assert command.twist.vx == pytest.approx(0.3 * math.cos(math.radians(170.0)))


def test_noise_about_180_degrees_does_not_stop_the_turn():
    tracker = make()
    signs = {
        math.copysign(1.0, tracker.control(seen(0.0, 0.0, math.radians(h))).twist.wz) for h in (179, -179, 178, -178)
    }
    assert signs == {-1.0}


def test_reset_forgets_the_turn():
    tracker = make()
    between = seen(0.0, 0.0, math.radians(40.0))
    tracker.control(seen(0.0, 0.0, math.radians(90.0)))
    assert tracker.control(between).twist.vx == 0.0
    tracker.reset()
    assert tracker.control(between).twist.vx > 0.0


@pytest.mark.parametrize(
    "wrong",
    [{"k1": 0.0}, {"k3": -1.0}, {"k2": 1.0}, {"k3": math.inf}, {"turn_in_place_above_deg": 15.0}, {"k1": 21.0}],
)
def test_parameters_out_of_bounds_are_refused(wrong):
    with pytest.raises(ValidationError):
        LyapunovTrackerParams(**wrong)


def test_at_the_goal_it_turns_to_the_goal_heading_and_stops():
    tracker = make()
    left = tracker.control(seen(9.0, 0.0, 0.0, turn_to=1.0)).twist
    assert (left.vx, left.wz) == (0.0, ROBOT.max_angular)
    # 0.1 rad beyond it: back at twice the error per second.
    back = tracker.control(seen(9.0, 0.0, 1.1, turn_to=1.0)).twist
    assert (back.vx, back.wz) == (0.0, pytest.approx(-0.2))
