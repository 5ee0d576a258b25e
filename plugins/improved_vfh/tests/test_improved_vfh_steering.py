"""Choice of the direction, laws, rotation search: the printed numbers of the paper."""

import itertools
import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from navloom_avoidance.search import Progress, RotationSearch, Trap
from navloom_avoidance.steering import turn_rate, wrap
from navloom_improved_vfh.steering import forward_speed, is_turning, select_direction

Angle = st.floats(-math.pi, math.pi - 1e-9)


def select(directions, heading, target, previous=None, loyalty=0.0):
    chosen = select_direction(
        [math.radians(d) for d in directions], math.radians(heading), math.radians(target),
        math.radians(100.0), math.radians(90.0), None if previous is None else math.radians(previous),
        math.radians(loyalty),
    )  # fmt: skip
    return None if chosen is None else math.degrees(chosen)


def test_case_1_takes_the_direction_nearest_the_target():
    assert select([-30.0, 60.0], heading=0.0, target=50.0) == pytest.approx(60.0)


def test_case_2_takes_the_direction_nearest_the_heading():
    assert select([-20.0, 80.0], heading=0.0, target=90.0) == pytest.approx(-20.0)


def test_directions_off_the_heading_by_the_window_do_not_count():
    assert select([100.5, -101.0], heading=0.0, target=90.0) is None
    assert select([99.0], heading=0.0, target=90.0) == pytest.approx(99.0)


def test_a_target_at_the_case_limit_is_case_2():
    """Limit and target at 0.5 rad: the direction of the heading is taken, not that of the target."""
    assert select_direction([0.5, 0.0], 0.0, 0.5, 2.0, 0.5, None, 0.0) == 0.0
    assert select_direction([0.5, 0.0], 0.0, 0.5, 2.0, 0.625, None, 0.0) == 0.5


def test_case_1_holds_across_180():
    """The target is 20 degrees to the left of the heading; -150 is 20 degrees from it, and 165 is 25."""
    assert select([165.0, -150.0], heading=170.0, target=-170.0) == pytest.approx(-150.0)


def test_a_direction_at_the_window_does_not_count():
    assert [select_direction([d], 0.0, 0.0, 0.5, 2.0, None, 0.0) for d in (-0.5, -0.375, 0.375, 0.5)] == [
        None, -0.375, 0.375, None,
    ]  # fmt: skip


def test_angles_are_circular_at_180():
    assert select([-170.0, 120.0], heading=175.0, target=-175.0) == pytest.approx(-170.0)


def test_loyalty_keeps_the_side_chosen_last():
    assert select([-30.0, 28.0], heading=0.0, target=0.0) == pytest.approx(28.0)
    assert select([-30.0, 28.0], heading=0.0, target=0.0, previous=-35.0, loyalty=20.0) == pytest.approx(-30.0)


@given(st.lists(Angle, min_size=1, max_size=6), Angle, Angle, Angle)
def test_turning_everything_turns_the_choice(directions, heading, target, turn):
    limits = (math.radians(100.0), math.radians(90.0))
    wanted = target if abs(wrap(heading - target)) < limits[1] else heading
    costs = sorted(abs(wrap(d - wanted)) for d in directions)
    assume(all(b - a > 1e-6 for a, b in itertools.pairwise(costs)))
    assume(abs(abs(wrap(heading - target)) - limits[1]) > 1e-6)
    assume(all(abs(abs(wrap(d - heading)) - limits[0]) > 1e-6 for d in directions))
    here = select_direction(directions, heading, target, *limits, None, 0.0)
    there = select_direction([d + turn for d in directions], heading + turn, target + turn, *limits, None, 0.0)
    if here is None:
        assert there is None
    else:
        assert abs(wrap(there - here - turn)) < 1e-9


def test_turn_rate_saturates_at_two_and_a_half_degrees():
    limit = math.radians(25.0)
    assert turn_rate(math.radians(2.4), 0.0, 10.0, limit) == pytest.approx(math.radians(24.0))
    assert turn_rate(math.radians(2.6), 0.0, 10.0, limit) == limit
    assert turn_rate(math.radians(-179.0), math.radians(179.0), 10.0, limit) == pytest.approx(math.radians(20.0))


def test_speed_is_five_times_d30_beyond_the_standoff():
    assert forward_speed(0.46, 5.0, 0.4, 0.5, math.inf, 1.0) == pytest.approx(0.3)
    assert forward_speed(0.39, 5.0, 0.4, 0.5, math.inf, 1.0) == 0.0
    assert forward_speed(3.0, 5.0, 0.4, 0.5, math.inf, 1.0) == 0.5


def test_speed_can_be_stopped_in_the_free_run():
    assert forward_speed(3.0, 5.0, 0.4, 0.5, 0.02, 1.0) == pytest.approx(0.2)
    assert forward_speed(3.0, 5.0, 0.4, 0.5, -0.1, 1.0) == 0.0


def test_motors_that_brake_late_leave_less_speed():
    """0.2 m/s for 0.15 s and then braking at 1 m/s^2 is 0.03 + 0.02 m."""
    assert forward_speed(3.0, 5.0, 0.4, 0.5, 0.05, 1.0, 0.15) == pytest.approx(0.2)


def test_slowing_for_a_turn_has_hysteresis():
    assert [is_turning(w, was, 10.0, 8.0) for w, was in ((9.0, False), (-10.0, False), (9.0, True), (7.9, True))] == [
        False, True, True, False,
    ]  # fmt: skip


@pytest.mark.parametrize(("heading", "target", "sign"), [(170.0, -170.0, 1), (-170.0, 170.0, -1), (0.0, 30.0, 1)])
def test_rotation_goes_to_the_side_of_the_target_also_across_180(heading, target, sign):
    search = RotationSearch(math.radians(100.0))
    search.start(math.radians(heading), math.radians(target))
    assert search.sign == sign


def test_rotation_lasts_100_degrees_and_the_next_keeps_its_sign():
    search = RotationSearch(math.radians(100.0))
    search.start(math.radians(150.0), math.radians(-170.0))
    assert [search.follow(wrap(math.radians(150.0 + turned))) for turned in (50.0, 99.0, 101.0)] == [True, True, False]
    search.start(math.radians(-109.0), math.radians(-170.0))  # the target is to the right now
    assert search.sign == 1
    search.end()
    search.start(math.radians(-109.0), math.radians(-170.0))
    assert search.sign == -1


def test_progress_forgets_attempts_only_when_nearer_than_ever():
    progress = Progress(step=0.1, shift=0.5)
    assert progress.note(5.0, (5.0, 0.0))
    progress.attempts = 3
    assert not progress.note(5.5, (5.0, 0.0))
    assert not progress.note(4.95, (5.0, 0.0))
    assert progress.attempts == 3
    assert progress.note(4.8, (5.0, 0.0))
    assert progress.attempts == 0
    progress.attempts = 2
    assert progress.note(6.0, (7.0, 0.0))  # another target
    assert progress.attempts == 0


def test_a_trap_holds_until_the_robot_or_the_target_is_moved():
    for pose, target, held in (
        ((0.2, 0.0, 0.5), (5.0, 0.0), True),
        ((0.4, 0.0, 0.0), (5.0, 0.0), False),
        ((0.0, 0.0, 1.0), (5.0, 0.0), False),
        ((0.0, 0.0, 0.0), (6.0, 0.0), False),
    ):
        trap = Trap(0.3, math.radians(45.0), place=(0.0, 0.0, 0.0), target=(5.0, 0.0))
        assert trap.holds(pose, target, 0.5) is held
