"""Closed-loop campaigns without map or plan: fields of posts, U-traps and doorways. Contact never occurs."""

import math
from collections import Counter

import numpy as np
import pytest
from improved_vfh_arena import (
    BEARINGS,
    HALF_ANGLE,
    PERIOD,
    RANGE_MAX,
    RANGE_MIN,
    Noise,
    World,
    doorway,
    drive,
    post_field,
    rim_origins,
    u_trap,
)
from navloom_avoidance.beams import Beams
from navloom_avoidance.robot import Robot
from navloom_improved_vfh.avoidance import Avoidance
from navloom_improved_vfh.params import PRINTED, ImprovedVfhParams

SQUARE = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
ROBOT = Robot(SQUARE, 0.5, math.radians(25.0), 0.5, 1.0)
LIMITS = np.tile([RANGE_MIN, RANGE_MAX], (8, 1))


def run(world, start, target, rng, params=None, noise=None):
    method = Avoidance(params or ImprovedVfhParams(), ROBOT, PERIOD)
    origins, halves, sensors = rim_origins(), np.full(8, HALF_ANGLE), np.zeros(8, np.int64)

    def step(ranges, pose, speed, goal):
        decision = method.step(Beams(origins, BEARINGS, halves, ranges, LIMITS, sensors), pose, (speed, 0.0), goal)
        return decision.speed, decision.turn, decision.status, decision.why

    return drive(world, start, target, step, rng, noise or Noise())


def cross_field(seed, **options):
    rng = np.random.default_rng(seed)
    world = post_field(rng)
    start = (-1.5, rng.uniform(-2.0, 2.0), rng.uniform(-0.5, 0.5))
    return run(world, start, (13.5, rng.uniform(-2.0, 2.0)), rng, **options)


def pass_door(width, seed):
    """Reached means through the door: the wall is 24 m long and the robot gives up before its end."""
    rng = np.random.default_rng(seed)
    start = (-3.0 + rng.uniform(-0.5, 0.5), rng.uniform(-1.0, 1.0), rng.uniform(-0.6, 0.6))
    return run(doorway(width), start, (3.0, 0.0), rng)


def pass_turned_door(width, seed):
    """The wall turned about the origin by any angle, start and target with it."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(-math.pi, math.pi)
    c, s = math.cos(turn), math.sin(turn)
    world = doorway(width)
    world.boxes[:, :2] = world.boxes[:, :2] @ np.array([[c, s], [-s, c]])
    world.boxes[:, 4] = turn
    x, y = -3.0 + rng.uniform(-0.5, 0.5), rng.uniform(-1.0, 1.0)
    heading = (turn + rng.uniform(-0.6, 0.6) + math.pi) % (2.0 * math.pi) - math.pi
    return run(world, (c * x - s * y, s * x + c * y, heading), (3.0 * c, 3.0 * s), rng).outcome


def enter_trap(width, depth, seed):
    rng = np.random.default_rng(seed)
    start = (-depth - 1.5, rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3))
    return run(u_trap(width, depth), start, (3.0, 0.0), rng)


def test_empty_world_is_crossed_straight_at_full_speed():
    """6 m less 0.3 m of tolerance at 0.5 m/s and 0.5 m/s^2: 11.4 s and 0.5 s for the start."""
    episode = run(World(), (0.0, 0.0, 0.0), (6.0, 0.0), np.random.default_rng(0))
    assert episode.outcome == "reached"
    assert episode.time == pytest.approx(11.9, abs=0.15)
    assert np.abs(episode.track[:, 1]).max() < 1e-9


def test_target_behind_is_turned_to_and_reached():
    episode = run(World(), (0.0, 0.0, 0.0), (-3.0, 0.5), np.random.default_rng(0))
    assert episode.outcome == "reached"


def test_post_in_the_way_is_passed_with_room():
    world = World(circles=np.array([[3.0, 0.0, 0.1]]))
    episode = run(world, (0.0, 0.0, 0.0), (6.0, 0.0), np.random.default_rng(3))
    assert episode.outcome == "reached"
    assert episode.least_gap > 0.15


@pytest.mark.parametrize("seed", range(8))
def test_field_of_posts_short(seed):
    assert cross_field(seed).outcome == "reached"


def test_door_of_1_6_m_short():
    assert Counter(pass_door(1.6, seed).outcome for seed in range(6)) == {"reached": 6}


def test_u_trap_is_reported_short():
    assert Counter(enter_trap(3.0, 3.0, seed).outcome for seed in range(3)) == {"trapped": 3}


def test_same_seed_gives_the_same_track():
    np.testing.assert_array_equal(cross_field(11).track, cross_field(11).track)


@pytest.mark.slow
def test_as_printed_most_fields_of_posts_are_crossed():
    printed = ImprovedVfhParams(**PRINTED.values())
    assert Counter(cross_field(seed, params=printed).outcome for seed in range(20))["reached"] >= 14


@pytest.mark.slow
def test_fields_of_posts():
    episodes = [cross_field(seed) for seed in range(50)]
    outcomes = Counter(e.outcome for e in episodes)
    print(f"\nfields: {dict(outcomes)}, least gap {min(e.least_gap for e in episodes):.3f} m")
    assert set(outcomes) <= {"reached", "trapped"}
    assert outcomes["reached"] >= 45


@pytest.mark.slow
def test_fields_of_posts_with_bad_sonars():
    noise = Noise(base=0.03, share=0.01, dropout=0.1)
    outcomes = Counter(cross_field(seed, noise=noise).outcome for seed in range(50))
    print(f"\nfields, sigma 3 cm and more, 10 % of echoes lost: {dict(outcomes)}")
    assert set(outcomes) <= {"reached", "trapped"}
    assert outcomes["reached"] >= 45


@pytest.mark.slow
@pytest.mark.parametrize(("width", "depth"), [(1.6, 2.0), (2.0, 1.5), (2.4, 2.0), (3.0, 3.0), (4.0, 3.0), (5.0, 4.0)])
def test_u_traps(width, depth):
    """A small U may be left and passed outside; none is touched."""
    episodes = [enter_trap(width, depth, seed) for seed in range(20)]
    outcomes = Counter(e.outcome for e in episodes)
    print(f"\nU {width} x {depth} m: {dict(outcomes)}, least gap {min(e.least_gap for e in episodes):.3f} m")
    assert set(outcomes) <= {"reached", "trapped"}
    assert outcomes["trapped"] >= 10


@pytest.mark.slow
@pytest.mark.parametrize("width", [round(1.0 + 0.1 * k, 1) for k in range(15)])
def test_doorways(width):
    episodes = [pass_door(width, seed) for seed in range(20)]
    outcomes = Counter(e.outcome for e in episodes)
    print(f"\ndoor {width} m: {dict(outcomes)}, least gap {min(e.least_gap for e in episodes):.3f} m")
    assert set(outcomes) <= {"reached", "trapped"}
    if width >= 1.6:
        assert outcomes["reached"] == 20


@pytest.mark.slow
@pytest.mark.parametrize("width", [1.6, 1.8])
def test_doorways_in_any_direction(width):
    """The cells lie along the axes of the pose frame; doors need not."""
    outcomes = Counter(pass_turned_door(width, seed) for seed in range(100))
    print(f"\nturned door {width} m: {dict(outcomes)}")
    assert outcomes == {"reached": 100}
