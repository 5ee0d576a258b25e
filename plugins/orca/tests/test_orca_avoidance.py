"""Ticks of the avoider on plain arrays: effective centre, limits, lag, tracks, lines of echoes."""

import math

import numpy as np
import pytest
from navloom_avoidance.beams import Beams
from navloom_avoidance.bodies import NO_BODIES, TrackedBodies
from navloom_avoidance.robot import Robot
from navloom_dwa.avoidance import Given
from navloom_orca.avoidance import LIMITS, Reciprocal
from navloom_orca.outline import lines_of
from navloom_orca.params import RECIPROCAL, OrcaParams

JACKAL = np.array([[0.229, 0.208], [-0.229, 0.208], [-0.229, -0.208], [0.229, -0.208]])
HERE = (0.0, 0.0, 0.0)
PERIOD = 0.05
PLACE = np.diag([1.0, 1.0, 0.0, 0.0])
"""Covariance of a body whose velocity is known."""


def method_of(lag=0.0, dead_time=0.0, **params):
    robot = Robot(JACKAL, 2.0, math.pi, 2.0, 2.0, lag, dead_time, half_track=0.19)
    return Reciprocal(OrcaParams(**params), robot, PERIOD)


def bodies(*rows, radius=0.3, sigma=0.0):
    """Tracks (x, y, vx, vy), m and m/s."""
    rows = np.array(rows, dtype=float).reshape(-1, 4)
    return TrackedBodies(
        rows[:, :2], rows[:, 2:], np.full(len(rows), radius), sigma**2 * np.tile(PLACE, (len(rows), 1, 1))
    )


def given(target=(8.0, 0.0), pose=HERE, twist=(0.0, 0.0), tracks=NO_BODIES, time=0.0, remaining=0.0):
    return Given(time, pose, twist, target, remaining, 1.0, tracks)


def laser(points, pose=HERE, reach=10.0):
    """Scan of 360 beams that see points as discs of 5 cm."""
    bearings = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    ranges = np.full(360, np.inf)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for x, y in points:
        dx, dy = x - pose[0], y - pose[1]
        across = c * dx + s * dy, c * dy - s * dx
        distance, bearing = math.hypot(*across), math.atan2(across[1], across[0])
        hit = np.abs(np.remainder(bearings - bearing + math.pi, 2.0 * math.pi) - math.pi) < math.atan2(0.05, distance)
        ranges[hit] = np.minimum(ranges[hit], distance)
    zeros = np.zeros(360)
    return Beams.fixed(
        np.zeros((360, 2)), bearings, zeros, ranges, np.tile([0.1, reach], (360, 1)), np.zeros(360, np.int64)
    )


def drive(method, steps, target=(8.0, 0.0), points=(), track=None):
    """Poses (n, 3) of an ideal robot, and the least gap between the footprint's disc and tracks of radius 0.3 m."""
    pose, twist, poses, gap = HERE, (0.0, 0.0), [HERE], math.inf
    for k in range(steps):
        time = PERIOD * k
        tracks = NO_BODIES if track is None else bodies(*np.atleast_2d(track(time)))
        decision = method.step([laser(points, pose)], None, given(target, pose, twist, tracks, time))
        v = min(max(decision.speed, twist[0] - 2.0 * PERIOD), twist[0] + 2.0 * PERIOD)
        heading = pose[2] + decision.turn * PERIOD
        pose = (pose[0] + v * PERIOD * math.cos(heading), pose[1] + v * PERIOD * math.sin(heading), heading)
        twist = (v, decision.turn)
        poses.append(pose)
        if track is not None:
            places = np.atleast_2d(track(time + PERIOD))[:, :2]
            gap = min(gap, np.hypot(*(places - pose[:2]).T).min() - 0.3 - math.hypot(0.229, 0.208))
    return np.array(poses), gap


def test_the_disc_about_the_effective_centre_holds_the_footprint():
    """Half of the inscribed radius of 0.208 m ahead; the rear corners are 0.229 + 0.104 m behind it, 0.208 m aside."""
    method = method_of(centre=0.5)
    assert method.ahead == pytest.approx(0.104)
    assert method.radius == pytest.approx(math.hypot(0.333, 0.208))


