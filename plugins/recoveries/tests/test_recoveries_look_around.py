"""Looking around: turns round, then drives to where it has not been, by echoes and velocity alone."""

import math

import numpy as np
import pytest
from navloom import Pose2D, PoseEstimate, RangeScan, RecoveryInput, Twist2D
from navloom.geometry.footprints import rectangle
from navloom.testing import context
from navloom_recoveries import adapter
from navloom_recoveries.looking_around import FIRST_LOOK, LookingAround, LookRules, View
from navloom_recoveries.motion import edges_of, gap
from navloom_recoveries.open_ways import SIGHT, OpenWays

PERIOD = 0.1
RULES = LookRules(
    speed=0.3, turn_rate=math.radians(45.0), deceleration=1.0, leg=2.0, time=100.0, way=60.0, margin=0.03, noise=0.04,
    memory=1.0, delay=0.0,
)  # fmt: skip
SQUARE = rectangle(0.5, 0.5)
BEARINGS = np.radians(np.arange(-135.0, 136.0))
ROOM = [((-2, -2), (2, -2)), ((2, -2), (2, 2)), ((2, 2), (0.9, 2)), ((0, 2), (-2, 2)), ((-2, 2), (-2, -2))]
"""A room of 4 m with a door of 0.9 m in its upper wall; behind it a corridor of 2 m, from -6 to 6 m."""
CORRIDOR = [((-6, 4), (6, 4)), ((-6, 2), (-2, 2)), ((2, 2), (6, 2)), ((-6, 2), (-6, 4)), ((6, 2), (6, 4))]


def scan(pose: tuple[float, float, float], walls=(*ROOM, *CORRIDOR)) -> View:
    """What a laser of 270 degrees without noise sees."""
    starts, ends = (np.array([wall[k] for wall in walls], dtype=float) for k in (0, 1))
    angles, e, from_here = BEARINGS + pose[2], ends - starts, starts - pose[:2]
    dx, dy = np.cos(angles)[:, None], np.sin(angles)[:, None]
    cross = dx * e[:, 1] - dy * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (from_here[:, 0] * e[:, 1] - from_here[:, 1] * e[:, 0]) / cross
        along = (from_here[:, 0] * dy - from_here[:, 1] * dx) / cross
    ranges = np.where((far > 0.0) & (along >= 0.0) & (along <= 1.0), far, 12.0).min(axis=1)
    heard = ranges < 12.0
    points = ranges[heard, None] * np.stack([np.cos(BEARINGS[heard]), np.sin(BEARINGS[heard])], axis=1)
    return View(BEARINGS, np.zeros(len(BEARINGS)), points)


def drive(seconds: float, footprint=SQUARE, start=(0.0, 0.0, 0.0), holds=lambda v, w: False) -> np.ndarray:
    """(n, 5) time, pose and least gap of an ideal robot; the last row is that of the end."""
    looking, pose, v, w, rows = LookingAround(RULES, footprint), start, 0.0, 0.0, []
    looking.start(0.0)
    for tick in range(round(seconds / PERIOD)):
        view = scan(pose)
        rows.append((tick * PERIOD, *pose, gap(view.points, edges_of(footprint))))
        v, w, is_over = looking.step(tick * PERIOD, v, w, [view])
        if is_over:
            break
        v, w = (0.0, 0.0) if holds(v, w) else (v, w)
        middle = pose[2] + 0.5 * w * PERIOD
        pose = (pose[0] + v * PERIOD * math.cos(middle), pose[1] + v * PERIOD * math.sin(middle), pose[2] + w * PERIOD)
    return np.array(rows)


def test_it_stands_first_and_then_turns_round_on_the_spot() -> None:
    rows = drive(FIRST_LOOK + 8.0)
    stands = rows[:, 0] <= FIRST_LOOK
    assert (rows[stands, 1:4] == 0.0).all()
    # 8 s at 45 degrees a second are a turn.
    assert abs(rows[-1, 3]) == pytest.approx(math.tau, abs=0.2) and (rows[:, 1:3] == 0.0).all()


def test_it_leaves_a_room_by_its_door_and_touches_nothing() -> None:
    rows = drive(60.0)
    assert rows[:, 2].max() > 2.5 and rows[:, 4].min() > 0.01


