"""Known space: which cells a robot and its beams enter, and for how long."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.navigation.monitor_known_space import SeenSpace
from seen_cells import ACROSS, CELL, DOT, FRESH, MEMORY, NORTH, RISING, centre, known_cells, knows, look, stood

# --- where the robot was ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("x", "y"), [(0.52, 1.23), (-0.52, 1.23), (0.52, -1.23), (-0.02, -0.03), (6.38, -6.38)])
def test_a_cell_in_which_the_robot_stood_is_known_and_no_other(x: float, y: float) -> None:
    space, (mid_x, mid_y) = stood((x, y)), centre(x, y)
    assert knows(space, mid_x, mid_y)
    for dx, dy in ((CELL, 0.0), (-CELL, 0.0), (0.0, CELL), (0.0, -CELL)):
        assert not knows(space, mid_x + dx, mid_y + dy)
    assert knows(space, mid_x + 0.024, mid_y - 0.024) and knows(space, mid_x - 0.024, mid_y + 0.024)


def test_the_grid_repeats_after_12_8_m() -> None:
    space = stood((0.52, 1.23))
    assert knows(space, 0.52 - ACROSS, 1.23 + ACROSS) and knows(space, 0.52 + 2 * ACROSS, 1.23 - 2 * ACROSS)
    assert not knows(space, 0.52 - ACROSS + CELL, 1.23) and not knows(space, 0.52, 1.23 + ACROSS - CELL)


def test_a_place_is_known_for_5_m_of_way() -> None:
    space = stood((0.52, 1.23), way=2.75)
    assert knows(space, 0.52, 1.23, way=7.75)
    assert not knows(space, 0.52, 1.23, way=7.76)


def test_the_newest_visit_counts() -> None:
    space = stood((0.52, 1.23))
    space.stand(np.array([0.52, 1.23, 0.0]), 4.0)
    assert knows(space, 0.52, 1.23, way=9.0)


def test_the_outline_is_entered_as_the_robot_is_turned() -> None:
    """A bar from (0.6, 0.05) to (0.62, 0.15) before the base; at (1.0, -2.0) it is turned to (0.8, 0.6)."""
    bar = np.array([(0.6, 0.05), (0.62, 0.05), (0.62, 0.15), (0.6, 0.15)])
    space = SeenSpace(bar, MEMORY, FRESH)
    space.stand(np.array([5.0, 5.0, 0.0]), -100.0)
    space.stand(np.array([1.0, -2.0, RISING]), 0.0)
    for x, y in bar:
        assert knows(space, 1.0 + 0.8 * x - 0.6 * y, -2.0 + 0.6 * x + 0.8 * y)
    assert not knows(space, 1.0, -2.0)


def test_the_outline_has_points_at_most_a_cell_apart_and_directions_away_from_the_base() -> None:
    space = SeenSpace(np.array([(0.3, 0.04), (0.18, 0.04), (0.18, -0.05)]), MEMORY, FRESH)
    left = [(0.3, 0.04), (0.26, 0.04), (0.22, 0.04)]  # 12 cm in three steps
    rear = [(0.18, 0.04), (0.18, -0.005)]  # 9 cm in two
    rest = [(0.18, -0.05), (0.22, -0.02), (0.26, 0.01)]  # 15 cm in three
    assert space.rim == pytest.approx(np.array([*left, *rear, *rest]))
    assert space.outward[3] == pytest.approx((0.18 / math.hypot(0.18, 0.04), 0.04 / math.hypot(0.18, 0.04)))
    assert np.hypot(space.outward[:, 0], space.outward[:, 1]) == pytest.approx(np.ones(8))


def test_a_short_edge_has_one_point() -> None:
    assert len(SeenSpace(DOT, MEMORY, FRESH).rim) == 4
    assert len(SeenSpace(np.concatenate([DOT, DOT[-1:]]), MEMORY, FRESH).rim) == 5, "also one of no length"


@pytest.mark.parametrize(("x", "y", "step"), [(0.03, 0.04, 0.5), (0.35, 0.2, 0.025 / math.hypot(0.35, 0.2))])
def test_at_the_start_the_room_to_turn_is_assumed_to_be_free(x: float, y: float, step: float) -> None:
    """Footprints that reach 5 and 40 cm: rings 2.5 cm apart, also a cell beyond, of points 2.5 cm apart."""
    space = SeenSpace(np.array([(x, y), (-x, y), (-x, -y), (x, -y)]), MEMORY, FRESH)
    space.stand(np.array([0.13, -0.29, 0.7]), 0.25)
    rings = {
        (math.floor((0.13 + r * math.cos(angle)) / CELL), math.floor((-0.29 + r * math.sin(angle)) / CELL))
        for r in np.arange(0.0, math.hypot(x, y) + 0.05, 0.025)
        for angle in np.arange(0.0, math.tau, step)
    }
    assert known_cells(space, 1.0) == rings
    assert known_cells(space, 0.6, way=5.26) == set()
    space.stand(np.array([0.5, 0.5, 0.0]), 5.0)
    assert not knows(space, 0.5 + 0.5 * x, 0.5, way=6.0) or x < 0.1, "only at the start"


def test_the_room_to_turn_has_no_gap() -> None:
    space = SeenSpace(np.array([(0.4, 0.3), (-0.4, 0.3), (-0.4, -0.3), (0.4, -0.3)]), MEMORY, FRESH)
    space.stand(np.zeros(3), 0.0)
    known = known_cells(space, 0.8)
    inner = {(i, k) for i in range(-16, 16) for k in range(-16, 16) if math.hypot(i + 0.5, k + 0.5) * CELL < 0.5}
    assert inner <= known
    assert max(math.hypot(i + 0.5, k + 0.5) * CELL for i, k in known) < 0.58


# --- what beams see ---------------------------------------------------------------------------------------------------


def beam_cells(space: SeenSpace, row: int = 0, **at: float) -> list[int]:
    """Columns of the known cells in a row, from 0.5 m behind the origin to 4.5 m before it."""
    return [i for i in range(-10, 90) if knows(space, (i + 0.5) * CELL, (row + 0.5) * CELL, **at)]


def test_a_laser_frees_the_cells_before_its_echo_and_10_cm_about_them() -> None:
    """1.01 m along x from the middle of the cell 0: cells 0 to 19 are free, and the echo is in cell 20."""
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.0, 1.01)
    assert beam_cells(space, time=0.6) == [*range(-2, 20), 21]
    for row in (2, -2):
        assert beam_cells(space, row, time=0.6) == [*range(20)]
    for row in (1, -1, 3, -3):
        assert beam_cells(space, row, time=0.6) == []


def test_the_cell_of_an_echo_is_left_to_the_echoes_while_it_is_fresh() -> None:
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.0, 1.01, at=(2.0, 0.0))
    assert knows(space, 1.03, 0.03, time=2.5)
    assert not knows(space, 1.03, 0.03, time=2.51)


def test_what_was_free_is_not_where_a_laser_has_its_echo_now() -> None:
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.0, 2.01)
    look(space, 0.0, 1.01)
    assert beam_cells(space, time=0.6) == [*range(-2, 20), *range(21, 40), 41]


def test_free_space_is_known_for_5_m_of_way_and_looked_at_for_half_a_second() -> None:
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.0, 1.01, at=(2.0, 1.25))
    assert knows(space, 0.53, 0.03, time=2.51, way=6.25)
    assert not knows(space, 0.53, 0.03, time=2.51, way=6.26)
    assert knows(space, 0.53, 0.03, time=2.5, way=6.26)
    assert not knows(space, 0.53, 0.13, time=2.5, way=6.26)
    open_end = SeenSpace(DOT, MEMORY, FRESH)
    look(open_end, 0.0, math.inf, at=(2.0, 1.25), limits=(0.2, 0.61))
    assert [knows(open_end, 0.68, 0.03, time=2.6, way=way) for way in (6.25, 6.26)] == [True, False]
    assert [knows(space, *place, time=2.6, way=6.25) for place in ((-0.07, 0.03), (0.53, 0.13), (0.53, -0.07))] == [
        True
    ] * 3


@pytest.mark.parametrize(
    ("distance", "limits", "cells"),
    [
        (
            math.inf,
            (0.2, 4.0),
            [*range(-2, 62)],
        ),  # 3 m at most; not from the edge of a cell, so that nothing is doubtful
        (3.5, (0.2, 4.0), [*range(-2, 62)]),
        (3.0, (0.2, 4.0), [*range(-2, 60), 61]),  # an echo at 3 m
        (math.inf, (0.2, 1.61), [*range(-2, 34)]),  # range_max, without an echo
        (1.61, (0.2, 1.61), [*range(-2, 34)]),
        (1.6, (0.2, 1.61), [*range(-2, 32), 33]),
        (0.04, (0.2, 4.0), []),
    ],
)
def test_free_space_ends_with_the_range_or_after_3_m(
    distance: float, limits: tuple[float, float], cells: list[int]
) -> None:
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.0, distance, limits=limits)
    assert beam_cells(space, time=0.6) == cells


def test_beams_begin_at_their_own_origin_and_pose() -> None:
    """From (0.3, 0.2) of a base at (1.1, -0.5) that is turned to (0.8, 0.6), along (0, 1) and along (-0.6, 0.8)."""
    space = SeenSpace(DOT, MEMORY, FRESH)
    poses = np.array([(3.0, 3.0, 0.0), (1.1, -0.5, RISING), (-2.0, 1.1, -NORTH)])
    origins, ranges = np.array([(0.0, 0.0), (0.3, 0.2), (0.1, -0.4)]), np.array([0.04, 1.5, 0.77])
    space.look(poses, (origins, np.array([0.0, NORTH, 0.0]), np.zeros(3), ranges), np.array([0.1, 4.0]), np.zeros(2))
    x, y = 1.1 + 0.8 * 0.3 - 0.6 * 0.2, -0.5 + 0.6 * 0.3 + 0.8 * 0.2
    for along in (0.0, 0.5, 1.0, 1.4):
        assert knows(space, x - 0.6 * along, y + 0.8 * along, time=0.6)
        assert not knows(space, x + 0.6 * along + 0.3, y - 0.8 * along, time=0.6)
    assert not knows(space, x - 0.6 * 1.5, y + 0.8 * 1.5, time=0.6) and knows(space, x - 0.6 * 1.5, y + 1.2, time=0.5)
    assert not knows(space, x - 0.6 * 1.8, y + 0.8 * 1.8)
    # The third: from (-2.4, 1.0) straight down to 0.23.
    assert knows(space, -2.4, 0.975, time=0.6) and knows(space, -2.4, 0.3, time=0.6)
    assert not knows(space, -2.4, 0.1, time=0.6) and not knows(space, -2.0, 0.9, time=0.6)


def angles_known(space: SeenSpace, distance: float, **at: float) -> tuple[float, float]:
    """Least and largest bearing of known space about the cell 0, in hundredths of rad."""
    found = [
        k for k in range(-100, 101)
        if knows(space, 0.025 + distance * math.cos(k / 100), 0.025 + distance * math.sin(k / 100), **at)
    ]  # fmt: skip
    return min(found), max(found)


def test_a_sonar_frees_its_whole_cone() -> None:
    """A cone of 0.25 rad to each side: 0.2 m to the side at 0.8 m, and 0.1 m more that counts as seen."""
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.1, 1.01, half=0.25)
    least, most = angles_known(space, 0.8, time=0.6)
    assert -15 - 16 <= least <= -15 - 10 and 35 + 10 <= most <= 35 + 16
    known = known_cells(space, 1.2, time=0.6)
    cone = {
        (i, k) for i in range(2, 20) for k in range(-20, 20)
        if 0.1 < math.hypot(i, k) * CELL < 0.9 and abs(math.atan2(k, i) - 0.1) < 0.25
    }  # fmt: skip
    assert cone <= known


def looked_at(angles: list[float], y: float) -> set[tuple[int, int]]:
    """Cells of readings of 1.01 m from (0.025, y): a place every 5 cm, and the echo."""
    return {
        (math.floor((0.025 + r * math.cos(angle)) / CELL), math.floor((y + r * math.sin(angle)) / CELL))
        for angle in angles
        for r in [*(CELL * k for k in range(20)), 1.01]
    }


@pytest.mark.parametrize(
    ("half", "y", "angles"),
    [
        (0.4, 0.025, [0.1 - 0.4 + 0.8 * k / 17 for k in range(18)]),  # an arc of 0.808 m: 17 steps
        (0.02, 0.02, [0.08, 0.12]),  # of 0.04 m: its two edges
        (0.0, 0.025, [0.1]),
    ],
)
def test_a_cone_is_entered_along_rays_at_most_a_cell_apart(half: float, y: float, angles: list[float]) -> None:
    """After 6 m of way the cells that are looked at now are known, and nothing beside them."""
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.1, 1.01, half=half, base=(0.025, y, 0.0))
    assert known_cells(space, 1.3, time=0.5, way=6.0) == looked_at(angles, y)


def test_an_echo_of_a_sonar_may_be_anywhere_on_its_arc_and_takes_nothing() -> None:
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.0, 2.01, half=0.25)
    look(space, 0.0, 1.01, half=0.25, at=(1.0, 0.0))
    assert knows(space, 1.03, 0.03, time=1.6)
    far = SeenSpace(DOT, MEMORY, FRESH)
    look(far, 0.0, 1.01, half=0.25, at=(1.0, 0.0))
    # Its ends are looked at now: the cells there are left to the echoes.
    x, y = 0.025 + 1.01 * math.cos(0.25), 0.025 + 1.01 * math.sin(0.25)
    assert all(knows(far, x, side, time=1.5) for side in (y, 0.05 - y))


# --- sonars that measure nothing nearer than range_min ----------------------------------------------------------------

BODY = np.array([(0.42, 0.3), (-0.42, 0.3), (-0.42, -0.3), (0.42, -0.3)])
"""Its front edge is in the cell 8."""
NEAR = (0.45, 4.0)
"""Limits of a sonar that reports 0.45 m for all that is nearer."""


def started(way: float = 0.0) -> SeenSpace:
    """A space in which the room to turn is assumed to be free: at least 0.5 m about the origin."""
    space = SeenSpace(BODY, MEMORY, FRESH)
    space.stand(np.zeros(3), way)
    return space


@pytest.mark.parametrize(("reading", "end"), [(0.42, 8), (0.45, 9), (0.451, None), (0.2, 4)])
def test_an_echo_below_range_min_takes_the_cells_up_to_there_but_the_first_two(reading: float, end: int | None) -> None:
    space = started()
    before = beam_cells(space, time=0.6)
    look(space, 0.0, reading, half=0.01, limits=NEAR)
    taken = [] if end is None else [i for i in range(2, end) if i != 8]  # the robot is in the cell 8
    assert [i for i in before if i not in beam_cells(space, time=0.6)] == taken


def test_an_echo_below_range_min_takes_nothing_that_was_read_through_within_5_m() -> None:
    """Beside the cell 3 nothing else is free, so that it is known by its own entry alone."""
    for way, is_known in ((5.0, True), (5.01, False)):
        space = SeenSpace(DOT, MEMORY, FRESH)
        look(space, NORTH, 0.16, half=0.01, origin=(0.15, 0.0), limits=(0.1, 4.0))
        look(space, 0.0, 0.42, half=0.01, limits=NEAR, at=(1.0, way))
        assert knows(space, 0.175, 0.025, time=1.6, way=5.0) is is_known


def test_an_echo_below_range_min_stays_unknown_though_space_beside_it_is_free() -> None:
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.0, 0.42, half=0.01, limits=NEAR)
    for y in (0.1, -0.1):
        look(space, 0.0, 1.01, base=(0.025, 0.025 + y, 0.0), limits=(0.2, 4.0))
    look(space, NORTH, 1.01)
    assert not knows(space, 0.275, 0.025)
    assert knows(space, 0.475, 0.025), "beyond the reading the space beside it counts"


def test_assumed_space_is_taken_where_the_sonar_is() -> None:
    """At (2.0, -0.5), from the cell (40, -10) to the left: cells -8 to -3 of its column, and no other."""
    space = SeenSpace(BODY, MEMORY, FRESH)
    space.stand(np.array([2.0, -0.5, NORTH]), 0.0)
    look(space, NORTH, 0.42, half=0.01, base=(2.025, -0.475, 0.0), limits=NEAR)
    column = {row for row in range(-18, -2) if not knows(space, 2.025, (row + 0.5) * CELL)}
    assert column == {-8, -7, -6, -5, -4, -3}
    assert all(knows(space, x, (row + 0.5) * CELL) for row in range(-18, -2) for x in (1.975, 2.075))


def test_a_laser_has_no_such_echo() -> None:
    space = SeenSpace(DOT, MEMORY, FRESH)
    look(space, 0.0, 0.42, limits=NEAR)
    assert beam_cells(space, time=0.6) == [*range(-2, 8), 9]


def test_where_the_robot_has_stood_an_echo_below_range_min_takes_nothing() -> None:
    space = started()
    space.stand(np.array([-0.1, 0.0, 0.0]), 0.1)  # its front edge is in the cell 6
    before = beam_cells(space, time=0.6)
    look(space, 0.0, 0.42, half=0.01, limits=NEAR)
    assert [i for i in before if i not in beam_cells(space, time=0.6)] == [2, 3, 4, 5, 7]
