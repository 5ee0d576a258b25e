"""Tracked bodies on arcs: where they are at each time, what nearness and a contact cost, and what the robot does."""

import math

import numpy as np
import pytest
from navloom_avoidance.beams import Beams
from navloom_avoidance.bodies import TrackedBodies
from navloom_avoidance.clearance import footprint_edges
from navloom_avoidance.robot import Robot
from navloom_dwa.avoidance import DynamicWindow, Given
from navloom_dwa.moving import bodies_ahead, gap_to, score_bodies
from navloom_dwa.params import DwaParams

JACKAL = np.array([[0.229, 0.208], [-0.229, 0.208], [-0.229, -0.208], [0.229, -0.208]])
EDGES = footprint_edges(JACKAL)
HERE = (0.0, 0.0, 0.0)
TIMES = np.array([1.0, 2.0, 3.0, 4.0])
STRAIGHT = np.array([[1.0, 0.0, 0.0, 1.0]])
"""One arc, straight ahead, of up to 1 m/s."""


def body(x, y, vx=0.0, vy=0.0, spread=0.0):
    """A body of radius 0.3 m, whose velocity has a standard deviation, m/s."""
    covariance = np.diag([0.0, 0.0, spread**2, spread**2])[None]
    return TrackedBodies(np.array([[x, y]]), np.array([[vx, vy]]), np.full(1, 0.3), covariance)


def ahead(bodies, pose=HERE, times=TIMES, sigmas=1.0):
    return bodies_ahead(bodies, pose, times, EDGES, 0.1, 0.3, sigmas)


def test_bodies_move_at_constant_velocity_in_the_base_frame():
    """From (1, 2), heading along y, a body at (1, 5) is 3 m ahead; moving along x, it is 1 m to the right after 1 s."""
    found = ahead(body(1.0, 5.0, 1.0), (1.0, 2.0, 0.5 * math.pi), np.array([0.0, 1.0]))
    assert found[:, 0, :2].tolist() == [pytest.approx([3.0, 0.0]), pytest.approx([3.0, -1.0])]


def test_margin_and_radius_are_kept_and_uncertainty_widens_the_nearness():
    """0.3 m and 0.1 m; after 1 s, a velocity that is 0.2 m/s unsure adds 0.2 m to the width of 0.3 m."""
    found = ahead(body(3.0, 0.0, spread=0.2), times=np.array([0.0, 1.0]))
    assert found[:, 0, 2].tolist() == pytest.approx([0.4, 0.4])
    assert found[:, 0, 3].tolist() == pytest.approx([0.3, 0.5])


def test_a_body_within_its_margin_may_stay_as_near():
    """0.5 m ahead of the axle is 0.271 m ahead of the front."""
    assert ahead(body(0.5, 0.0))[0, 0, 2] == pytest.approx(0.271, abs=1e-5)


def test_the_gap_is_that_of_the_footprint():
    """0.8 m ahead: 0.571 m before the front, less 0.4 m. At 1.2 m it does not count."""
    found = ahead(body(1.2, 0.0))
    assert gap_to(found, 0, 0, 0.0, 0.0, 1.0, 0.0, EDGES) == pytest.approx(np.inf)
    near = ahead(body(0.8, 0.0))
    assert gap_to(near, 0, 0, 0.0, 0.0, 1.0, 0.0, EDGES) == pytest.approx(0.171)


def test_a_contact_costs_the_more_the_sooner_it_comes():
    """The body stands 2 m ahead. At 1 m/s, the front is within 0.4 m at 2 s, half of 4 s; at 0.25 m/s, it is never."""
    costs = np.zeros((1, 5))
    score_bodies(STRAIGHT, ahead(body(2.0, 0.0)), TIMES, EDGES, 0.0, 10.0, costs)
    assert costs[0, -1] == pytest.approx(5.0)
    assert costs[0, :2].tolist() == [0.0, 0.0]


def test_nearness_is_averaged_and_stays_after_a_contact():
    """At 1 m/s nothing is near at 1 s; from the contact at 2 s on, nearness is 1: three of four."""
    costs = np.zeros((1, 2))
    score_bodies(STRAIGHT, ahead(body(2.0, 0.0)), TIMES, EDGES, 1.0, 0.0, costs)
    assert costs[0, 1] == pytest.approx(0.75)


def test_one_that_has_gone_by_then_costs_nothing():
    """It stands where the robot will be in 2 s, and leaves to the left at 1 m/s."""
    costs = np.zeros((1, 2))
    score_bodies(STRAIGHT, ahead(body(2.0, 0.0, 0.0, 1.0)), TIMES, EDGES, 1.0, 10.0, costs)
    assert costs.tolist() == [[0.0, 0.0]]


def test_what_is_not_admissible_stays_so():
    costs = np.full((1, 2), np.inf)
    score_bodies(STRAIGHT, ahead(body(2.0, 0.0)), TIMES, EDGES, 1.0, 10.0, costs)
    assert np.isinf(costs).all()


def drive(bodies_at, seconds, **params):
    """Last x of an ideal robot that drives along the x axis, and the least distance of both centres, m."""
    method = DynamicWindow(DwaParams(**params), Robot(JACKAL, 2.0, math.pi, 2.0, 2.0, half_track=0.19), 0.05)
    x, y, heading, twist, least = 0.0, 0.0, 0.0, (0.0, 0.0), math.inf
    for k in range(round(seconds / 0.05)):
        given = Given(0.05 * k, (x, y, heading), twist, (7.0, 0.0), 0.0, bodies=bodies_at(0.05 * k))
        decision = method.step([], None, given)
        twist = (decision.speed, decision.turn)
        heading = math.remainder(heading + 0.05 * twist[1], math.tau)
        x, y = x + 0.05 * twist[0] * math.cos(heading), y + 0.05 * twist[0] * math.sin(heading)
        least = min(least, math.dist((x, y), bodies_at(0.05 * (k + 1)).positions[0]))
    return x, least


def test_one_that_crosses_is_not_met():
    """A body of 0.3 m that crosses at 1 m/s where the robot would be at that time."""
    x, least = drive(lambda time: body(3.0, -2.0 + time, 0.0, 1.0), 8.0)
    assert least > 0.3 + 0.208
    assert x > 6.0


def test_the_paper_objective_reads_no_tracks():
    """The 1997 objective drives into the body, which the empty scan does not show."""
    _, least = drive(lambda time: body(3.0, 0.0), 8.0, objective="1997")
    assert least < 0.3


def test_a_laser_that_sees_only_the_body_leaves_no_echo():
    method = DynamicWindow(DwaParams(), Robot(JACKAL, 2.0, math.pi, 2.0, 2.0, half_track=0.19), 0.05)
    scan = Beams.fixed(
        np.zeros((3, 2)), np.array([-0.1, 0.0, 0.1]), np.zeros(3), np.full(3, 1.7), np.tile([0.1, 9.0], (3, 1)),
        np.zeros(3, np.int64),
    )  # fmt: skip
    method.step([scan], None, Given(0.0, HERE, (0.0, 0.0), (7.0, 0.0), 0.0, bodies=body(2.0, 0.0)))
    assert np.isinf(method.contacts).all()
    method.step([scan], None, Given(0.05, HERE, (0.0, 0.0), (7.0, 0.0), 0.0))
    assert np.isfinite(method.contacts).any()
