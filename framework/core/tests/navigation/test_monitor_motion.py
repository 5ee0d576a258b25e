"""The gate's monitor and what moves: it stops before what comes, and takes nothing that is at rest for moving."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numba
import numpy as np
import pytest
from moving_scene import Disc, Scene
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import gate_monitor
from navloom.geometry.actors import Body, parts_of
from navloom.navigation.braking import Braking
from navloom.navigation.collision_monitor import MonitorLimits, warm_up
from navloom.navigation.monitor_motion import MOST_SCANS
from navloom.navigation.monitor_rollout import HEADWAY, MOST_GAIN, escapes, first_meeting, ways_on
from navloom.testing import robot
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PERIOD = 0.05
ROBOT = robot(0.46, 0.42, max_linear=2.0, max_acceleration=1.0, max_deceleration=1.0, motor_lag=0.1, dead_time=0.05)
LIMITS = MonitorLimits(ROBOT, PERIOD, 0.03, approach_speed=2.0)
AT_REST = replace(LIMITS, approach_speed=0.0)
ROOM = np.array([(-6, -5, 6, -5), (6, -5, 6, 5), (6, 5, -6, 5), (-6, 5, -6, -5)], float)
PROVED = 0.5
"""Time after which a disc is seen to move at 0.5 m/s, s."""
AWAY = 4.0
"""Distance from which an actor comes, m."""


def comes(meets: float, angle: float, speed: float, radius: float = 0.25) -> Disc:
    """A disc that comes in a line from a direction, rad, to (meets, 0) from AWAY, m, at a speed, m/s."""
    cos, sin = math.cos(angle), math.sin(angle)
    return Disc(lambda t: (meets + (AWAY - speed * t) * cos, (AWAY - speed * t) * sin), radius)


def moves(x: float, y: float, vx: float, vy: float, radius: float = 0.25) -> Disc:
    """A disc at (x, y), m, at time 0 that moves at a velocity, m/s."""
    return Disc(lambda t: (x + vx * t, y + vy * t), radius)


def walks(way: Callable[[float], float], angle: float, meets: float = 0.0) -> list[Disc]:
    """The legs of a person in a line from a direction, rad, who is way(t), m, before (meets, 0)."""
    body, cos, sin = Body("legs", 0.44, 0.44, (0.0, 1.75)), math.cos(angle), math.sin(angle)

    def leg(k: int, t: float) -> tuple[float, float]:
        far = way(t)
        motion = np.array([(meets + far * cos, far * sin, angle + math.pi, 0.0, 0.0, AWAY - far)])
        x, y = parts_of(body, motion)[0, k, :2].tolist()
        return x, y

    return [Disc(partial(leg, k), 0.07) for k in range(2)]


def speeds_at_contact(scene: Scene, v: float, w: float, seconds: float) -> tuple[float, float]:
    """Drive a command until the disc touches: the speed then, m/s and rad/s; zero without a contact."""
    scene.speed, scene.twist = v, [v, w]
    while scene.time < seconds:
        scene.step(v, w)
        if scene.gap() <= 0.0:
            return abs(scene.twist[0]), abs(scene.twist[1])
    return 0.0, 0.0


def drive(scene: Scene, v: float, seconds: float) -> Scene:
    """Drive a command from its speed on."""
    scene.speed, scene.twist = v, [v, 0.0]
    while scene.time < seconds:
        scene.step(v)
    return scene


# --- what comes -------------------------------------------------------------------------------------------------------


def stands_before(
    limits: MonitorLimits, angle: float, speed: float, v: float, w: float, aims: bool, has_legs: bool = False
) -> bool:
    """Whether a robot with a command stands when what comes to it, or to where it will be then, touches it."""
    time = AWAY / speed
    # What the robot needs: to see it move, its delays, and to brake.
    needed = PROVED + Braking(ROBOT, PERIOD).delay + v / ROBOT.max_deceleration + HEADWAY
    assert time > needed, "its deceleration allows it"
    meets = v * time if aims else 0.0
    comer = walks(lambda t: AWAY - speed * t, angle, meets) if has_legs else [comes(meets, angle, speed)]
    scene = Scene(limits, comer, ROOM)
    if scene.gap() <= 0.0:  # as fast as the robot and from behind: it begins where the robot is
        return True
    at_v, at_w = speeds_at_contact(scene, v, w, time + 1.0)
    return at_v <= 0.05 and at_w <= 0.1


@pytest.mark.parametrize("aims", [True, False])
@pytest.mark.parametrize("speed", [0.5, 1.5])
@pytest.mark.parametrize("turns", [1, 6, 13])
def test_a_robot_that_drives_stands_before_what_comes_touches_it(turns: int, speed: float, aims: bool) -> None:
    assert stands_before(LIMITS, turns * math.tau / 20.0 + 0.03, speed, 0.5, 0.0, aims)


@pytest.mark.parametrize(
    ("turns", "speed", "aims"), [(18, 1.0, True), (7, 1.5, True), (11, 1.5, True), (18, 1.5, False)]
)
def test_it_stands_before_a_walker_whose_legs_hide_each_other(turns: int, speed: float, aims: bool) -> None:
    assert stands_before(LIMITS, turns * math.tau / 20.0 + 0.03, speed, 0.5, 0.0, aims, has_legs=True)


@pytest.mark.slow
@pytest.mark.parametrize("has_legs", [True, False])
@pytest.mark.parametrize("aims", [True, False])
@pytest.mark.parametrize(("v", "w"), [(0.5, 0.0), (1.0, 0.0), (0.5, 0.5), (0.0, 0.8)])
@pytest.mark.parametrize("speed", [0.5, 1.0, 1.5])
def test_it_stands_from_20_directions(speed: float, v: float, w: float, aims: bool, has_legs: bool) -> None:
    angles = np.arange(20) * math.tau / 20.0 + 0.03
    assert [angle for angle in angles if not stands_before(LIMITS, angle, speed, v, w, aims, has_legs)] == []


def test_without_the_allowance_it_still_drives() -> None:
    assert not stands_before(AT_REST, 0.03, 1.5, 0.5, 0.0, aims=True)


def test_a_robot_that_stands_is_not_moved() -> None:
    scene = Scene(LIMITS, [comes(0.0, 0.0, 1.0)], ROOM)
    assert speeds_at_contact(scene, 0.0, 0.0, 5.0) == (0.0, 0.0)
    assert {verdict.kind for verdict in scene.verdicts} == {""}


# --- velocities -------------------------------------------------------------------------------------------------------


def velocities(scene: Scene) -> list[tuple[float, float]]:
    """Of what the monitor takes to be moving, m/s."""
    return [(float(vx), float(vy)) for vx, vy in np.unique(scene.monitor._sensors["laser"].moving[:, 3:5], axis=0)]


@pytest.mark.parametrize(("vx", "vy"), [(-1.0, 0.0), (0.5, 0.0), (0.0, 1.0), (-0.7, 0.7)])
def test_a_disc_has_its_velocity(vx: float, vy: float) -> None:
    scene = drive(Scene(LIMITS, [moves(2.5, -0.5, vx, vy)], ROOM), 0.0, 1.0)
    assert velocities(scene) == [pytest.approx((vx, vy), abs=0.15)]


def test_a_velocity_is_bounded() -> None:
    scene = drive(Scene(LIMITS, [moves(4.0, -1.0, -3.0, 0.0)], ROOM), 0.0, 0.8)
    (velocity,) = velocities(scene)
    assert math.hypot(*velocity) == pytest.approx(2.0) and abs(velocity[1]) < 0.3


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.5])
def test_it_is_seen_to_move_in_time(speed: float) -> None:
    assert velocities(drive(Scene(LIMITS, [moves(3.0, 0.0, -speed, 0.0)], ROOM), 0.0, PROVED)) != []


def test_a_fast_laser_needs_no_more_memory() -> None:
    """At 100 Hz, a window of 1 s has 100 scans."""
    scene = drive(Scene(replace(LIMITS, period=0.01), [moves(3.0, 0.0, -1.0, 0.0)], ROOM), 0.0, 1.0)
    motion = scene.monitor._sensors["laser"].motion
    assert motion is not None and len(motion._slots) == MOST_SCANS
    assert velocities(scene) == [pytest.approx((-1.0, 0.0), abs=0.15)]


def test_two_legs_are_one_walker() -> None:
    """Each leg stands for 0.5 s, and then swings 1 m: together they walk at 1 m/s."""

    def leg(side: float, lead: float) -> Disc:
        def at(t: float) -> tuple[float, float]:
            steps, swing = divmod(t + lead, 1.0)
            share = 0.5 - 0.5 * math.cos(math.pi * max(0.0, 2.0 * swing - 1.0))
            return 3.5 - (steps + share - lead), side

        return Disc(at, 0.06)

    scene = drive(Scene(LIMITS, [leg(0.1, 0.0), leg(-0.1, 0.5)], ROOM, beams=720), 0.0, 1.5)
    (velocity,) = velocities(scene)
    assert velocity == pytest.approx((-1.0, 0.0), abs=0.3)


def test_what_is_seen_across_the_ends_of_a_scan_is_one_thing() -> None:
    scene = drive(Scene(LIMITS, [moves(-2.5, 0.0, 1.0, 0.0)], ROOM), 0.0, 1.0)
    assert velocities(scene) == [pytest.approx((1.0, 0.0), abs=0.15)]


def test_what_is_slower_than_a_fifth_of_a_metre_per_second_is_at_rest() -> None:
    assert velocities(drive(Scene(LIMITS, [moves(1.5, 0.0, -0.1, 0.0)], ROOM), 0.0, 1.5)) == []


def test_what_stops_is_at_rest_half_a_second_later() -> None:
    scene = Scene(LIMITS, [Disc(lambda t: (3.0 - min(t, 1.0), 0.0), 0.25)], ROOM)
    assert velocities(drive(scene, 0.0, 1.0)) != []
    assert velocities(drive(scene, 0.0, 1.7)) == []


@pytest.mark.parametrize("angle", [0.0, 0.8, 1.6, 2.4])
def test_a_walker_who_stops_is_at_rest_a_second_later(angle: float) -> None:
    """Also if one leg hides the other then: after 2 s at 1.2 m/s, at 1.6 m."""
    scene = Scene(LIMITS, walks(lambda t: AWAY - 1.2 * min(t, 2.0), angle), ROOM)
    assert velocities(drive(scene, 0.0, 2.0)) != []
    assert velocities(drive(scene, 0.0, 3.0)) == []


# --- what is at rest --------------------------------------------------------------------------------------------------

POSTS = [moves(1.5 + 0.9 * k, (-1.0) ** k * (0.7 + 0.15 * (k % 3)), 0.0, 0.0, 0.06 + 0.03 * (k % 4)) for k in range(9)]
"""A lane of posts on both sides, which hide parts of the walls behind them."""
LANE = np.array([(-1, 1.6, 9, 1.6), (-1, -1.6, 4, -1.6), (4, -1.6, 4, -3), (9, -3, 9, 1.6), (-1, 1.6, -1, -1.6)], float)


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("slip", [(0.0, 0.0), (0.1, 0.05), (-0.05, -0.05)])
def test_nothing_moves_where_nothing_moves(slip: tuple[float, float], every: int) -> None:
    """Edges sweep along the walls, odometry is up to 10 % wrong, and ranges are noisy."""
    both = [
        drive(Scene(limits, POSTS, LANE, beams=361, every=every, slip=slip), 1.0, 8.0) for limits in (LIMITS, AT_REST)
    ]
    assert both[0].pose == both[1].pose and both[0].verdicts == both[1].verdicts
    assert both[0].pose[0] > 5.0


# --- what moves away --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("limits", "is_held"), [(LIMITS, False), (AT_REST, True)])
def test_what_moves_away_does_not_hold_the_robot(limits: MonitorLimits, is_held: bool) -> None:
    """At 0.9 m/s, the robot needs 0.6 m to stop, and follows at 0.7 m. Echoes of the last 0.5 s are 0.45 m nearer."""
    scene = drive(Scene(limits, [moves(0.64, 0.0, 0.9, 0.0)], ROOM), 0.0, 0.6)
    before = len(scene.verdicts)
    drive(scene, 0.9, 2.0)
    assert any(verdict.kind for verdict in scene.verdicts[before:]) is is_held


@pytest.mark.parametrize("deceleration", [1.0, 3.0])
def test_what_moves_away_and_brakes_is_not_touched(deceleration: float) -> None:
    def brakes(t: float) -> tuple[float, float]:
        passed = min(max(t - 1.5, 0.0), 1.0 / deceleration)
        return 1.2 + min(t, 1.5) + passed - 0.5 * deceleration * passed**2, 0.0

    scene = Scene(LIMITS, [Disc(brakes, 0.25)], ROOM)
    assert speeds_at_contact(scene, 1.0, 0.0, 5.0) == (0.0, 0.0)
    assert scene.gap() > 0.0


# --- predicted places, by hand ----------------------------------------------------------------------------------------

SQUARE = np.array([(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)])
WAY = np.array([(0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.4, 0.0, 0.0)])
TIMES = np.array([0.0, 0.4, 0.8])
"""0.5 m/s for 0.8 s; with HEADWAY, the robot is there for 1 s."""


def meeting(x: float, y: float, vx: float, vy: float, age: float = 0.0, swing: float = 0.0) -> tuple[int, bool]:
    """What the robot of WAY meets if a point moves."""
    moving = np.array([(x, y, 0.0, vx, vy, swing, age)])
    found = first_meeting(WAY, TIMES, 3, HEADWAY, SQUARE, math.sqrt(0.08), moving, np.full(1, 0.01))
    return int(found[0]), bool(found[1])


@pytest.mark.parametrize(
    ("point", "met"),
    [
        # The front ends at 0.6 m. After 1 s, the point is 1 m nearer; 1 cm of margin and 0.1 m/s of doubt are 11 cm.
        ((1.72, 0.0, -1.0, 0.0), False),
        ((1.70, 0.0, -1.0, 0.0), True),
        ((2.00, 0.0, -1.0, 0.0, 0.0, 0.3), True),  # a leg, 0.3 m farther ahead
        ((2.02, 0.0, -1.0, 0.0, 0.0, 0.3), False),
        ((1.92, 0.0, -1.0, 0.0, 0.2), True),  # 0.2 s old: 20 cm nearer, and 2 cm of doubt more
        ((1.94, 0.0, -1.0, 0.0, 0.2), False),
        # It moves away with 1.2 m/s; if it brakes, after 0.24 m.
        ((0.45, 0.0, 1.2, 0.0), True),
        ((0.80, 0.0, 1.2, 0.0), False),
        # The foot of a walker rests while its walker goes on.
        ((0.70, 0.0, 1.2, 0.0, 0.0, 0.3), True),
        ((0.72, 0.0, 1.2, 0.0, 0.0, 0.3), False),
    ],
)
def test_a_moving_point_is_met_where_it_will_be(point: tuple[float, ...], met: bool) -> None:
    assert meeting(*point) == ((0, True) if met else (-1, False))


def test_what_moves_away_gains_a_quarter_of_a_metre_at_most() -> None:
    """At 2 m/s it needs 0.67 m if it brakes with 3 m/s², but the robot does not rely on that."""
    assert MOST_GAIN == 0.25
    assert meeting(0.45, 0.0, 2.0, 0.0)[0] == 0 and meeting(0.48, 0.0, 2.0, 0.0)[0] == -1


def test_what_meets_a_robot_that_stays_is_told_apart() -> None:
    """Beside its flank, driving on brings it no nearer."""
    assert meeting(0.15, 0.9, 0.0, -1.0) == (0, False)
    assert meeting(0.5, 0.9, 0.0, -1.0) == (0, True)


def test_a_robot_that_escapes_is_not_stopped() -> None:
    """A disc follows at 0.7 m/s, 0.38 m behind: it meets a robot that brakes from 1 m/s, and none that goes on.

    The robot needs 0.2 s and 1 s for 0.7 m. With HEADWAY, the disc comes 0.98 m in the same time.
    """
    scene = drive(Scene(LIMITS, [moves(-0.86, 0.0, 0.7, 0.0)], ROOM), 1.0, 1.5)
    assert {verdict.kind for verdict in scene.verdicts} == {""}


def test_a_robot_that_would_be_hit_where_it_stops_goes_on() -> None:
    """A disc crosses at x = 1 m and is at the robot's way after 2.34 s; the robot is at x = 2.34 m then.

    One ahead goes on at the robot's speed. If it braked, the robot could not pass: this kept the robot in the way of
    the first one, which hit it.
    """
    scene = drive(Scene(LIMITS, [moves(1.0, 2.8, 0.0, -1.0), moves(1.3, 0.0, 1.0, 0.0)], 1.5 * ROOM), 1.0, 3.0)
    assert scene.gap() > 0.0 and min(verdict.twist.vx for verdict in scene.verdicts) > 0.9


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="kernels run in plain Python: nothing is compiled")
def test_what_moves_compiles_nothing_while_the_robot_drives() -> None:
    """A kernel that compiles in a tick of a live robot takes seconds."""
    warm_up()
    kernels = [first_meeting, escapes]
    warm = [len(kernel.signatures) for kernel in kernels]
    drive(Scene(LIMITS, [moves(1.0, 2.8, 0.0, -1.0), moves(1.3, 0.0, 1.0, 0.0)], 1.5 * ROOM), 1.0, 3.0)
    drive(Scene(LIMITS, [moves(-0.86, 0.0, 0.7, 0.0)], ROOM), 1.0, 1.5)
    assert [len(kernel.signatures) for kernel in kernels] == warm


@pytest.mark.parametrize(
    ("point", "escaped"),
    [
        # It passes 0.56 m behind: from a gap of 0.8 m to 0.5 m after 0.4 s and 0.7 m after 0.8 s.
        ((-0.5, 1.0, 0.0, -1.5), True),
        ((3.0, 0.0, -1.0, 0.0), False),  # head on: from 2.8 m to 1.6 m
    ],
)
def test_what_is_behind_the_robot_in_the_end_has_been_escaped(point: tuple[float, ...], escaped: bool) -> None:
    x, y, vx, vy = point
    moving = np.array([(x, y, 0.0, vx, vy, 0.0, 0.0)])
    assert escapes(WAY, TIMES, 3, SQUARE, math.sqrt(0.08), moving, np.full(1, 0.01), 0) == escaped


def test_a_way_on_accelerates_along_the_arc_or_straight() -> None:
    """From 0.5 m/s with 1 m/s²: 1 m/s after 0.5 s, on the same arc with twice the turn rate."""
    ways = ways_on(np.array([0.5, 0.4, 0.0]), True, ROBOT, PERIOD)
    at_half_a_second = [(0.5, 0.4, 0.0), (0.5, 0.0, 0.0), (1.0, 0.8, 0.0), (1.0, 0.0, 0.0)]
    assert np.array(ways)[:, 10] == pytest.approx(np.array(at_half_a_second))
    assert len(ways_on(np.array([0.5, 0.4, 0.0]), False, ROBOT, PERIOD)) == 2
    assert len(ways_on(np.array([0.5, 0.0, 0.0]), False, ROBOT, PERIOD)) == 1


def test_a_robot_that_stands_may_accelerate_out_of_the_way() -> None:
    """A disc comes from the side at 1 m/s and is there after 3.5 s. Within 1.3 s, the robot gets 0.8 m away.

    It is clear of the disc from 0.6 m on. With its speed after half a second, 0.5 m/s, it would get 0.5 m away.
    """
    scene, least = Scene(LIMITS, [comes(0.0, 0.5 * math.pi, 1.0)], ROOM), math.inf
    while scene.time < 5.0:
        scene.step(2.0 if scene.time > 2.1 else 0.0)
        least = min(least, scene.gap())
    assert least > 0.0


# --- configuration ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("changes", "speed"), [([], 2.0), (["gate.approach_speed=0"], 0.0)])
def test_the_config_sets_the_highest_speed(changes: list[str], speed: float) -> None:
    monitor = gate_monitor(assemble(load_config("explore", changes)))
    assert monitor is not None and monitor.limits.approach_speed == speed
