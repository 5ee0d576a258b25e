"""The presets of the VFF, value by value: echoes in, command and window out.

By default a cell of certainty C at a distance d from the centre pushes with F = 0.25^2 / 15 C / (d - 0.5657)^2, where
0.5657 m is the half diagonal of the robot; the target pulls with 1.
"""

import math

import numpy as np
import pytest
from avoider_posts import EVERYWHERE, cones, drive, posts, preset, tick
from navloom import Claim
from navloom_vff.adapter import Vff

FREE = cones(EVERYWHERE, math.inf, half_angle=0.0)
BOTH = pytest.mark.parametrize("name", ["robust", "printed"])
WEAK = {"balance": 0.001, "time_constant": 0.0}
"""Changes for tests of the arc check: the target alone decides."""


def vff(name, **given):
    return preset(Vff, name, **given)


DISC = 0.4 * math.sqrt(2.0)


def force(certainty, distance, reach=0.25, radius=DISC):
    return reach**2 / 15.0 * certainty / (distance - radius) ** 2


def direction(push, factor, pull):
    """Of the sum of the forces; degrees."""
    x, y = math.cos(math.radians(pull)) + factor * push[0], math.sin(math.radians(pull)) + factor * push[1]
    return math.degrees(math.atan2(y, x))


def test_it_claims_to_stop_where_all_is_closed():
    assert Vff.claims == {Claim.STOPS_WHEN_CLOSED}


@BOTH
def test_the_window_has_33_cells_of_0_1_m_and_the_histogram_72_sectors(name):
    told = tick(vff(name), FREE, x=2.05).diagnostics
    assert told.window.shape == (33, 33) and told.histogram.shape == (72,)
    assert (told.window_x, told.window_y) == pytest.approx((0.4, -1.6))


@BOTH
def test_an_echo_adds_3_and_a_look_through_takes_1_off(name):
    avoider = vff(name)
    assert tick(avoider, posts((0.85, 0.25))).diagnostics.window.sum() == 3
    assert tick(avoider, cones([math.degrees(math.atan2(0.25, 0.8))], math.inf)).diagnostics.window.sum() == 2


@pytest.mark.parametrize(("name", "echo", "left"), [("robust", 1.02, 2), ("robust", 0.99, 3), ("printed", 0.945, 2)])
def test_the_last_0_1_m_before_an_echo_are_not_taken_off(name, echo, left):
    """The beam at 6.14 degrees enters the cell (0.95, 0.05) 0.9052 m away. As printed, all are taken off."""
    avoider = vff(name)
    tick(avoider, posts((0.95, 0.05), x=0.0), x=0.0)
    assert tick(avoider, cones([6.14], echo), x=0.0).diagnostics.window[16, 25] == left


@pytest.mark.parametrize(("origin", "distance", "columns"), [(0.5, 0.3, [22, 23]), (0.0, 1.07, [26])])
def test_a_reading_at_the_least_range_counts_0_1_m_before_it_too(origin, distance, columns):
    """0.3 m from a sensor at 0.5 m counts at 0.8, 0.75 and 0.7 m (times the cosine of 2 degrees), 1.07 m at 1.02 m too.
    As printed, it counts once."""
    scan = cones([2.0], distance, range_min=distance, origin=(origin, 0.0))
    for name, expected in (("robust", columns), ("printed", columns[-1:])):
        assert np.argwhere(tick(vff(name), scan, x=0.0).diagnostics.window)[:, 1].tolist() == expected


