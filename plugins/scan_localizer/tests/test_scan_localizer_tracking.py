"""The filter: prediction, correction, and scans with little information."""

import math

import numpy as np
import pytest
from navloom_scan_localizer.tracking import PoseTracker, Settings, predicted_covariance
from navloom_scans.field import distance_field
from navloom_scans.poses import compose, relative
from scan_localizer_rooms import beams_of, fan, ranges_in, room

CELL = 0.1
BEARINGS = fan(181)


def corridor(doors=()):
    """60 m long along x, 2 m wide between walls of one cell; niches begin at the columns given."""
    occupied = np.zeros((26, 600), dtype=np.bool_)
    occupied[[2, 23]] = True
    for column in doors:
        occupied[23, column : column + 10] = False
        occupied[25, column : column + 10] = True
    return occupied


def tracker_in(occupied, place, **settings):
    return PoseTracker(Settings(**settings), distance_field(occupied, CELL, (0.0, 0.0, 0.0), 1.0), np.array(place))


def beams_at(occupied, place, rng=None):
    ranges = ranges_in(occupied, CELL, place, BEARINGS, 10.0)
    return beams_of(ranges if rng is None else ranges + 0.01 * rng.standard_normal(len(ranges)), BEARINGS)


def drive(tracker, occupied, metres, scale=1.0):
    """Drive along x, 2.5 cm in each tick of 0.05 s; odometry measures `scale` of that. Gives the true pose."""
    true, measured, rng = tracker.pose.copy(), 0.0, np.random.default_rng(1)
    jumps = []
    for k in range(round(metres / 0.025)):
        true[0] += 0.025
        measured += 0.025 * scale
        tracker.predict(np.array([measured, 0.0, 0.0]), 0.05)
        before = tracker.pose.copy()
        tracker.correct(beams_at(occupied, true, rng))
        jumps.append(np.hypot(*(tracker.pose - before)[:2]) if k else 0.0)
    return true, max(jumps)


def test_covariance_after_a_metre_along_x():
    s = Settings(way_noise=0.02, turn_per_way=0.03, turn_noise=0.1, rest_noise=0.001, rest_turn_noise=0.002)
    got = predicted_covariance(np.diag([0.0, 0.0, 0.01]), 0.0, np.array([1.0, 0.0, 0.5]), 4.0, s)
    # Along 0.02² + 4 0.001²; across 0.005² + 4e-6 + 1² 0.01; heading 0.01 + 0.03² + 0.5 0.1² + 4 0.002².
    expected = [[4.04e-4, 0.0, 0.0], [0.0, 0.010029, 0.01], [0.0, 0.01, 0.015916]]
    assert got == pytest.approx(np.array(expected), abs=1e-12)


def test_covariance_turns_with_the_heading():
    s, before = Settings(), np.diag([1e-4, 4e-4, 1e-3])
    ahead = predicted_covariance(before, 0.0, np.array([1.0, 0.0, 0.1]), 1.0, s)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    left = predicted_covariance(turn @ before @ turn.T, 0.5 * math.pi, np.array([1.0, 0.0, 0.1]), 1.0, s)
    assert left == pytest.approx(turn @ ahead @ turn.T, abs=1e-15)


def test_relative_undoes_compose():
    a, b = np.array([1.0, 2.0, 3.0]), np.array([-0.5, 0.25, 2.0])
    assert relative(a, compose(a, b)) == pytest.approx(b, abs=1e-12)
    assert compose(a, b)[2] == pytest.approx(5.0 - math.tau)


def test_in_a_bare_corridor_the_place_along_it_is_left_to_odometry():
    occupied = corridor()
    tracker = tracker_in(occupied, [10.0, 1.3, 0.0])
    true, _ = drive(tracker, occupied, 20.0, scale=1.01)
    assert tracker.pose[0] - true[0] == pytest.approx(0.2, abs=0.02)  # 1 % of 20 m, neither more nor less
    assert abs(tracker.pose[1] - true[1]) < 0.01
    # 0.05² + 20 * 0.02² = 0.0105 m²: 0.10 m.
    assert math.sqrt(tracker.covariance[0, 0]) == pytest.approx(0.102, abs=0.01)
    assert math.sqrt(tracker.covariance[1, 1]) < 0.01


