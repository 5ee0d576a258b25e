"""What beams see along the map: at a wall, through it, before it, or nothing."""

import math

import numpy as np
import pytest
from navloom_scans.field import distance_field
from navloom_scans.sight import Sight, compare_views, look_along

GATE = 0.16


def wall():
    """Free space with a wall of one cell of 0.1 m, its faces at x = 3.0 and 3.1 m."""
    occupied = np.zeros((40, 60), dtype=np.bool_)
    occupied[:, 30] = True
    return distance_field(occupied, 0.1, (0.0, 0.0, 0.0), 1.0)


def beam(length, bearing=0.0):
    return [length * math.cos(bearing), length * math.sin(bearing), math.cos(bearing), math.sin(bearing)]


def counts(*beams, echoes=None, pose=(1.0, 2.0, 0.0)):
    rows = np.array(beams)
    return list(look_along(wall(), rows, len(rows) if echoes is None else echoes, np.array(pose), GATE))


@pytest.mark.parametrize(
    ("length", "kind"),
    [(2.0, 0), (1.93, 0), (1.87, 1), (1.8, 3), (0.5, 3), (2.15, 0), (2.2, 2), (3.5, 2)],
)
def test_an_echo_ahead_of_a_wall_2_m_away(length, kind):
    # Within 0.08 m and 0.16 m of the wall; before it by more; behind its front by more than 0.16 m: through it.
    expected = [0.0] * 6
    expected[kind] = 1.0
    assert counts(beam(length)) == expected


def pane(behind):
    """A pane of one cell at x = 3.0 to 3.1 m, and a wall of one cell that begins `behind` cells after it."""
    occupied = np.zeros((40, 60), dtype=np.bool_)
    occupied[:, [30, 31 + behind]] = True
    return distance_field(occupied, 0.1, (0.0, 0.0, 0.0), 1.0)


@pytest.mark.parametrize(
    ("length", "kind"),
    [(3.1, 3), (3.03, 3), (3.16, 3), (3.0, 2), (2.8, 2), (3.4, 2), (2.2, 2)],
)
def test_an_echo_through_a_pane_2_m_away_at_the_front_of_a_wall_3_1_m_away(length, kind):
    # Within 0.08 m of the front: no evidence. Before it by more, behind the wall, or just behind the pane: through it.
    expected = [0.0] * 6
    expected[kind] = 1.0
    assert list(look_along(pane(10), np.array([beam(length)]), 1, np.array([1.0, 2.0, 0.0]), GATE)) == expected


def test_beams_without_an_echo_never_end_at_the_wall_behind_a_pane():
    seen = look_along(pane(10), np.array([beam(3.1)]), 0, np.array([1.0, 2.0, 0.0]), GATE)
    assert list(seen) == [0, 0, 0, 0, 0, 1]


def test_the_depth_behind_a_wall_is_measured_across_it():
    # At 45 deg the wall 2 m away is met after 2.828 m, by a ray 0.1 m beside it after 2.928 m; 0.2 m more are 0.14 m
    # behind its front, 0.25 m are 0.18 m.
    slanted = math.radians(45.0)
    assert counts(beam(3.13, slanted), pose=(1.0, 0.5, 0.0))[2] == 0.0
    assert counts(beam(3.18, slanted), pose=(1.0, 0.5, 0.0))[2] == 1.0


def test_beams_without_an_echo_pass_a_wall_or_none():
    assert counts(beam(3.0), beam(3.0, math.pi / 2), echoes=0, pose=(1.0, 0.5, 0.0)) == [0, 0, 0, 0, 1, 1]


def test_a_beam_that_cuts_a_single_cell_is_not_through_a_wall():
    occupied = np.zeros((40, 60), dtype=np.bool_)
    occupied[20, 30] = True
    field = distance_field(occupied, 0.1, (0.0, 0.0, 0.0), 1.0)
    assert look_along(field, np.array([beam(3.0)]), 1, np.array([1.0, 2.05, 0.0]), GATE).through == 0.0


def test_a_beam_leaves_the_map_without_a_wall():
    assert counts(beam(9.0), pose=(4.0, 2.0, 0.0)) == [0, 0, 0, 1, 0, 0]


def test_a_part_of_the_beams_is_counted():
    rows = np.array([beam(2.0), beam(0.5), beam(2.0), beam(0.5)])
    assert look_along(wall(), rows, 4, np.array([1.0, 2.0, 0.0]), GATE, (1, 2)) == (0, 0, 0, 2, 0, 0)


def test_what_the_counts_mean():
    seen = Sight(10.0, 4.0, 3.0, 3.0, 1.0, 4.0)
    # 14 echoes fit; 3 pass through, and 4 beams without an echo count half; 10 - 4 of 20 echoes are of the map.
    assert (seen.fit, seen.through, seen.total) == (14.0, 5.0, 25.0)
    assert seen.support == pytest.approx(6.0 / 20.0)
    assert seen.score == pytest.approx((14.0 - 5.0) / 20.0)


def test_few_echoes_say_little_about_the_sight_of_the_map():
    # A quarter of the beams have an echo, none of the map: half the weight is left.
    assert Sight(elsewhere=5.0, free=15.0).support == pytest.approx(0.5)


def fan_of(*lengths):
    """Beams 20 degrees apart, from straight ahead to the left."""
    return np.array([beam(length, math.radians(20.0 * k)) for k, length in enumerate(lengths)])


VIEW = fan_of(*[2.0] * 12)
AT_REST = (0.0, 0.0, 0.0)


def test_beams_continue_a_view_pass_through_it_or_end_before_it():
    # Of 12 beams that ended after 2 m, 6 do so within 0.16 m, 4 end further away, and 2 nearer.
    now = fan_of(2.0, 1.85, 2.15, 2.0, 2.0, 2.0, 2.2, 3.0, 4.0, 5.0, 1.8, 0.5)
    assert compare_views(VIEW, 12, now, 12, AT_REST, GATE) == (0.5, pytest.approx(4.0 / 12.0))


def test_a_view_is_compared_from_where_odometry_leads():
    # A circle of 2 m; after 0.5 m ahead and a turn of 20 degrees its points are elsewhere in the base frame. At rest
    # those within 0.16 m of 2 m would still fit: |0.5 cos| < 0.16, about a fifth.
    before = np.array([beam(2.0, math.radians(k)) for k in range(360)])
    x, y = before[:, 0] - 0.5, before[:, 1]
    c, s = math.cos(math.radians(20.0)), math.sin(math.radians(20.0))
    now = np.column_stack((c * x + s * y, c * y - s * x, np.ones(360), np.zeros(360)))
    assert compare_views(before, 360, now, 360, (0.5, 0.0, math.radians(20.0)), GATE) == (1.0, 0.0)
    assert compare_views(before, 360, now, 360, AT_REST, GATE)[0] == pytest.approx(0.2, abs=0.05)


def test_beams_without_an_echo_in_both_scans_are_not_compared():
    # The last 2 of 12 had none then and have none now; of the 10 others 5 have lost theirs: they end beyond it.
    now = np.vstack((VIEW[:5], fan_of(*[9.0] * 12)[5:]))
    assert compare_views(np.vstack((VIEW[:10], fan_of(*[9.0] * 12)[10:])), 10, now, 5, AT_REST, GATE) == (0.5, 0.5)


def test_fewer_than_ten_beams_say_nothing():
    assert compare_views(VIEW[:9], 9, fan_of(*[5.0] * 9), 9, AT_REST, GATE) == (1.0, 0.0)