def test_a_cell_pushes_with_its_certainty_over_the_squared_distance_to_the_disc():
    """(1.05, 0.15), d = 1.0607: 0.0125 / 0.495^2 = 0.0510. As printed from the centre, 0.4 m inside the body's side:
    0.65^2 / 15 * 3 / 1.125 = 0.0751."""
    d = math.hypot(1.05, 0.15)
    told = tick(vff("robust"), posts((1.05, 0.15), x=0.0), x=0.0).diagnostics
    assert told.histogram.sum() == pytest.approx(force(3.0, d)) == pytest.approx(0.05102, abs=1e-5)
    told = tick(vff("printed"), posts((1.05, 0.15), x=0.0), x=0.0).diagnostics
    assert told.histogram.sum() == pytest.approx(force(3.0, d, 0.65, 0.0)) == pytest.approx(0.07511, abs=1e-5)


def test_a_cell_nearer_than_0_1_m_pushes_no_harder():
    """(0.65, 0.05) is 0.0862 m from the disc: 0.0125 / 0.01 = 1.25."""
    told = tick(vff("robust"), posts((0.65, 0.05), x=0.0), x=0.0).diagnostics
    assert told.histogram.sum() == pytest.approx(1.25)


def test_cells_behind_the_target_do_not_push():
    """The cell is 1.051 m away: behind a target at 0.4 m and the disc. As printed it pushes."""
    for name, distance, pushes in (("robust", 0.4, False), ("robust", 0.5, True), ("printed", 0.4, True)):
        told = tick(vff(name), posts((1.05, 0.05), x=0.0), x=0.0, distance=distance).diagnostics
        assert bool(told.histogram.any()) is pushes


@BOTH
def test_a_force_along_the_way_is_damped_to_a_quarter(name):
    """A post at (0.05, 0.85) pushes to the right: cos = -0.0588, and 0.25 + 0.75 * 0.0588 = 0.294 of it is left."""
    d = math.hypot(0.05, 0.85)
    push = force(3.0, d) if name == "robust" else force(3.0, d, 0.65, 0.0)
    told = tick(vff(name), posts((0.05, 0.85), x=0.0), x=0.0).diagnostics
    expected = direction((-push * 0.05 / d, -push * 0.85 / d), 0.25 + 0.75 * 0.05 / d, 0.0)
    assert math.degrees(told.chosen) == pytest.approx(expected)


def test_an_obstacle_behind_pulls_as_printed_only():
    """A post at (-0.85, 0.05), target to the left: (2 * 0.25 - 1) of its force, by the cosine of 3.4 degrees."""
    d = math.hypot(0.85, 0.05)
    push, factor = force(3.0, d, 0.65, 0.0), 0.25 - 0.75 * 0.85 / d
    scan = posts((-0.85, 0.05), x=0.0)
    assert math.degrees(tick(vff("robust"), scan, x=0.0, target=80.0).diagnostics.chosen) == pytest.approx(80.0)
    expected = direction((push * 0.85 / d, -push * 0.05 / d), factor, 80.0)
    assert math.degrees(tick(vff("printed"), scan, x=0.0, target=80.0).diagnostics.chosen) == pytest.approx(expected)


@BOTH
def test_the_turn_rate_is_1_25_times_the_angle_up_to_120_degrees_a_second_and_filtered_over_0_4_s(name):
    """An eighth of it in the first tick of 0.05 s, and an eighth of the rest in the second."""
    avoider = vff(name)
    assert drive(avoider, FREE, target=40.0)[1] == pytest.approx(50.0 / 8.0)
    assert drive(avoider, FREE, target=40.0)[1] == pytest.approx(50.0 / 8.0 + 50.0 * 7.0 / 64.0)
    assert drive(vff(name), FREE, target=170.0)[1] == pytest.approx(120.0 / 8.0)


def test_it_slows_by_the_cosine_of_the_turn_and_not_as_printed():
    assert drive(vff("robust"), FREE, target=40.0)[0] == pytest.approx(0.78 * math.cos(math.radians(40.0)))
    assert drive(vff("printed"), FREE, target=40.0)[0] == pytest.approx(0.78)