def test_a_niche_gives_the_place_along_the_corridor_back_without_a_jump():
    occupied = corridor(doors=(380, 420))
    tracker = tracker_in(occupied, [10.0, 1.3, 0.0])
    true, jump = drive(tracker, occupied, 28.0, scale=1.01)
    assert np.hypot(*(tracker.pose - true)[:2]) < 0.02
    assert jump <= 0.03 + 1e-9
    assert math.sqrt(tracker.covariance[0, 0]) < 0.02


def test_too_few_beams_that_fit_leave_the_prediction():
    occupied = room()
    tracker = tracker_in(occupied, [3.0, 3.0, 0.0])
    covariance = tracker.covariance.copy()
    strange = beams_at(room(40, 40), [1.0, 2.0, 1.0])  # another room: its walls are a metre off
    assert not tracker.correct(strange[:60])
    assert not tracker.correct(beams_at(occupied, [3.0, 3.0, 0.0])[:19])  # they fit, but 20 is the minimum
    assert tracker.pose.tolist() == [3.0, 3.0, 0.0]
    assert np.array_equal(tracker.covariance, covariance)


def test_a_correction_is_limited_and_ends_where_it_should():
    occupied = room()
    tracker = tracker_in(occupied, [3.0, 3.0, 0.0], start_sigma=0.3)
    true = np.array([3.08, 3.0, 0.0])
    beams = beams_at(occupied, true)
    places = [tracker.pose[0]]
    for _ in range(6):
        assert tracker.correct(beams)
        places.append(tracker.pose[0])
    assert places[1] == pytest.approx(3.03, abs=1e-9)
    assert max(np.abs(np.diff(places))) <= 0.03 + 1e-9
    assert tracker.pose == pytest.approx(true, abs=0.005)


def test_the_heading_stays_wrapped():
    occupied = room()
    tracker = tracker_in(occupied, [3.0, 3.0, math.pi - 0.005])
    for _ in range(5):
        tracker.correct(beams_at(occupied, [3.0, 3.0, -math.pi + 0.005]))
    assert tracker.pose[2] == pytest.approx(-math.pi + 0.005, abs=2e-3)


def test_the_covariance_stays_symmetric_and_positive():
    occupied = corridor(doors=(150, 180))
    tracker = tracker_in(occupied, [10.0, 1.3, 0.0])
    drive(tracker, occupied, 5.0)
    assert np.array_equal(tracker.covariance, tracker.covariance.T)
    assert np.linalg.eigvalsh(tracker.covariance).min() > 0.0


@pytest.mark.benchmark
def test_a_fit_of_361_beams_is_no_slower_than_twenty_transforms_of_them_in_numpy(benchmark):
    import timeit

    bearings = fan(361)
    beams = beams_of(ranges_in(room(), CELL, (3.0, 3.0, 0.3), bearings), bearings)
    tracker = tracker_in(room(), [3.02, 3.01, 0.3])
    tracker.correct(beams)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    rivals = min(timeit.repeat(lambda: [np.hypot(*(beams[:, :2] @ turn).T) for _ in range(20)], number=20, repeat=5))
    benchmark.pedantic(lambda: tracker.correct(beams), rounds=100)
    assert benchmark.stats.stats.min < rivals / 20


def test_a_pose_that_is_set_applies_to_the_odometry_of_its_time():
    tracker = tracker_in(corridor(), [5.0, 1.3, 0.0])
    tracker.predict(np.array([2.0, 0.0, 0.0]), 1.0)
    tracker.place(np.array([30.0, 1.0, math.pi / 2]))
    tracker.predict(np.array([3.0, 0.0, 0.0]), 1.0)
    assert tracker.pose == pytest.approx([30.0, 2.0, math.pi / 2])
