"""Obstacles of a robot with a laser and sonars: what the laser explains is no arc, what it does not see is one."""

import math

import numpy as np
import pytest
from navloom_avoidance.beams import Beams
from navloom_avoidance.clearance import footprint_edges
from navloom_avoidance.echoes import Echoes, EchoSettings

EDGES = footprint_edges(np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]]))
HALF = 0.26
AHEAD = (0.0, 0.0, 0.0)


def sonar(reading: float) -> Beams:
    """One sonar that looks straight ahead from the base; it measures from 0.3 m."""
    one = np.zeros(1)
    return Beams.fixed(
        np.zeros((1, 2)), one, np.full(1, HALF), np.full(1, reading), np.array([[0.3, 4.0]]), np.ones(1, np.int64)
    )


def laser(*posts: tuple[float, float]) -> Beams:
    """A laser with one beam to each post, by bearing, rad, and distance, m."""
    bearings, ranges = np.array(posts).reshape(-1, 2).T.copy()
    n = len(posts)
    return Beams.fixed(
        np.zeros((n, 2)), bearings, np.zeros(n), ranges, np.tile([0.05, 10.0], (n, 1)), np.zeros(n, np.int64)
    )


def obstacles(*ticks: tuple[Beams, ...]) -> np.ndarray:
    """(n, 2) obstacles after ticks of lasers, if any, and a sonar, m, base frame."""
    echoes = Echoes(EDGES, EchoSettings((0.05, 0.05), 5.0, 3.0))
    for tick, (*lasers, cone) in enumerate(ticks):
        found, _ = echoes.see(lasers, cone, AHEAD, 0.05 * tick)
    return found[:, :2]


LEFT, RIGHT = (HALF, 0.8), (-HALF, 0.8)


def test_between_two_door_posts_there_is_nothing():
    found = obstacles((laser(LEFT, RIGHT), sonar(0.8)))
    assert len(found) == 2 and abs(found[:, 1]).min() > 0.2


def test_glass_between_two_posts_is_an_obstacle_once_the_posts_are_beside_the_cone():
    """A pane of 1 m whose frame a laser sees; from 0.5 m the cone spans 0.27 m of it."""
    frame = laser((0.25 * math.pi, math.hypot(0.5, 0.5)), (-0.25 * math.pi, math.hypot(0.5, 0.5)))
    found = obstacles((frame, sonar(0.5)))
    assert (np.hypot(found[:, 0] - 0.5, found[:, 1]) < 0.1).any()


@pytest.mark.parametrize(("reading", "is_explained"), [(0.89, True), (0.71, True), (0.91, False), (0.69, False)])
def test_a_point_explains_an_echo_within_10_cm(reading: float, is_explained: bool):
    assert (len(obstacles((laser(LEFT), sonar(reading)))) == 1) is is_explained


def test_an_explained_echo_clears_what_lies_before_it():
    """A false echo at 0.5 m is forgotten, as by a reading of another thing at 0.8 m; but for cells at the flanks."""
    false = (laser((math.pi, 2.0)), sonar(0.5))

    def on_axis(*ticks):
        return int((np.hypot(*(obstacles(*ticks) - (0.5, 0.0)).T) < 0.1).sum())

    assert on_axis(false) > 0 and on_axis(false, (laser(LEFT), sonar(0.8))) == 0


@pytest.mark.parametrize(("distance", "is_explained"), [(0.25, True), (0.39, True), (0.41, False)])
def test_a_blind_sonar_is_explained_by_a_nearer_point(distance: float, is_explained: bool):
    assert (len(obstacles((laser((0.0, distance)), sonar(0.3)))) == 1) is is_explained


def test_a_robot_without_a_laser_keeps_every_arc():
    assert len(obstacles((sonar(0.8),))) > 3
