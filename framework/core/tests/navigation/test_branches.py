"""Trajectories of paths with headings: branches between cusps, and the reference that follows them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from limits import speed_limits
from navloom.engine.nodes.reference_node import ReferenceNode
from navloom.messages import Drive, Pose2D, Reference
from navloom.navigation.branches import Branch, branches_of, joined
from numpy.typing import NDArray

Floats = NDArray[np.float64]
AHEAD_AND_BACK = np.array([[0.0, 0.0], [1.0, 0.0], [0.2, 0.0]])
STRAIGHT = np.zeros(3)
FOLLOWS = Drive(1, 1, None, False)


def branches(points: Floats, headings: Floats, **robot: Any) -> list[Branch]:
    return branches_of(points, headings, speed_limits(max_angular=3.0, **robot), as_it_is, as_it_is)


def as_it_is(samples: Floats) -> Floats:
    return samples


def arc(radius: float, first: float, last: float, count: int = 20) -> tuple[Floats, Floats]:
    """Points and headings of an arc to the left about (0, radius), between two headings, rad."""
    headings = np.linspace(first, last, count)
    return radius * np.column_stack([np.sin(headings), 1.0 - np.cos(headings)]), headings


def test_a_cusp_is_where_the_way_turns_against_the_heading() -> None:
    found = branches(AHEAD_AND_BACK, STRAIGHT)
    assert [(part.begin, part.length, part.away) for part in found] == [(0.0, 1.0, 0.0), (1.0, 0.8, math.pi)]


def test_at_a_cusp_two_samples_have_one_place_and_speeds_of_opposite_signs() -> None:
    samples = joined(branches(AHEAD_AND_BACK, STRAIGHT))
    (cusp,) = np.flatnonzero(np.diff(np.sign(samples[:, 5])))
    assert samples[cusp, :4].tolist() == samples[cusp + 1, :4].tolist() == [1.0, 1.0, 0.0, 0.0]


def test_the_arc_length_increases_backwards_too() -> None:
    samples = joined(branches(AHEAD_AND_BACK, STRAIGHT))
    assert samples[-1, 0] == pytest.approx(1.8) and (np.diff(samples[:, 0]) >= 0.0).all()


@pytest.mark.parametrize("is_back", [False, True])
def test_curvature_times_speed_is_the_turn_rate(is_back: bool) -> None:
    """On an arc of 2 m to the left, forwards the heading grows, and backwards it falls."""
    points, headings = arc(2.0, 0.0, 1.0)
    samples = joined(branches(points[::-1], headings[::-1]) if is_back else branches(points, headings))
    turn_rate = samples[:, 4] * samples[:, 5]
    assert np.sign(turn_rate).tolist() == [-1.0 if is_back else 1.0] * len(samples)
    assert samples[:, 4] == pytest.approx(0.5)


def test_coarse_points_of_an_arc_give_the_arc() -> None:
    """Five chords of a quarter of a circle of 1 m bend by 18° each: their middles lie 1.2 cm inside of it."""
    points, headings = arc(1.0, 0.0, 0.5 * math.pi, 6)
    samples = joined(branches(points, headings))
    assert np.hypot(samples[:, 1], samples[:, 2] - 1.0) == pytest.approx(1.0, abs=1e-4)


def test_a_path_may_begin_backwards() -> None:
    (only,) = branches(np.array([[0.0, 0.0], [-1.0, 0.0]]), np.zeros(2))
    assert only.away == math.pi and (joined([only])[:, 5] < 0.0).all()


def test_repeated_points_are_no_branch() -> None:
    points = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    (only,) = branches(points, np.zeros(4))
    assert only.length == 1.0


def test_a_path_without_length_has_one_sample() -> None:
    (only,) = branches(np.zeros((2, 2)), np.array([0.3, 0.3]))
    assert only.samples[:, 1:4].tolist() == [[0.0, 0.0, pytest.approx(0.3)]]


def test_a_holonomic_robot_keeps_its_heading_round_a_corner_where_it_stops() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    found = branches(points, np.zeros(3), drive="holonomic")
    assert [part.length for part in found] == [1.0, 1.0]
    assert np.abs(joined(found)[:, 3]).max() == 0.0


def test_steered_wheels_get_time_where_the_curvature_jumps() -> None:
    """atan(0.5 / 1) = 0.464 rad at 0.5 rad/s, within a tenth of the radius of 0.5 / tan(0.6) = 0.731 m: 0.079 m/s."""
    points, headings = arc(1.0, 0.0, 1.0)
    line = np.linspace([-1.0, 0.0], [0.0, 0.0], 20, endpoint=False)
    steered = {"drive": "ackermann", "wheelbase": 0.5, "max_steering": 0.6, "max_steering_rate": 0.5}
    (only,) = branches(np.vstack([line, points]), np.append(np.zeros(20), headings), **steered)
    jump = int(np.argmin(np.abs(only.samples[:, 0] - 1.0)))
    assert only.samples[jump, 5] == pytest.approx(0.5 * 0.1 * 0.5 / math.tan(0.6) / math.atan(0.5))


# --- the reference ----------------------------------------------------------------------------------------------------


def follower(points: Floats, headings: Floats, **robot: Any) -> ReferenceNode:
    limits = speed_limits(max_angular=3.0, **robot)
    node = ReferenceNode(limits, 1.0, 0.3)
    node._branches = branches_of(points, headings, limits, as_it_is, as_it_is)
    return node


def seen(node: ReferenceNode, *poses: tuple[float, float, float]) -> Reference:
    """The reference after a robot has been at these poses."""
    return [node._reference(FOLLOWS, Pose2D(*pose)) for pose in poses][-1]


def test_before_a_cusp_the_reference_stays_on_its_branch_though_the_other_lies_there_too() -> None:
    reference = seen(follower(AHEAD_AND_BACK, STRAIGHT), *((x, 0.0, 0.0) for x in np.arange(0.0, 0.98, 0.1)))
    assert reference.progress == pytest.approx(0.9) and reference.speed > 0.0


def test_target_and_way_end_at_the_cusp() -> None:
    reference = seen(follower(AHEAD_AND_BACK, STRAIGHT), (0.5, 0.0, 0.0))
    assert (reference.target.x, reference.way[-1].tolist()) == (1.0, [1.0, 0.0])


def test_at_the_cusp_it_goes_on_backwards() -> None:
    reference = seen(follower(AHEAD_AND_BACK, STRAIGHT), (0.6, 0.0, 0.0), (0.995, 0.0, 0.0), (0.9, 0.0, 0.0))
    assert reference.speed < 0.0 and reference.pose.heading == pytest.approx(0.0)
    assert (reference.progress, reference.remaining) == pytest.approx((1.1, 0.7))


def test_the_reference_of_a_holonomic_robot_drives_to_its_left() -> None:
    node = follower(np.array([[0.0, 0.0], [0.0, 1.0]]), np.zeros(2), drive="holonomic")
    reference = seen(node, (0.0, 0.5, 0.0))
    assert reference.pose.heading == pytest.approx(0.0)
    assert (reference.speed, reference.lateral_speed) == pytest.approx((0.0, 0.4), abs=1e-12)


def test_a_holonomic_robot_turns_on_its_way() -> None:
    """1 rad over 2 m: half a rad per m."""
    node = follower(np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([0.0, 1.0]), drive="holonomic")
    reference = seen(node, (0.0, 0.0, 0.0), (0.5, 0.0, 0.25), (1.0, 0.0, 0.5))
    speed = math.hypot(reference.speed, reference.lateral_speed)
    assert (reference.pose.heading, reference.turn_rate) == pytest.approx((0.5, 0.5 * speed))
    assert reference.lateral_speed == pytest.approx(-speed * math.sin(0.5))


def test_a_restarted_node_finds_the_branch_of_the_robot() -> None:
    node = follower(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, -0.0001], [0.0, -3.0]]), np.array([0.0, 0.0, 0.8, 0.8]))
    assert node._start(Pose2D(1.5, -1.5, 0.8))[0] == len(node._branches) - 1