def test_the_velocity_of_the_centre_gives_speed_and_turn_rate():
    """A centre that is to move at 0.2 m/s to the left turns the robot by 0.2 / 0.104 rad/s, at most by the ramp."""
    method = method_of()
    decision = method.step([], None, given(target=(0.0, 5.0)))
    assert method.taken[0] == pytest.approx(0.0, abs=1e-9)
    assert method.taken[1] == pytest.approx(0.104 * math.pi, abs=1e-9)
    assert decision.turn == pytest.approx(2.0 / 0.19 * PERIOD)


def test_a_velocity_is_reachable_within_the_window():
    """From standing, 2 m/s² reach 0.8 m/s in 0.4 s."""
    method = method_of(window=0.4)
    assert method.step([], None, given()).speed == pytest.approx(0.8)


def test_before_the_end_of_the_path_it_slows_down():
    """0.5 m before the goal at 2 m/s²: at most sqrt(2 * 2 * 0.5) = 1.41 m/s."""
    speed = method_of(window=5.0).step([], None, given(target=(0.5, 0.0), twist=(1.0, 0.0))).speed
    assert 0.5 < speed < 1.41


def test_to_a_target_behind_it_turns_in_place():
    decision = method_of().step([], None, given(target=(-3.0, 0.5)))
    assert decision.speed == pytest.approx(0.0, abs=1e-9)
    assert decision.turn > 0.3


def test_with_lag_the_robot_is_where_its_commands_lead_it():
    """1 m/s for a dead time of 0.1 s and a lag of 0.1 s: 0.2 m ahead."""
    method = method_of(lag=0.1, dead_time=0.1)
    for k in range(20):
        method.step([], None, given(twist=(1.0, 0.0), time=PERIOD * k))
        method.motors.give(1.0, 0.0)
    method.in_flight = method.motors.in_flight((1.0, 0.0), 1.0)
    assert method._when_it_acts((1.0, 0.0)) == pytest.approx((0.2, 0.0, 0.0), abs=1e-9)


def test_a_track_is_one_half_plane_and_no_track_none():
    method = method_of()
    method.step([], None, given())
    assert len(method.planes) == LIMITS
    method.step([], None, given(tracks=bodies((4.0, 0.0, -1.0, 0.0))))
    assert len(method.planes) == LIMITS + 1


def test_a_track_out_of_reach_does_not_count():
    method = method_of(reach=3.0)
    method.step([], None, given(tracks=bodies((4.0, 0.0, -1.0, 0.0))))
    assert len(method.planes) == LIMITS


@pytest.mark.parametrize("y", [0.05, -0.05, 0.3])
def test_one_that_comes_towards_the_robot_and_sees_nothing_is_avoided(y):
    poses, gap = drive(method_of(), 160, track=lambda time: (6.0 - time, y, -1.0, 0.0))
    assert gap > 0.0
    assert poses[:, 0].max() > 7.0


def test_one_that_crosses_is_let_past():
    poses, gap = drive(method_of(), 160, track=lambda time: (3.0, -2.0 + time, 0.0, 1.0))
    assert gap > 0.0
    assert poses[:, 0].max() > 7.0


def test_an_unsure_place_counts_as_a_larger_body():
    near, far = method_of(), method_of()
    near.step([], None, given(tracks=bodies((4.0, 0.0, -1.0, 0.0), sigma=0.2)))
    far.step([], None, given(tracks=bodies((4.0, 0.0, -1.0, 0.0), radius=0.5)))
    np.testing.assert_allclose(near.planes, far.planes)


def test_echoes_of_a_track_are_no_line_obstacle():
    method = method_of()
    method.step([laser([(2.0, 0.0)])], None, given(tracks=bodies((2.2, 0.0, 0.0, 1.0))))
    assert len(method.planes) == LIMITS + 1


def swap(*tasks, seconds=20.0, **params):
    """Way left to each goal, m, of ideal robots that see each other, and the least gap of two footprints' discs, m.

    Args:
        tasks: Start x, y, heading, and goal x, y, of each robot. params: Besides those of the preset `reciprocal`.
    """
    params = RECIPROCAL.values() | params
    methods, poses = [method_of(**params) for _ in tasks], np.array([task[:3] for task in tasks], dtype=float)
    twists, gap, circle = np.zeros((len(tasks), 2)), math.inf, math.hypot(0.229, 0.208)
    for k in range(round(seconds / PERIOD)):
        speeds = twists[:, :1] * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        rows, decisions = np.column_stack([poses[:, :2], speeds]), []
        for i, method in enumerate(methods):
            others = bodies(*np.delete(rows, i, axis=0), radius=circle)
            now = given(tasks[i][3:], tuple(poses[i]), tuple(twists[i]), others, PERIOD * k)
            decisions.append(method.step([], None, now))
        for i, decision in enumerate(decisions):
            v = min(max(decision.speed, twists[i, 0] - 2.0 * PERIOD), twists[i, 0] + 2.0 * PERIOD)
            heading = poses[i, 2] + decision.turn * PERIOD
            poses[i] += (v * PERIOD * math.cos(heading), v * PERIOD * math.sin(heading), decision.turn * PERIOD)
            twists[i] = v, decision.turn
        between = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).transpose(2, 0, 1))
        gap = min(gap, between[~np.eye(len(tasks), dtype=bool)].min() - 2.0 * circle)
    return np.hypot(*(poses[:, :2] - np.array(tasks)[:, 3:]).T), gap


