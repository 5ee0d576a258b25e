"""The filter: prediction, correction, and scans with little information."""

import math

import numpy as np
import pytest
from navloom_scan_localizer.ambiguity import Ambiguity
from navloom_scan_localizer.smoothing import SmoothPose
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
    # 0.05² + 20 * 0.02² + (0.02 * 20)² = 0.1705 m²: 0.41 m.
    assert math.sqrt(tracker.covariance[0, 0]) == pytest.approx(0.413, abs=0.01)
    assert math.sqrt(tracker.covariance[1, 1]) < 0.01


def test_a_niche_gives_the_place_along_the_corridor_back():
    occupied = corridor(doors=(380, 420))
    tracker = tracker_in(occupied, [10.0, 1.3, 0.0])
    true, _ = drive(tracker, occupied, 28.0, scale=1.01)
    assert np.hypot(*(tracker.pose - true)[:2]) < 0.02
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


def test_scans_teach_the_error_of_the_odometers_scale():
    occupied = corridor(doors=range(90, 400, 23))
    tracker = tracker_in(occupied, [10.0, 1.3, 0.0])
    drive(tracker, occupied, 15.0, scale=1.05)
    assert tracker.scale_error == pytest.approx(0.05, abs=0.012)


def test_a_robot_that_is_dragged_by_a_metre_is_followed():
    occupied = corridor(doors=range(90, 400, 23))
    tracker, true = tracker_in(occupied, [10.0, 1.3, 0.0]), np.array([10.0, 1.3, 0.0])
    rng = np.random.default_rng(1)
    for k in range(60):
        true[0] += 0.05 if 20 <= k < 46 else 0.0
        tracker.predict(np.zeros(3), 0.1)
        assert tracker.correct(beams_at(occupied, true, rng))
    assert np.hypot(*(tracker.pose - true)[:2]) < 0.03


def test_a_correction_of_a_drive_is_spread_over_ticks():
    shown, odometry = SmoothPose(np.zeros(3), np.zeros(3)), np.zeros(3)
    xs = []
    for _ in range(5):
        odometry = odometry + (0.025, 0.0, 0.0)
        assert shown.follow(odometry + (0.05, 0.0, 0.0), odometry, 0.05, (0.02, 0.1), at_once=False)
        xs.append(shown.pose[0] - odometry[0])
    assert xs == pytest.approx([0.02, 0.04, 0.05, 0.05, 0.05])


@pytest.mark.parametrize("at_once", [True, False])
def test_a_robot_that_stands_is_corrected_at_once(at_once):
    shown = SmoothPose(np.zeros(3), np.zeros(3))
    assert shown.follow(np.array([0.3, 0.0, 0.0]), np.zeros(3), 0.05, (0.02, 0.1), at_once=at_once)
    assert shown.pose[0] == 0.3 and not shown.behind.any()


@pytest.mark.parametrize(("period", "shown_x"), [(0.05, 0.3), (0.01, 0.0208)])
def test_a_robot_stands_below_2_cm_a_second_whatever_the_rate_of_the_odometry(period, shown_x):
    # 0.8 mm in 50 ms are 1.6 cm/s, in 10 ms 8 cm/s.
    shown = SmoothPose(np.zeros(3), np.zeros(3))
    shown.follow(np.array([0.3, 0.0, 0.0]), np.array([0.0008, 0.0, 0.0]), period, (0.02, 0.1), at_once=False)
    assert shown.pose[0] == pytest.approx(shown_x)


def test_the_same_odometry_again_is_no_stop():
    shown, driven = SmoothPose(np.zeros(3), np.zeros(3)), np.array([0.05, 0.0, 0.0])
    shown.follow(driven, driven, 0.1, (0.02, 0.1), at_once=False)
    shown.follow(driven + (0.3, 0.0, 0.0), driven, 0.0, (0.02, 0.1), at_once=False)
    assert shown.pose[0] == pytest.approx(0.07)


def test_a_correction_by_a_metre_is_not_spread():
    shown = SmoothPose(np.zeros(3), np.zeros(3))
    assert not shown.follow(np.array([1.0, 0.0, 0.0]), np.array([0.02, 0.0, 0.0]), 0.05, (0.02, 0.1), at_once=False)
    assert shown.pose[0] == 1.0


def aisle(period):
    """A corridor whose niches repeat from end to end."""
    return corridor(doors=range(0, 580, period))


def spread_of(occupied, start, true):
    """Standard deviations of x, m, and the error in x, of a robot that stands and believes that it is at the start."""
    tracker, rng = tracker_in(occupied, start), np.random.default_rng(1)
    ambiguity = Ambiguity(tracker)
    for _ in range(10):
        tracker.predict(np.zeros(3), 0.1)
        beams = beams_at(occupied, true, rng)
        tracker.correct(beams)
        ambiguity.look(beams)
    return math.sqrt((tracker.covariance + ambiguity.spread)[0, 0]), abs(tracker.pose[0] - true[0])


@pytest.mark.parametrize("off", [-0.7, 0.0, 0.35, 0.7])
def test_in_an_aisle_of_equal_niches_the_covariance_spans_the_neighbours(off):
    # Niches of 1 m every 1.2 m: scans fit at every 1.2 m.
    sigma, error = spread_of(aisle(12), [20.0 + off, 1.3, 0.0], [20.0, 1.3, 0.0])
    assert error < 3.0 * sigma and sigma > 0.05


@pytest.mark.parametrize("off", [-0.7, -0.3, 0.0, 0.3, 0.7])
def test_in_a_bare_corridor_the_covariance_spans_what_is_searched(off):
    sigma, error = spread_of(corridor(), [30.0 + off, 1.3, 0.0], [30.0, 1.3, 0.0])
    assert error < 3.0 * sigma and 0.3 < sigma < 0.45  # half of 0.7 m, and the start's 0.05 m


def test_in_a_room_the_covariance_is_that_of_the_fit():
    sigma, error = spread_of(room(), [3.0, 2.5, 0.3], [3.0, 2.5, 0.3])
    assert error < 0.01 and sigma < 0.015


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
