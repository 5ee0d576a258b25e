"""Single ticks and short drives of an ideal robot."""

import math
from itertools import pairwise

import numpy as np
import pytest
from mppi_scenes import HERE, drive_to, laser, line, method_of
from navloom_avoidance.robot import Robot
from navloom_mppi.control import Given, weights_by_critic
from navloom_mppi.critics import COLLISION, CRITICS
from navloom_mppi.params import MppiParams

AHEAD = line(6.0, 0.0)
POSTS = [(1.5, 0.3), (2.5, -0.6), (3.0, 1.2)]


def given(path=AHEAD, twist=(0.0, 0.0), time=0.0, share=1.0, turn_to=None):
    return Given(time, HERE, twist, path, turn_to, share)


def test_the_first_command_is_what_the_ramp_allows():
    """2 m/s² in 0.05 s from standing: 0.1 m/s. A wheel that gains 2 m/s² at 0.19 m turns by 0.53 rad/s."""
    decision = method_of().step([], None, given())
    assert decision.status == "clear"
    assert abs(decision.speed) <= 0.1 + 1e-12
    assert abs(decision.turn) <= 2.0 / 0.19 * 0.05 + 1e-12


def test_an_open_floor_is_crossed_at_speed():
    """4 m at 2 m/s and 2 m/s² from standing take 2.5 s, and to stop there 3 s."""
    driven = drive_to(method_of(samples=2000), line(4.0, 0.0), 8.0, near=0.3)
    assert 2.3 < 0.05 * len(driven) < 5.5
    assert np.abs(driven[:, 1]).max() < 0.2


def test_mirrored_scenes_have_mirrored_answers():
    left, right = method_of(), method_of()
    for k in range(8):
        path, time = line(6.0, 0.5), 0.05 * k
        first = left.step([laser(POSTS)], None, given(path, (0.5, 0.2), time))
        flipped = laser([(x, -y) for x, y in POSTS])
        second = right.step([flipped], None, given(path * (1.0, -1.0), (0.5, -0.2), time))
        assert first.speed == pytest.approx(second.speed, abs=1e-6)
        assert first.turn == pytest.approx(-second.turn, abs=1e-6)


def test_the_same_seed_gives_the_same_commands_and_another_does_not():
    def commands(seed):
        method = method_of(seed=seed)
        return [method.step([laser(POSTS)], None, given(time=0.05 * k))[:2] for k in range(5)]

    assert commands(1) == commands(1)
    assert commands(1) != commands(2)


def test_a_goal_behind_the_end_of_a_wall_is_driven_to_around_it():
    """The way is 3.4 m, within `goal_within`; straight, the goal is 1.4 m away, and a wall of posts is in between."""
    corners = [(0.0, 0.0), (1.3, 0.3), (1.3, 1.1), (0.0, 1.4)]
    path = np.vstack([np.linspace(a, b, 30) for a, b in pairwise(corners)])
    wall = [(x, 0.7) for x in np.arange(-2.0, 0.61, 0.15)]
    driven = drive_to(method_of(goal_within=4.0), path, 15.0, wall, near=0.2)
    assert math.hypot(driven[-1, 0], driven[-1, 1] - 1.4) < 0.2


@pytest.mark.parametrize(
    ("change", "left", "is_near"), [(45.0, 2.0, False), (45.0, 0.4, True), (180.0, 2.0, True), (math.inf, 2.0, True)]
)
def test_a_robot_that_turns_slowly_heads_for_the_goal_only_when_it_faces_it(change, left, is_near):
    """A goal 30° to the left: in 1.4 - 0.5 s, 45°/s² turn it by 18°, 180°/s² by 32°. Its nose is at 0.54 m."""
    body = np.array([[0.45, 0.3], [-0.45, 0.3], [-0.45, -0.3], [0.45, -0.3]])
    limits = {"motor_lag": 0.3, "dead_time": 0.2, "max_angular_acceleration": math.radians(change)}
    method = method_of(robot=Robot(body, 1.5, math.radians(40.0), 0.4, 0.5, **limits))
    method.step([], None, given(line(left * math.cos(math.pi / 6), left * math.sin(math.pi / 6))))
    assert method.scene.is_near_goal is is_near


def test_no_command_is_given_from_which_the_robot_cannot_stop():
    """An echo 2 cm beyond the margin of the front at 1 m/s: it brakes on the arc that it drives."""
    method = method_of()
    method.motors.give(1.0, 0.0)
    for _ in range(3):
        method.motors.in_flight((1.0, 0.0), 1.0)
    decision = method.step([laser([(0.4, 0.0)])], None, given(twist=(1.0, 0.0)))
    assert decision.speed == 0.0
    assert decision.why == "no roll-out is free: braking"