@pytest.mark.parametrize("footprint", [rectangle(1.0, 0.4), rectangle(0.4, 0.6)])
def test_so_does_a_robot_that_is_longer_or_wider_than_it_turns(footprint: np.ndarray) -> None:
    rows = drive(60.0, footprint)
    assert rows[:, 2].max() > 2.3 and rows[:, 4].min() > 0.01


def test_a_robot_close_to_a_wall_drives_out_before_it_turns() -> None:
    rows = drive(20.0, rectangle(1.0, 0.4), (-1.0, -1.75, 0.0))
    assert rows[:, 4].min() > 0.01 and np.ptp(rows[:, 3]) > math.radians(80.0)


def test_it_ends_after_its_time_and_each_run_is_the_same() -> None:
    first, second = drive(RULES.time + 2.0), drive(RULES.time + 2.0)
    assert RULES.time < first[-1, 0] < RULES.time + 2.0 * PERIOD and np.array_equal(first, second)


def test_a_robot_that_the_gate_lets_turn_to_one_side_only_turns_to_that() -> None:
    rows = drive(14.0, holds=lambda v, w: w > 0.0)
    assert rows[:, 3].max() == 0.0 and rows[-1, 3] < -math.pi


def test_an_open_way_is_as_long_as_the_strip_of_the_robot_is_free() -> None:
    ways = OpenWays(half_width=0.3, front=0.25)
    ways.look((0.0, 0.0, 0.0), np.array([0.0]), np.array([math.pi]), np.array([(2.0, 0.2), (0.2, 1.0)]))
    lengths = ways.lengths((0.0, 0.0))
    assert lengths[0] == pytest.approx(2.0 - 0.25, abs=0.05)  # the post beside the strip's middle is in it
    assert lengths[36] == pytest.approx(1.0 - 0.25, abs=0.05) and lengths[72] == SIGHT


def test_a_way_that_no_beam_has_seen_is_not_open() -> None:
    ways = OpenWays(half_width=0.3, front=0.25)
    ways.look((0.0, 0.0, 0.0), np.array([0.0]), np.array([0.5]), np.empty((0, 2)))
    assert ways.best((0.0, 0.0, 0.0), [(0.0, 0.0)], 0.5, math.pi) is not None
    lengths = ways.lengths((0.0, 0.0))
    assert lengths[72] == 0.0 and lengths[0] == SIGHT


def test_of_two_equal_ways_the_one_to_a_new_place_is_taken() -> None:
    ways = OpenWays(half_width=0.3, front=0.25)
    ways.look((0.0, 0.0, 0.0), np.array([0.0]), np.array([math.pi]), np.empty((0, 2)))
    heading, _ = ways.best((0.0, 0.0, 0.0), [(3.0, 0.0), (0.0, 3.0), (0.0, -3.0), (0.0, 0.0)], 0.5, math.pi)
    # 3 m ahead at more than 60 degrees from the others is 3 m away from them.
    assert abs(math.remainder(heading - math.pi, math.tau)) <= math.radians(30.0)


def given(reason: str, stamp: float, starts: bool, x: float = 0.0) -> RecoveryInput:
    n = np.zeros(len(BEARINGS))
    sweep = RangeScan(0, np.zeros((len(BEARINGS), 2)), BEARINGS, n, n, n + 3.0, 0.1, 12.0)
    estimate = PoseEstimate(0, Pose2D(x, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)), "searching", "lost")
    return RecoveryInput(round(stamp * 1e9), (sweep,), estimate, 1, reason, starts)


def test_the_plugin_looks_around_for_this_reason_only_and_wherever_the_estimate_jumps() -> None:
    here, jumps = (adapter.LookAround(adapter.LookAroundParams(), context()) for _ in range(2))
    for tick in range(40):
        stamp = tick * PERIOD
        steady, moved = (
            plugin.recover(given("searching", stamp, tick == 0, x)) for plugin, x in ((here, 0.0), (jumps, float(tick)))
        )
        assert steady.state == "running" and steady.twist == moved.twist and not steady.clear_map
    assert steady.twist.wz != 0.0
    other = adapter.LookAround(adapter.LookAroundParams(), context())
    retrace = adapter.Retrace(adapter.RetraceParams(), context())
    for tick in range(20):
        stuck = given("no_progress", tick * PERIOD, tick == 0)
        assert other.recover(stuck) == retrace.recover(stuck)
