"""Tracked bodies: prediction at constant velocity, and lasers without their echoes."""

import math

import numpy as np
import pytest
from navloom import Tracks
from navloom_avoidance.beams import Beams
from navloom_avoidance.bodies import NO_BODIES, TrackedBodies, without_bodies


def message(stamp_ns=0):
    """One body at (2, 0) with (-1, 0.5) m/s; standard deviations 0.3 m and 0.4 m/s along x, 0.1 m and 0 along y."""
    spread = np.diag([0.09, 0.01, 0.16, 0.0])[None]
    velocity = np.array([[-1.0, 0.5]])
    return Tracks(stamp_ns, np.array([7]), np.array([[2.0, 0.0]]), velocity, spread, np.array([0.3]), np.zeros(1))


def test_bodies_move_on_to_the_time_of_the_tick():
    bodies = TrackedBodies.of(message(1_000_000_000), 1_200_000_000)
    assert bodies.positions.tolist() == [pytest.approx([1.8, 0.1])]


def test_the_place_grows_less_sure_with_time():
    """After 1 s, the variance along x is 0.09 + 0.16 m²."""
    bodies = TrackedBodies.of(message(), 0)
    assert bodies.sigmas().tolist() == pytest.approx([0.3])
    assert bodies.after(1.0).sigmas().tolist() == pytest.approx([0.5])


def test_without_a_message_there_is_no_body():
    assert len(TrackedBodies.of(None, 0).radii) == 0
    assert len(NO_BODIES.after(1.0).sigmas()) == 0


def test_only_those_within_reach_are_near():
    bodies = TrackedBodies.of(message(), 0)
    assert len(bodies.within((0.0, 0.0), 2.1).radii) == 1
    assert len(bodies.within((0.0, 0.0), 1.9).radii) == 0


def test_beams_on_a_body_say_nothing():
    """Four beams from (1, 0), heading along y: on the body, 0.2 m beside its disc, without an echo, on a wall."""
    ranges, bearings = np.array([0.7, 0.5, math.inf, 3.0]), np.radians([-90.0, -90.0, -90.0, 0.0])
    beams = Beams.fixed(
        np.zeros((4, 2)), bearings, np.zeros(4), ranges, np.tile([0.1, 9.0], (4, 1)), np.zeros(4, np.int64)
    )
    seen = without_bodies(beams, (1.0, 0.0, 0.5 * math.pi), TrackedBodies.of(message(), 0))
    assert seen.ranges.tolist() == [0.0, 0.5, math.inf, 3.0]


def test_without_bodies_the_readings_are_the_same():
    beams = Beams.sample()
    assert without_bodies(beams, (0.0, 0.0, 0.0), NO_BODIES) is beams