def test_the_plan_passes_an_obstacle_that_roll_outs_pass_on_both_sides():
    """Without the best roll-out in place of the mean, the mean of both sides would lead into the post."""
    method = method_of(samples=2000)
    for k in range(20):
        method.step([laser([(1.6, 0.0)])], None, given(twist=(1.0, 0.0), time=0.05 * k))
        assert method.part[COLLISION] == 0.0


def test_a_path_around_an_obstacle_is_driven_without_contact():
    """Posts of 0.1 m; the corners of the robot are 0.31 m from its base, its sides 0.208 m."""
    driven = drive_to(method_of(), line(5.0, 0.0), 12.0, POSTS)
    assert math.hypot(driven[-1, 0] - 5.0, driven[-1, 1]) < 0.1
    gaps = [np.hypot(driven[:, 0] - x, driven[:, 1] - y).min() - 0.1 for x, y in POSTS]
    assert min(gaps) > 0.208


@pytest.mark.parametrize("bearing", [0.0, 1.7, 2.6, -3.1])
@pytest.mark.parametrize("fastest", [0.3, 2.0])
def test_slow_and_fast_robots_reach_a_target_in_any_direction(bearing, fastest):
    """3 m take 10 s at 0.3 m/s, and half a turn about 3 s."""
    footprint = np.array([[0.25, 0.2], [-0.25, 0.2], [-0.25, -0.2], [0.25, -0.2]])
    robot = Robot(footprint, fastest, 1.5, 1.0, 1.0, half_track=0.2)
    driven = drive_to(method_of(robot=robot), line(3.0 * math.cos(bearing), 3.0 * math.sin(bearing)), 25.0, near=0.2)
    assert math.hypot(driven[-1, 0] - 3.0 * math.cos(bearing), driven[-1, 1] - 3.0 * math.sin(bearing)) < 0.2


def test_an_ackermann_robot_reaches_a_target_behind_it_within_its_radius():
    """Radius 0.8 m: |turn rate| is at most speed / 0.8."""
    method = method_of(turning_radius=0.8, samples=2000)
    driven = drive_to(method, line(-3.0, 0.5), 30.0, near=0.3)
    assert math.hypot(driven[-1, 0] + 3.0, driven[-1, 1] - 0.5) < 0.3
    assert (np.abs(driven[:, 4]) <= np.abs(driven[:, 3]) / 0.8 + 1e-9).all()


def test_at_the_end_it_turns_to_the_heading_that_is_wanted():
    driven = drive_to(method_of(), np.zeros((1, 2)), 6.0, turn_to=2.0)
    assert driven[-1, 2] == pytest.approx(2.0, abs=0.05)
    assert np.hypot(driven[:, 0], driven[:, 1]).max() < 0.15


def test_walled_in_it_is_trapped_after_its_patience():
    """Echoes 2 cm from the corners all round: nothing is free for 1.5 s, 31 ticks."""
    method, ring = method_of(), [(0.42 * math.cos(a), 0.42 * math.sin(a)) for a in np.linspace(-3.0, 3.0, 60)]
    answers = [method.step([laser(ring)], None, given(time=0.05 * k)) for k in range(45)]
    assert answers[-1].status == "trapped"
    assert {(a.speed, a.turn) for a in answers[-5:]} == {(0.0, 0.0)}


def test_a_robot_that_the_gate_does_not_let_back_up_drives_back_no_more():
    method = method_of()
    method._sent = (-0.2, 0.0)
    for k in range(5):
        method.step([laser([(0.45, 0.0)])], None, given(time=0.05 * k, share=0.0))
        assert method.plan[:, 0].min() >= 0.0


def test_reset_forgets_plan_and_obstacles():
    method = method_of()
    method.step([laser(POSTS)], None, given())
    method.reset()
    assert (method.plan == 0.0).all()
    method.step([], None, given())
    assert len(method.scene.obstacles) == 0


def test_weights_are_per_what_the_robot_can_do():
    """56 steps of 0.05 s at 2 m/s are 5.6 m: 28 / 5.6 = 5 per metre; at 0.5 m/s 20."""
    weights = {}
    for fastest in (2.0, 0.5):
        found = weights_by_critic(MppiParams(), Robot(np.eye(2), fastest, 3.0, 1.0, 1.0))
        weights[fastest] = dict(zip(CRITICS, found.tolist(), strict=True))
    assert weights[2.0]["path_follow"] == pytest.approx(5.0)
    assert weights[0.5]["path_follow"] == pytest.approx(20.0)
    assert weights[2.0]["twirling"] == pytest.approx(0.2)
    assert weights[2.0]["control"] == 0.015


def test_the_reason_names_roll_outs_and_the_dearest_critics():
    why = method_of().step([], None, given()).why
    assert "600 roll-outs, 0% collide" in why
    assert "path follow" in why
