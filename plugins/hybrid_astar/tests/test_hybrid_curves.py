"""Reeds-Shepp, Dubins and turning curves: lengths worked by hand, ends, symmetry, and OMPL as an oracle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from navloom_hybrid_astar.clearance import advanced
from navloom_hybrid_astar.curves import MOVES, cheapest_curve

REEDS_SHEPP, DUBINS = (0.0, 0.0, math.inf, True), (0.0, 0.0, math.inf, False)
poses = st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0), st.floats(-math.pi, math.pi))


def curve(pose, costs=REEDS_SHEPP):
    moves = np.zeros((MOVES, 3))
    return cheapest_curve(*pose, costs, moves), moves


def end(moves):
    pose = (0.0, 0.0, 0.0)
    for turn, length, angle in moves.tolist():
        pose = advanced(*pose, turn, length, angle)
    return pose


@pytest.mark.parametrize(
    ("pose", "length"),
    [
        ((5.0, 0.0, 0.0), 5.0),
        ((-3.0, 0.0, 0.0), 3.0),  # straight back
        ((1.0, 1.0, math.pi / 2), math.pi / 2),  # a quarter to the left
        ((-1.0, -1.0, math.pi / 2), math.pi / 2),  # a quarter to the right, backwards
        ((0.0, 0.0, math.pi), math.pi),  # three arcs of 60 degrees: the three-point turn
        ((2.0, 2.0, 0.0), math.pi),  # a quarter left, a quarter right
        ((0.0, 0.0, 0.0), 0.0),
    ],
)
def test_a_reeds_shepp_curve_is_as_long_as_worked_by_hand(pose, length):
    assert curve(pose)[0] == pytest.approx(length, abs=1e-9)


@pytest.mark.parametrize(
    ("pose", "length"),
    [
        ((5.0, 0.0, 0.0), 5.0),
        ((0.0, 2.0, math.pi), math.pi),  # half a circle
        ((0.0, -2.0, math.pi), math.pi),
        ((2.0, 5.0, 0.0), math.pi + 3.0),  # a quarter left, 3 straight, a quarter right
        ((0.0, 0.0, math.pi), 7.0 * math.pi / 3.0),  # left 60 degrees, right 300, left 60
    ],
)
def test_a_dubins_curve_is_as_long_as_worked_by_hand(pose, length):
    assert curve(pose, DUBINS)[0] == pytest.approx(length)


@pytest.mark.parametrize("costs", [REEDS_SHEPP, DUBINS, (0.7, 0.4, math.inf, True), (0.0, 0.0, 0.5, True)])
@given(pose=poses)
def test_a_curve_ends_at_the_pose(costs, pose):
    x, y, heading = end(curve(pose, costs)[1])
    assert (x, y) == pytest.approx(pose[:2], abs=1e-6)
    assert math.remainder(heading - pose[2], math.tau) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("costs", [REEDS_SHEPP, DUBINS])
@given(pose=poses)
def test_the_mirrored_pose_is_as_far(costs, pose):
    x, y, heading = pose
    assert curve((x, -y, -heading), costs)[0] == pytest.approx(curve(pose, costs)[0], abs=1e-6)


@given(pose=poses)
def test_the_way_back_is_as_long(pose):
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    assert curve((-c * x - s * y, s * x - c * y, -heading))[0] == pytest.approx(curve(pose)[0], abs=1e-6)


@given(pose=poses)
def test_dubins_never_drives_backwards(pose):
    assert (curve(pose, DUBINS)[1][:, 1] >= 0.0).all()


def test_costs_choose_another_word():
    # Straight back costs 3 (1 + 2) = 9; to turn round twice is cheaper only if reversing costs much.
    assert curve((-3.0, 0.0, 0.0), (2.0, 0.0, math.inf, True))[0] <= 9.0
    assert curve((-3.0, 0.0, 0.0), (0.5, 0.0, math.inf, True))[0] == pytest.approx(4.5)


def test_a_robot_that_turns_in_place_turns_drives_and_turns():
    # To (0, 3) heading left: turn 90 degrees at 0.1 a rad, drive 3.
    cost, moves = curve((0.0, 3.0, math.pi / 2), (0.0, 0.0, 0.1, True))
    assert cost == pytest.approx(3.0 + 0.1 * math.pi / 2)
    assert moves[0, 2] == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(("name", "costs"), [("ReedsSheppStateSpace", REEDS_SHEPP), ("DubinsStateSpace", DUBINS)])
def test_lengths_are_those_of_ompl(name, costs):
    base = pytest.importorskip("ompl.base")
    space = getattr(base, name)(1.0)
    bounds = base.RealVectorBounds(2)
    bounds.setLow(-20.0)
    bounds.setHigh(20.0)
    space.setBounds(bounds)

    def state(x, y, heading):
        made = space.allocState()
        made.setX(x)
        made.setY(y)
        made.setYaw(heading)
        return made

    stream, origin = np.random.default_rng(1), state(0.0, 0.0, 0.0)
    for scale in (0.5, 2.0, 8.0):
        for pose in stream.uniform((-scale, -scale, -math.pi), (scale, scale, math.pi), (400, 3)).tolist():
            assert curve(pose, costs)[0] == pytest.approx(space.distance(origin, state(*pose)), abs=1e-6)
