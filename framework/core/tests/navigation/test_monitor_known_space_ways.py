"""Where a way leaves known space, for each point of the footprint's outline."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
from navloom.navigation.monitor_known_space import SeenSpace
from seen_cells import DOT, FRESH, MEMORY, NORTH, RISING, stood


def first(
    space: SeenSpace, poses: list[tuple[float, float, float]], base: tuple[float, float, float], count: int = 0
) -> int:
    """Index of the first pose in unknown space."""
    return space.first_unseen(np.array(poses), count or len(poses), np.array(base), 0.0, 0.0)


def point_at(space: SeenSpace, x: float, y: float) -> SeenSpace:
    """The same known space for a robot that is one point of the base frame."""
    probe = copy.copy(space)
    probe.rim = np.array([(x, y)])
    probe.outward = probe.rim / math.hypot(x, y)
    return probe


def test_the_first_pose_whose_outline_is_in_unknown_space_is_found() -> None:
    """A point 0.4 m before and 0.2 m left of the base, which is at (1.0, -2.0) and turned to (0.8, 0.6).

    Poses: (0, 0), then 0.5 along and 0.3 aside, there turned by 90 degrees, then farther on.
    """
    # First: (1, -2) + 0.8 * 0.4 - 0.6 * 0.2, 0.6 * 0.4 + 0.8 * 0.2. Second: the base is at (1.22, -1.46), its axis is
    # (-0.6, 0.8), its left (-0.8, -0.6): (1.22 - 0.24 - 0.16, -1.46 + 0.32 - 0.12).
    places = [(1.2, -1.6), (0.82, -1.26)]
    poses = [(0.0, 0.0, 0.0), (0.5, 0.3, NORTH), (2.0, 0.0, 0.0)]
    assert first(point_at(stood(*places), 0.4, 0.2), poses, (1.0, -2.0, RISING)) == 2
    assert first(point_at(stood(places[0]), 0.4, 0.2), poses, (1.0, -2.0, RISING)) == 1
    assert first(point_at(stood(*places), 0.4, 0.2), poses, (1.0, -2.0, RISING), count=2) == -1


RIM = np.array([(0.4, 0.2), (0.1, -0.3), (-0.2, 0.25)])
"""Three points of an outline, m, base frame."""
TURNED = (1.0, -2.0, RISING)


def of_three_points(space: SeenSpace) -> SeenSpace:
    probe = copy.copy(space)
    probe.rim, probe.outward = RIM, RIM / np.hypot(RIM[:, 0], RIM[:, 1])[:, None]
    return probe


def turned(x: float, y: float) -> tuple[float, float]:
    """A place of the turned base in the odometry frame, m."""
    return 1.0 + 0.8 * x - 0.6 * y, -2.0 + 0.6 * x + 0.8 * y


@pytest.mark.parametrize("missing", [0, 1, 2, None])
def test_each_point_of_the_outline_counts(missing: int | None) -> None:
    """All three begin in known cells; 0.1 m ahead and 0.05 m to the left, one does not."""
    places = [turned(x, y) for x, y in RIM]
    after = [turned(x + 0.1, y + 0.05) for x, y in RIM]
    space = of_three_points(stood(*places, *(place for k, place in enumerate(after) if k != missing)))
    assert first(space, [(0.0, 0.0, 0.0), (0.1, 0.05, 0.0)], TURNED) == (-1 if missing is None else 1)


@pytest.mark.parametrize("outside", [0, 1, 2])
@pytest.mark.parametrize(("x", "y"), [(0.06, 0.0), (-0.06, 0.0), (0.0, 0.06), (0.0, -0.06)])
def test_each_point_has_its_own_way_out_of_unknown_space(outside: int, x: float, y: float) -> None:
    """One of the points is in unknown space: away from the base it may not go."""
    inside = [(rx, ry) for k, (rx, ry) in enumerate(RIM) if k != outside]
    space = of_three_points(stood(*(turned(rx + dx, ry + dy) for rx, ry in inside for dx, dy in ((0.0, 0.0), (x, y)))))
    is_away = RIM[outside] @ (x, y) > 0.0
    assert first(space, [(0.0, 0.0, 0.0), (x, y, 0.0)], TURNED) == (1 if is_away else -1)


@pytest.mark.parametrize(
    ("x", "y", "is_refused"),
    [
        (1.15e-4, 0.0, True),
        (1e-4, 0.0, False),  # rounding
        (0.9e-4, 0.0, False),
        (-0.3, 0.0, False),
        (0.0, 0.3, False),
        (0.1, 0.3, True),
    ],
)
def test_who_is_in_unknown_space_may_only_leave_it(x: float, y: float, is_refused: bool) -> None:
    """A point straight before the base, at x = 0, so that distances have no rounding."""
    space = SeenSpace(DOT, MEMORY, FRESH)
    space.rim, space.outward = np.zeros((1, 2)), np.array([(1.0, 0.0)])
    assert (first(space, [(0.0, 0.0, 0.0), (x, y, 0.0)], (0.0, 0.0, 0.0)) == 1) is is_refused


@pytest.mark.parametrize(
    ("x", "y", "is_refused"), [(0.1, 0.0, True), (-0.1, 0.0, False), (0.1, -0.15, True), (0.1, -0.25, False),
                               (-0.1, 0.25, True), (-0.1, 0.15, False)]
)  # fmt: skip
def test_away_is_the_direction_from_the_base_to_the_point_as_the_base_is_turned(
    x: float, y: float, is_refused: bool
) -> None:
    """The point is 0.4 m before and 0.2 m left of the base: away is along (2, 1) in its frame."""
    space = point_at(SeenSpace(DOT, MEMORY, FRESH), 0.4, 0.2)
    assert (first(space, [(0.0, 0.0, 0.0), (x, y, 0.0)], (1.0, -2.0, RISING)) == 1) is is_refused


def test_turning_moves_a_point_away_too() -> None:
    """A point beside the base that turns to the front comes nearer to it in no direction but its own."""
    space = point_at(SeenSpace(DOT, MEMORY, FRESH), 0.4, 0.2)
    poses = [(0.0, 0.0, 0.0), (0.0, 0.0, 0.3)]
    assert first(space, poses, (1.0, -2.0, RISING)) == -1