def test_a_push_from_ahead_slows_in_proportion_to_a_force_of_1_and_as_printed_in_full():
    """(1.05, 0.15): V = 0.78 (1 - 0.05102 * 0.98995), times the cosine of the turn; as printed 0.78 (1 - 0.98995), less
    than the least speed, 0.04."""
    scan, d = posts((1.05, 0.15), x=0.0), math.hypot(1.05, 0.15)
    answer = tick(vff("robust"), scan, x=0.0)
    slowed = 0.78 * (1.0 - force(3.0, d) * 1.05 / d)
    assert answer.twist.vx == pytest.approx(slowed * math.cos(answer.diagnostics.chosen))
    assert drive(vff("printed"), scan, x=0.0)[0] == pytest.approx(0.04)


def test_a_push_from_behind_slows_as_printed_only():
    """(-0.85, 0.25): |cos| = 0.9594."""
    scan = posts((-0.85, 0.25), x=0.0)
    assert drive(vff("robust"), scan, x=0.0)[0] == pytest.approx(0.78, abs=1e-3)
    assert drive(vff("printed"), scan, x=0.0)[0] == pytest.approx(0.04)
    side = posts((-0.25, 0.85), x=0.0)
    cosine = 0.25 / math.hypot(0.25, 0.85)
    assert drive(vff("printed"), side, x=0.0)[0] == pytest.approx(0.78 * (1.0 - cosine))


SIDE = posts((0.45, 0.75), x=0.0)


def obedient(avoider, scan, times, **place):
    """The answers to a robot that moves as commanded without getting anywhere."""
    twist, answers = (0.0, 0.0), []
    for _ in range(times):
        answers.append(tick(avoider, scan, twist=twist, **place))
        twist = (answers[-1].twist.vx, answers[-1].twist.wz)
    return answers


def test_after_4_s_without_progress_it_follows_the_wall_at_145_degrees_to_its_push():
    """Ticks are 0.5 s apart: after nine it hesitated for 4.5 s, and the tenth begins."""
    told = [answer.diagnostics for answer in obedient(vff("robust", period=0.5), SIDE, 10, x=0.0, target=30.0)]
    assert ["following" in t.why for t in told] == [False] * 9 + [True]
    d = math.hypot(0.45, 0.75)
    push = force(15.0, d)
    away = math.degrees(math.atan2(-0.75, -0.45))
    expected = direction((-push * 0.45 / d, -push * 0.75 / d), 0.25 + 0.75 * 0.45 / d, away + 145.0)
    assert math.degrees(told[-1].chosen) == pytest.approx(expected)


def test_progress_and_turning_back_to_the_target_begin_the_4_s_anew():
    """8 ticks of 0.5 s, then one 0.2 m nearer to the target, or turned away from it: nine more before it follows."""
    for place in ({"distance": 4.8}, {"heading": -65.0}):
        avoider = vff("robust", period=0.5)
        twist = obedient(avoider, SIDE, 8, x=0.0, target=30.0)[-1].twist
        answer = tick(avoider, SIDE, twist=(twist.vx, twist.wz), **{"x": 0.0, "target": 30.0} | place)
        told = ["following" in answer.diagnostics.why]
        for _ in range(9):
            twist = answer.twist
            answer = tick(
                avoider, SIDE, twist=(twist.vx, twist.wz), x=0.0, target=30.0, distance=place.get("distance", 5.0)
            )
            told.append("following" in answer.diagnostics.why)
        assert told == [False] * 9 + [True], place


def test_as_printed_looking_away_from_the_target_is_a_trap_at_once_until_it_looks_back():
    """By default the forces must lead away too, and it follows until it is past the obstacle."""
    for name, is_following in (("printed", [True, False]), ("robust", [False, False])):
        avoider = vff(name)
        told = [tick(avoider, SIDE, x=0.0, target=t).diagnostics.why for t in (91.0, 89.0)]
        assert ["following" in why for why in told] == is_following


