"""A single fit of beams to a distance field."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_scans.field import distance_field
from navloom_scans.matching import fit_pose, solve
from scan_localizer_rooms import beams_of, fan, ranges_in, room, turned

CELL = 0.1
BEARINGS = fan(181)
OPTIONS = np.array([0.02**2 * 10.0, 0.08, 0.08, 0.16, 0.5])
WEAK = np.linalg.inv(np.diag([0.5**2, 0.5**2, math.radians(20.0) ** 2]))
PLACE = np.array([2.33, 3.17, 0.4])


def furnished():
    """A room of 6 x 6 m with walls of one cell, a post and an oblique wall of steps."""
    occupied = room()
    occupied[20:25, 40:44] = True
    for k in range(15):
        occupied[40 + k // 2, 10 + k] = True
    return occupied


FIELD = distance_field(furnished(), CELL, (0.0, 0.0, 0.0), 1.0)


def fit(beams, predicted, field=FIELD, information=WEAK, iterations=20):
    pose, fused = np.empty(3), np.empty((3, 3))
    options = OPTIONS.copy()
    options[1] = 0.3
    inliers = fit_pose(
        field.values, field.frame, beams, np.asarray(predicted), information, options, iterations, pose, fused
    )
    return pose, fused, inliers


def seen(place=PLACE, occupied=None):
    return beams_of(ranges_in(furnished() if occupied is None else occupied, CELL, place, BEARINGS), BEARINGS)


@pytest.mark.parametrize("direction", range(8))
@pytest.mark.parametrize("turn", [-3.0, 3.0])
def test_an_offset_of_ten_centimetres_and_three_degrees_is_recovered(direction, turn):
    # 0.10 m is the whole thickness of the walls: beams that end behind one still belong to its front.
    angle = math.pi / 4.0 * direction
    offset = np.array([0.1 * math.cos(angle), 0.1 * math.sin(angle), math.radians(turn)])
    pose, _, inliers = fit(seen(), PLACE + offset)
    assert np.hypot(*(pose - PLACE)[:2]) < 0.01
    assert abs(math.degrees(pose[2] - PLACE[2])) < 0.2
    assert inliers > 170


@settings(max_examples=60, deadline=None)
@given(st.floats(0.5, 3.5), st.floats(0.5, 3.5), st.floats(-math.pi, math.pi))
def test_a_scan_without_noise_leaves_the_true_pose_where_it_is(x, y, heading):
    pose, _, _ = fit(seen(np.array([x, y, heading])), [x, y, heading])
    assert np.abs(pose - [x, y, heading])[:2].max() < 0.005
    assert abs(math.degrees(pose[2] - heading)) < 0.1


def test_noise_of_one_centimetre_leaves_a_few_millimetres():
    rng = np.random.default_rng(3)
    ranges = ranges_in(furnished(), CELL, PLACE, BEARINGS)
    poses = [fit(beams_of(ranges + 0.01 * rng.standard_normal(181), BEARINGS), PLACE)[0] - PLACE for _ in range(50)]
    assert np.abs(np.mean(poses, axis=0))[:2].max() < 0.002  # no bias
    assert np.std(poses, axis=0)[:2].max() < 0.003  # 1 cm / sqrt(a quarter of the beams a wall) = 1.5 mm


def test_a_box_that_is_not_in_the_map_does_not_move_the_pose():
    crowded = furnished()
    crowded[34:42, 30:38] = True  # 0.8 m wide, 0.7 m from the robot: a third of the field of view
    beams = seen(occupied=crowded)
    clear = seen()
    hidden = np.hypot(*(beams - clear)[:, :2].T) > 0.2
    pose, _, inliers = fit(beams, PLACE + [0.05, -0.05, 0.02])
    assert 30 < hidden.sum() < 90
    assert inliers <= 181 - 0.8 * hidden.sum()
    assert np.hypot(*(pose - PLACE)[:2]) < 0.01
    assert abs(math.degrees(pose[2] - PLACE[2])) < 0.2


@settings(max_examples=25, deadline=None)
@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-math.pi, math.pi))
def test_a_turned_map_turns_the_answer(x, y, heading):
    origin = (x, y, heading)
    start = PLACE + [0.06, 0.04, -0.03]
    plain, _, _ = fit(seen(), start)
    pose, _, _ = fit(seen(), turned(start, origin), distance_field(furnished(), CELL, origin, 1.0))
    expected = turned(plain, origin)
    assert pose[:2] == pytest.approx(expected[:2], abs=1e-3)
    assert math.remainder(pose[2] - expected[2], math.tau) == pytest.approx(0.0, abs=1e-3)


def test_without_beams_the_prediction_is_the_answer():
    pose, fused, inliers = fit(np.empty((0, 4)), PLACE)
    assert inliers == 0
    assert pose == pytest.approx(PLACE, abs=0.0)
    assert fused == pytest.approx(WEAK, abs=0.0)


def test_one_beam_and_the_prediction_are_weighed_by_their_variances():
    # The beam puts the robot 0.06 m further on, with the variance of OPTIONS, 0.004 m². The prediction has 0.002 m²: a
    # third of the way. The scale is so wide that the beam counts in full. Variance 1 / (250 + 500).
    beam = np.array([[5.9 - 3.0 - 0.06, 0.0, 1.0, 0.0]])
    options, pose, fused = OPTIONS.copy(), np.empty(3), np.empty((3, 3))
    options[1:3] = 1e4
    information = np.diag([500.0, 500.0, 1e6])
    field = distance_field(room(), CELL, (0.0, 0.0, 0.0), 1.0)
    fit_pose(field.values, field.frame, beam, np.array([3.0, 3.03, 0.0]), information, options, 5, pose, fused)
    assert pose == pytest.approx([3.02, 3.03, 0.0], abs=1e-6)
    assert np.linalg.inv(fused)[0, 0] == pytest.approx(1.0 / 750.0, rel=1e-5)


def test_in_a_corridor_the_beams_do_not_determine_the_place_along_it():
    corridor = np.zeros((20, 400), dtype=np.bool_)
    corridor[[0, -1]] = True
    field = distance_field(corridor, CELL, (0.0, 0.0, 0.0), 1.0)
    place = np.array([20.0, 1.0, 0.1])
    beams = beams_of(ranges_in(corridor, CELL, place, BEARINGS, 10.0), BEARINGS)
    predicted = place + [0.3, 0.05, 0.02]
    pose, fused, _ = fit(beams, predicted, field)
    assert pose[0] == pytest.approx(predicted[0], abs=1e-3)  # as predicted, wrong or not
    assert pose[1:] == pytest.approx(place[1:], abs=5e-3)
    covariance = np.linalg.inv(fused)
    assert math.sqrt(covariance[0, 0]) == pytest.approx(0.5, rel=1e-3)  # with the same variance as before
    assert math.sqrt(covariance[1, 1]) < 0.02


@given(st.lists(st.floats(-3.0, 3.0), min_size=12, max_size=12))
def test_solve_agrees_with_numpy(numbers):
    half, right, solution = np.reshape(numbers[:9], (3, 3)), np.array(numbers[9:]), np.empty(3)
    matrix = half @ half.T + np.eye(3)
    assert solve(matrix, right, solution)
    assert solution == pytest.approx(np.linalg.solve(matrix, right), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("diagonal", [(-1.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, math.nan)])
def test_solve_refuses_what_is_not_positive_definite(diagonal):
    assert not solve(np.diag(diagonal), np.ones(3), np.empty(3))
