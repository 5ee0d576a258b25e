"""Each value of the trackers' presets, through the plugin: the velocity for an error that is worked out by hand.

The robot's own limits are wide, so that the gains show.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import Context, ControllerInput, Point2D, Pose2D, PoseEstimate, Reference, RobotSpec, Trajectory, Twist2D
from navloom_lyapunov_tracker.law import TrackingError
from navloom_trackers import fierro_lewis, kanayama
from navloom_trackers.adapter import FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit

TRACKERS = {cls.name: cls for cls in (FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit)}
LAWS = pytest.mark.parametrize("name", ["kanayama", "fierro_lewis", "ramsete"])
SQUARE = np.array([[-0.4, -0.4], [0.4, -0.4], [0.4, 0.4], [-0.4, 0.4]])
STRONG = RobotSpec(SQUARE, 1.2, 0.05, 0.3, 9.0, 90.0, 0.5, 1.0)
ALONG = np.linspace(0.0, 9.0, 9001)
TRAJECTORY = Trajectory(1, np.column_stack((ALONG, ALONG, 0 * ALONG, 0 * ALONG, 0 * ALONG, 0 * ALONG + 0.3)))
PERIOD = 0.05


def commanded(name, preset, y=0.0, heading=0.0, speed=0.3, remaining=8.0):
    """Speed, m/s, and turn rate, rad/s, for a reference at 0.3 m/s on the x axis; y in m, heading in rad."""
    cls = TRACKERS[name]
    params = cls.Params(**cls.presets[preset].values())
    plugin = cls(params, Context("main", PERIOD, STRONG, np.random.default_rng, Pose2D(0.0, 0.0, 0.0)))
    reference = Reference(1, 1.0, remaining, Pose2D(1.0, 0.0, 0.0), 0.3, 0.0, y, Point2D(2.0, 0.0),
                          np.array([[1.0, 0.0], [2.0, 0.0]]), 0.4, None)  # fmt: skip
    estimate = PoseEstimate(0, Pose2D(1.0, y, heading), Twist2D(speed, 0.0, 0.0), np.zeros((3, 3)))
    twist = plugin.control(ControllerInput(0, TRAJECTORY, reference, estimate)).twist
    return twist.vx, twist.wz


E1, E2, E3 = 0.02 * math.sin(0.1), 0.02 * math.cos(0.1), -0.1
"""Errors of a robot 2 cm to the right of the line and turned to the left by 0.1 rad."""


@pytest.mark.parametrize(("preset", "k_x"), [("printed", 10.0), ("robust", 1.0)])
def test_kanayama(preset, k_x):
    """K_y = 64 and K_theta = 16 in both."""
    wanted = (0.3 * math.cos(0.1) + k_x * E1, 0.3 * (64.0 * E2 + 16.0 * math.sin(E3)))
    assert commanded("kanayama", preset, -0.02, 0.1) == pytest.approx(wanted)


@pytest.mark.parametrize(("preset", "k1"), [("printed", 10.0), ("robust", 1.0)])
def test_fierro_lewis(preset, k1):
    """k_2 = 5, k_3 = 4, and the velocity follows the law at 40 1/s in both."""
    error = TrackingError(E1, E2, E3)
    moved = fierro_lewis.projected_speed(0.3, E3, 0.0, -0.02)
    rates = kanayama.error_rates(error, 0.3, 0.0, moved, 0.0)
    v, w = fierro_lewis.kinematic_command(error, 0.3, 0.0, k1, 5.0, 4.0)
    v_rate, w_rate = fierro_lewis.command_rates(error, rates, 0.3, k1, 5.0, 4.0)
    wanted = tuple(
        law + rate * PERIOD + (now - law) * math.exp(-40.0 * PERIOD)
        for law, rate, now in ((v, v_rate, 0.3), (w, w_rate, 0.0))
    )
    assert commanded("fierro_lewis", preset, -0.02, 0.1) == pytest.approx(wanted)


@pytest.mark.parametrize("preset", ["printed", "robust"])
def test_ramsete(preset):
    """k = 2 * 0.7 * sqrt(16 * 0.3^2) = 1.68."""
    wanted = (0.3 * math.cos(0.1) + 1.68 * E1, 1.68 * E3 + 16.0 * 0.3 * E2 * math.sin(0.1) / 0.1)
    assert commanded("ramsete", preset, -0.02, 0.1) == pytest.approx(wanted)


@LAWS
def test_as_printed_the_law_alone_turns_the_robot_and_drives_it_backwards(name):
    v, _ = commanded(name, "printed", heading=math.radians(150.0), speed=0.3 * math.cos(math.radians(150.0)))
    assert v < -0.2
    v, _ = commanded(name, "printed", heading=math.radians(70.0), speed=0.3 * math.cos(math.radians(70.0)))
    assert v > 0.04  # the robust presets turn in place here


@LAWS
def test_robust_turns_in_place_above_60_degrees_and_never_drives_backwards(name):
    assert commanded(name, "robust", heading=math.radians(61.0))[0] == 0.0
    assert commanded(name, "robust", heading=math.radians(59.0))[0] > 0.0


def test_far_beside_the_path_the_printed_law_is_not_bounded_and_robust_heads_back_at_45_degrees():
    """K_y e2 of 1 m gives 0.3 * 64 = 19.2 rad/s; at 45 degrees to the path the robust law turns no further."""
    assert commanded("kanayama", "printed", -1.0)[1] == pytest.approx(19.2)
    assert commanded("kanayama", "robust", -1.0, math.radians(45.0))[1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("preset", "speed", "look_ahead"),
    [("printed", 0.1, 0.3), ("printed", 0.4, 0.6), ("printed", 2.0, 0.9),
     ("robust", 0.1, 0.5), ("robust", 0.4, 0.6), ("robust", 2.0, 0.9)],
)  # fmt: skip
def test_pure_pursuit_looks_ahead_by_1_5_s_within_its_bounds(preset, speed, look_ahead):
    """2 cm beside the line: the curvature is 2 * 0.02 / L^2."""
    v, w = commanded("pure_pursuit", preset, -0.02, speed=speed)
    assert v == pytest.approx(0.3)
    assert w / v == pytest.approx(0.04 / look_ahead**2, rel=0.01)


@pytest.mark.parametrize("preset", ["printed", "robust"])
def test_pure_pursuit_slows_on_arcs_tighter_than_0_9_m(preset):
    """Look-aheads of 0.45 and 0.5 m: arcs of 0.506 and 0.625 m; 0.3 / (0.9 * curvature) is 0.169 and 0.208 m/s."""
    v, w = commanded("pure_pursuit", preset, -0.2)
    curvature = w / v
    assert v == pytest.approx(max(0.3 / (0.9 * curvature), 0.25 if preset == "printed" else 0.1))
    assert (v == pytest.approx(0.25)) == (preset == "printed")


@pytest.mark.parametrize("preset", ["printed", "robust"])
def test_pure_pursuit_slows_within_0_6_m_of_the_end_to_0_05_m_per_s(preset):
    assert commanded("pure_pursuit", preset, remaining=0.3)[0] == pytest.approx(0.15)
    assert commanded("pure_pursuit", preset, remaining=0.01)[0] == pytest.approx(0.05)


@pytest.mark.parametrize(("preset", "angle"), [("printed", 45.0), ("robust", 60.0)])
def test_pure_pursuit_turns_in_place_above_its_angle(preset, angle):
    assert commanded("pure_pursuit", preset, heading=math.radians(-angle - 1.0))[0] == 0.0
    assert commanded("pure_pursuit", preset, heading=math.radians(-angle + 1.0))[0] > 0.0


@pytest.mark.parametrize("preset", ["printed", "robust"])
def test_graceful_has_the_papers_gains(preset):
    """2 cm of 0.2 m to the left: asin 0.1 = 0.10017. 3 (0.10017 + 0.09984) + 1.99007 * 0.1 = 0.79903, over 0.2 m."""
    v, w = commanded("graceful", preset, -0.02)
    assert w / v == pytest.approx(0.79903 / 0.2, rel=0.01)


def test_graceful_turns_in_place_above_60_degrees_and_as_printed_drives_on():
    assert commanded("graceful", "robust", heading=math.radians(61.0))[0] == 0.0
    assert commanded("graceful", "printed", heading=math.radians(61.0))[0] > 0.0


def test_as_printed_regulated_pure_pursuit_has_the_look_ahead_of_nav2():
    """2 cm beside the line at 0.4 m/s: 1.5 s of it are 0.6 m, so 2 * 0.02 / 0.36 1/m."""
    v, w = commanded("regulated_pure_pursuit", "printed", -0.02, speed=0.4)
    assert w / v == pytest.approx(0.04 / 0.36, rel=0.01)