def test_by_default_it_follows_on_when_it_looks_back_to_the_target():
    avoider = vff("robust", period=0.5)
    assert "following" in obedient(avoider, SIDE, 10, x=0.0, target=30.0)[-1].diagnostics.why
    assert "following" in tick(avoider, SIDE, x=0.0, target=30.0).diagnostics.why


def test_as_printed_it_never_hesitates():
    told = obedient(vff("printed", period=0.5), SIDE, 40, x=0.0, target=30.0)
    assert not any("following" in answer.diagnostics.why for answer in told)


HERE = {"x": 0.0, "target": 30.0}


def trapped(**given):
    """An avoider that gave up, and the seconds that it took; ticks are 1 s apart."""
    avoider, twist = vff("robust", period=1.0, **given), (0.0, 0.0)
    for count in range(1, 200):
        answer = tick(avoider, SIDE, twist=twist, **HERE)
        if answer.status == "trapped":
            return avoider, count
        twist = (answer.twist.vx, answer.twist.wz)
    return avoider, math.inf


def test_it_gives_up_after_60_s_without_progress():
    assert trapped()[1] == 61


def test_progress_is_0_1_m_and_a_target_0_5_m_away_is_another():
    for distance, is_new in ((4.91, False), (4.89, True), (5.48, False), (5.52, True)):
        avoider = vff("robust", period=1.0)
        last = obedient(avoider, SIDE, 60, **HERE)[-1].twist
        after = tick(avoider, SIDE, twist=(last.vx, last.wz), distance=distance, **HERE)
        assert (after.status != "trapped") is is_new, distance


def test_a_trapped_robot_is_released_by_0_3_m_by_45_degrees_or_by_another_target():
    for changed, is_released in (
        ({"x": 0.29}, False), ({"x": 0.31}, True), ({"heading": 44.0}, False), ({"heading": -46.0}, True),
        ({"distance": 5.48}, False), ({"distance": 5.52}, True),
    ):  # fmt: skip
        avoider, _ = trapped()
        assert (tick(avoider, FREE, **{**HERE, **changed}).status != "trapped") is is_released, changed


def turning(name="robust", period=0.05, **changes):
    return vff(name, period=period, changes={**WEAK, **changes}, max_angular=math.radians(25.0))


def test_a_turn_in_place_keeps_0_12_m_for_a_tick_and_0_2_s():
    """A post 0.15 m beside the robot and p ahead of its centre: after 0.25 s at 25 degrees a second it is
    0.55 cos 6.25 - p sin 6.25 - 0.4 m beside it: 0.118 m for p = 0.26, so half the turn; 0.123 m for p = 0.22."""
    for x, turn in ((0.09, -12.5), (0.13, -25.0)):
        answer = tick(turning(), posts((0.35, -0.55), x=x), x=x, target=-170.0)
        assert (answer.twist.vx, math.degrees(answer.twist.wz)) == (0.0, pytest.approx(turn))
        assert ("reduced by what is on the arc" in answer.diagnostics.why) is (turn == -12.5)


def test_without_room_to_turn_it_creeps_out_at_0_1_m_a_second():
    """A post 0.05 m beside the robot's front half. As printed the command is sent as it is."""
    scan = posts((0.35, -0.45), x=0.0)
    assert drive(turning(), scan, x=0.0, target=-170.0) == (pytest.approx(0.1), pytest.approx(0.0))
    assert drive(turning("printed"), scan, x=0.0, target=-170.0)[1] < -15.0


def test_it_gives_up_after_5_s_without_room_to_move():
    """Ticks are 1 s apart, and posts 0.05 m off on all sides."""
    scan = posts((0.35, 0.45), (0.35, -0.45), (-0.35, 0.45), (-0.35, -0.45), (0.45, 0.05), (0.45, -0.05), x=0.0)
    avoider = turning(period=1.0)
    told = [tick(avoider, scan, x=0.0, target=-170.0) for _ in range(6)]
    assert [answer.status for answer in told] == ["steering"] * 5 + ["trapped"]