@pytest.mark.parametrize("count", [4, 6])
def test_robots_in_exact_symmetry_pass_each_other_on_the_right(count):
    """On a circle of 3 m radius, each to the opposite side: without the right hand all stop before they meet."""
    turns = np.arange(count) * math.tau / count
    tasks = [(3.0 * math.cos(a), 3.0 * math.sin(a), a + math.pi, -3.0 * math.cos(a), -3.0 * math.sin(a)) for a in turns]
    left, gap = swap(*tasks)
    assert left.max() < 0.2 and gap > 0.0
    left, _ = swap(*tasks, keep_right_deg=0.0)
    assert left.min() > 2.0


def test_a_robot_that_is_held_up_turns_aside_at_90_degrees_a_second():
    """Half a second before one that comes, at 0.85 m: the velocity wanted then is 45 degrees to the right."""
    method = method_of(keep_right_deg=75.0)
    for k in range(11):
        method.step([], None, given(tracks=bodies((0.9 - 0.001 * k, 0.0, -0.02, 0.0)), time=PERIOD * k))
    assert math.degrees(math.atan2(method.wanted[1], method.wanted[0])) == pytest.approx(-45.0)


def test_a_track_that_stands_for_two_seconds_counts_by_its_echoes():
    method = method_of(standing_by_echoes=True)
    counts = []
    for k in range(50):
        method.step([], None, given(tracks=bodies((2.0, 0.0, 0.0, 0.0)), time=PERIOD * k))
        counts.append(len(method.planes) - LIMITS)
    assert counts == [1] * 40 + [0] * 10


@pytest.mark.parametrize("by_echoes", [True, False])
def test_two_that_stand_1_4_m_apart_can_be_passed_by_their_echoes(by_echoes):
    """In a corridor of 3 m. Their discs and the robot's, 0.39 + 0.3 + 0.1 m each, leave nothing between them."""
    stand = np.array([(2.0, 0.7, 0.0, 0.0), (2.0, -0.7, 0.0, 0.0)])
    around = [
        (2.0 + 0.2 * math.cos(a), y + 0.2 * math.sin(a)) for a in np.linspace(0.0, math.tau, 24) for y in (0.7, -0.7)
    ]
    walls = [(x, y) for x in np.arange(-1.0, 6.0, 0.04) for y in (1.5, -1.5)]
    method = method_of(standing_by_echoes=by_echoes)
    for k in range(50):
        method.step([], None, given(target=HERE[:2], tracks=bodies(*stand), time=PERIOD * (k - 50)))
    poses, _ = drive(method, 100, points=around + walls, track=lambda time: stand)
    assert (poses[:, 0].max() > 4.0) == by_echoes


@pytest.mark.parametrize(("swing", "is_trapped"), [(0.2, False), (0.0, True)])
def test_only_what_moves_is_waited_for(swing, is_trapped):
    """A corridor of 1.2 m with somebody in it, who walks from side to side or stands."""
    walls = [(x, y) for x in np.arange(-3.0, 3.0, 0.04) for y in (-0.6, 0.6)]
    method = method_of(blocked_patience=0.5)
    drive(
        method,
        400,
        points=walls,
        track=lambda time: (2.0, swing * math.sin(3.0 * time), 0.0, 3.0 * swing * math.cos(3.0 * time)),
    )
    assert (method.trap.place is not None) == is_trapped


def test_posts_are_passed():
    poses, _ = drive(method_of(), 200, points=[(2.0, 0.1), (4.0, -0.2), (5.5, 0.1)])
    assert poses[:, 0].max() > 7.0


