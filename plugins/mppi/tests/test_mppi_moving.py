"""Tracked bodies in roll-outs: where they are in each step, what nearness costs, and what the robot does."""

import math

import numpy as np
import pytest
from mppi_scenes import HERE, JACKAL, laser, line, method_of, scene_of, still
from navloom_avoidance.bodies import TrackedBodies
from navloom_avoidance.clearance import footprint_edges
from navloom_dwa.moving import bodies_ahead
from navloom_mppi import critics as of
from navloom_mppi.control import Given
from navloom_mppi.weighting import evade

EDGES = footprint_edges(JACKAL)


def body(x, y, vx=0.0, vy=0.0):
    """A body of radius 0.3 m."""
    return TrackedBodies(np.array([[x, y]]), np.array([[vx, vy]]), np.full(1, 0.3), np.zeros((1, 4, 4)))


def test_the_critic_meets_a_body_in_the_step_in_which_it_comes():
    """A robot that stands; a body that comes by 0.5 m each step from 2 m: its disc is within 0.1 m in step 3."""
    times = np.arange(4.0)
    moving = bodies_ahead(body(2.0, 0.0, -0.5), HERE, times, EDGES, 0.1, 0.3, 0.0)
    step, _ = of.obstacles(scene_of(footprint=JACKAL, bodies=moving), still(steps=4))
    assert step == 3


def test_nearness_is_that_of_the_nearest():
    """The disc of 0.4 m is 0.55 - 0.4 = 0.15 m away from the front: half of 0.3 m, and half of the clearance of 0.3 m.

    A quarter, and ten times a quarter.
    """
    moving = bodies_ahead(body(0.229 + 0.55, 0.0), HERE, np.zeros(8), EDGES, 0.1, 0.3, 0.0)
    step, near = of.obstacles(scene_of(footprint=JACKAL, bodies=moving), still())
    assert (step, near) == (8, pytest.approx(2.75))


def test_the_speed_of_a_body_widens_its_nearness():
    """0.3 m, and 0.7 s at 1 m/s: 1 m."""
    moving = bodies_ahead(body(2.0, 0.0, 0.0, 1.0), HERE, np.zeros(1), EDGES, 0.1, 0.3, 0.0, 0.7)
    assert moving[0, 0, 3] == pytest.approx(1.0)


def test_constant_commands_over_all_that_the_robot_can_do_are_tried():
    """Of 40 pairs: 2 m/s straight on first, -1 m/s with 3 rad/s at the end."""
    noise, paces = np.zeros((50, 9, 2), np.float32), np.ones(50)
    evade(noise, paces, (0.5, 0.75), (-1.0, 2.0, 3.0))
    commands = noise * (0.5, 0.75)
    assert paces.tolist() == [0.0] * 40 + [1.0] * 10
    assert commands[0].tolist() == [[2.0, 0.0]] * 9
    assert commands[39].tolist() == [[-1.0, 3.0]] * 9
    assert not commands[40:].any()


def drive(bodies_at, seconds, length=6.0):
    """Place of an ideal robot on a line, m, and the least distance of its centre from the body's, m."""
    method, path = method_of(samples=800), line(length, 0.0)
    x, y, heading, twist, least = 0.0, 0.0, 0.0, (0.0, 0.0), math.inf
    for k in range(round(seconds / 0.05)):
        now = bodies_at(0.05 * k)
        at = int(np.argmin(np.hypot(path[:, 0] - x, path[:, 1] - y)))
        seen = laser([now.positions[0].tolist()], (x, y, heading), 0.3)
        decision = method.step([seen], None, Given(0.05 * k, (x, y, heading), twist, path[at:], bodies=now))
        twist = (decision.speed, decision.turn)
        heading = math.remainder(heading + 0.05 * twist[1], math.tau)
        x, y = x + 0.05 * twist[0] * math.cos(heading), y + 0.05 * twist[0] * math.sin(heading)
        least = min(least, math.dist((x, y), bodies_at(0.05 * (k + 1)).positions[0]))
    return x, least


def test_one_that_crosses_is_not_met():
    """A body of 0.3 m that crosses at 1 m/s where the robot would be at that time."""
    x, least = drive(lambda time: body(3.0, -2.5 + time, 0.0, 1.0), 9.0)
    assert least > 0.3 + 0.208
    assert x > 5.5


def test_one_that_comes_along_the_path_is_passed():
    x, least = drive(lambda time: body(6.0 - time, 0.1, -1.0, 0.0), 9.0)
    assert least > 0.3 + 0.208
    assert x > 5.5


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, 180.0])
def test_a_robot_at_its_goal_gets_out_of_the_way(bearing_deg):
    """A body comes to it at 1.5 m/s from 4 m away."""
    c, s = math.cos(math.radians(bearing_deg)), math.sin(math.radians(bearing_deg))
    _, least = drive(lambda time: body((4.0 - 1.5 * time) * c, (4.0 - 1.5 * time) * s, -1.5 * c, -1.5 * s), 4.0, 0.05)
    assert least > 0.3 + 0.208


@pytest.mark.parametrize(("speed", "status"), [(0.0, "trapped"), (0.5, "steering")])
def test_a_robot_that_waits_for_what_moves_is_not_trapped(speed, status):
    """Enclosed by posts for 3 s; twice as long as it takes to be trapped."""
    method, path, ring = method_of(samples=100), line(6.0, 0.0), np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    posts = (0.4 * np.column_stack([np.cos(ring), np.sin(ring)])).tolist()
    for k in range(60):
        now = body(2.0, 1.0, 0.0, speed)
        decision = method.step([laser(posts, HERE, 0.1)], None, Given(0.05 * k, HERE, (0.0, 0.0), path, bodies=now))
    assert decision.status == status


def test_mirrored_bodies_cost_the_mirrored_roll_outs_the_same():
    """Samples 2 i and 2 i + 1 are mirror images of each other."""
    left, right, path = method_of(), method_of(), line(6.0, 0.5)
    left.step([], None, Given(0.0, HERE, (0.5, 0.2), path, bodies=body(1.5, 0.4, -1.0, 0.1)))
    right.step([], None, Given(0.0, HERE, (0.5, -0.2), path * (1.0, -1.0), bodies=body(1.5, -0.4, -1.0, -0.1)))
    columns = [of.COLLISION, of.OBSTACLE]
    swapped = right.parts.reshape(-1, 2, len(of.CRITICS))[:, ::-1].reshape(-1, len(of.CRITICS))
    assert left.parts[:, of.COLLISION].max() > 1.0
    np.testing.assert_array_equal(left.parts[:, columns], swapped[:, columns])