def test_before_a_wall_it_stops():
    """A wall 2 m ahead with no end in sight: the front of 0.229 m stays before it, and the robot reports a trap."""
    wall = [(2.0, y) for y in np.arange(-6.0, 6.0, 0.03)]
    method = method_of(blocked_patience=0.5, patience=2.0)
    poses, _ = drive(method, 300, points=wall)
    assert poses[:, 0].max() < 2.0 - 0.229
    assert method.trap.place is not None


def test_mirrored_scenes_have_mirrored_answers():
    left, right = method_of(), method_of()
    posts, track = [(1.5, 0.3), (2.5, -0.6)], (4.0, 0.3, -1.0, -0.1)
    for k in range(8):
        first = left.step([laser(posts)], None, given((6.0, 1.0), HERE, (0.5, 0.2), bodies(track), PERIOD * k))
        flipped, other = [(x, -y) for x, y in posts], (4.0, -0.3, -1.0, 0.1)
        second = right.step([laser(flipped)], None, given((6.0, -1.0), HERE, (0.5, -0.2), bodies(other), PERIOD * k))
        assert first.speed == pytest.approx(second.speed, abs=1e-6)
        assert first.turn == pytest.approx(-second.turn, abs=1e-6)


def test_the_frame_does_not_matter():
    c, s = math.cos(2.0), math.sin(2.0)
    turned = np.array([[c, s], [-s, c]])

    def moved(x, y):
        return (np.array([x, y]) @ turned + (7.0, -3.0)).tolist()

    first = method_of().step([], None, given((6.0, 1.0), twist=(0.5, 0.2), tracks=bodies((4.0, 0.3, -1.0, 0.1))))
    track = TrackedBodies(
        np.array([moved(4.0, 0.3)]), np.array([[-1.0, 0.1]]) @ turned, np.full(1, 0.3), np.zeros((1, 4, 4))
    )
    second = method_of().step([], None, given(tuple(moved(6.0, 1.0)), (7.0, -3.0, 2.0), (0.5, 0.2), track))
    assert second[:2] == pytest.approx(first[:2], abs=1e-9)


def test_the_same_inputs_give_the_same_commands():
    def commands():
        method = method_of()
        return [method.step([laser([(1.5, 0.3)])], None, given(time=PERIOD * k))[:2] for k in range(5)]

    assert commands() == commands()


def test_a_straight_wall_is_one_line():
    wall = np.array([(2.0, y) for y in np.arange(-1.0, 1.0, 0.1)])
    (line,) = lines_of(wall, 0.0, 0.0, 5.0, 0.3, 0.06)
    assert line.tolist() == pytest.approx([2.0, -1.0, 2.0, 0.9])


def test_a_corner_is_two_lines_and_a_post_a_point():
    corner = [(2.0, y) for y in np.arange(-1.0, 1.25, 0.1)] + [(x, 1.2) for x in np.arange(1.0, 2.0, 0.1)]
    lines = lines_of(np.array([*corner, (-2.0, 0.5)]), 0.0, 0.0, 5.0, 0.3, 0.06)
    assert len(lines) == 3
    points = [line for line in lines.tolist() if line[:2] == line[2:]]
    assert points == [[-2.0, 0.5, -2.0, 0.5]]


def test_a_gap_wider_than_the_robot_stays_open():
    wall = np.array([(2.0, y) for y in np.arange(-2.0, 2.0, 0.05) if abs(y) > 0.4])
    assert len(lines_of(wall, 0.0, 0.0, 5.0, 0.6, 0.06)) == 2
    assert len(lines_of(wall, 0.0, 0.0, 5.0, 1.0, 0.06)) == 1


def test_a_closed_ring_is_not_cut():
    """A square around the robot: four sides."""
    side = np.arange(-1.0, 1.0, 0.05)
    ring = np.vstack([
        np.column_stack([side, np.full(40, -1.0)]), np.column_stack([np.full(40, 1.0), side]),
        np.column_stack([-side, np.full(40, 1.0)]), np.column_stack([np.full(40, -1.0), -side]),
    ])  # fmt: skip
    ends = lines_of(ring, 0.0, 0.0, 5.0, 0.3, 0.06).reshape(-1, 2)
    assert 8 <= len(ends) <= 10
    assert set(np.unique(ends, axis=0, return_counts=True)[1].tolist()) == {2}


def test_no_echo_is_no_line():
    assert len(lines_of(np.zeros((0, 3)), 0.0, 0.0, 5.0, 0.3, 0.06)) == 0
