"""Weights, mean, warm start and smoothing against numbers worked by hand."""

import math

import numpy as np
import pytest
from navloom_mppi.weighting import bounded, effective, mean_of, proposal, shifted, smooth, weights_of


def test_a_roll_out_that_costs_lambda_ln_2_more_weighs_half():
    costs = 7.0 + 0.3 * np.log([1.0, 2.0, 4.0])
    np.testing.assert_allclose(weights_of(costs, 0.3), [4.0 / 7.0, 2.0 / 7.0, 1.0 / 7.0])


def test_large_costs_do_not_overflow():
    np.testing.assert_array_equal(weights_of(np.array([1.0e6, 2.0e6]), 0.3), [1.0, 0.0])


def test_equal_weights_count_fully_and_a_single_one_once():
    assert effective(np.full(4, 0.25)) == pytest.approx(4.0)
    assert effective(np.array([1.0, 0.0, 0.0])) == 1.0


NOISE = np.array([[[1.0, 1.0], [2.0, 0.0], [0.0, 0.0]], [[-1.0, 0.5], [0.0, 0.5], [0.0, 0.0]]], np.float32)


def test_the_mean_takes_the_opposite_turn_of_the_second_of_a_pair():
    """Weights 1/2, 1/4, 1/4, 0: speed 0.75·1 - 0.25 = 0.5 σ, then 1.5; turn 0.25·1 + 0.25·0.5 = 0.375 σ, then 0.125."""
    plan, weights = np.zeros((2, 2)), np.array([0.5, 0.25, 0.25, 0.0])
    mean = mean_of(plan, weights, NOISE, np.ones(2), (0.2, 0.8), 1)
    np.testing.assert_allclose(mean, [[0.1, 0.3], [0.3, 0.1]])


def test_equal_weights_of_pairs_cancel_the_turn():
    mean = mean_of(np.zeros((1, 2)), np.full(4, 0.25), NOISE, np.ones(2), (1.0, 1.0), 1)
    assert mean[0, 1] == 0.0


def test_roll_outs_from_standing_add_nothing_of_the_plan():
    """Three quarters of the weight on pace 1: 0.75 of the plan."""
    weights, paces = np.array([0.5, 0.25, 0.25, 0.0]), np.array([1.0, 0.0])
    mean = mean_of(np.ones((2, 2)), weights, np.zeros((2, 3, 2), np.float32), paces, (1.0, 1.0), 1)
    np.testing.assert_allclose(mean, np.full((2, 2), 0.75))


def test_the_plan_moves_on_by_half_a_step():
    plan = np.array([[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]])
    np.testing.assert_allclose(shifted(plan, 0.05, 0.1), [[0.5, 1.5], [1.5, 2.5], [2.0, 3.0]])


def test_smoothing_keeps_a_line_and_spreads_a_peak():
    """Savitzky & Golay 1964: the middle weight of nine points is 59 / 231, the next 54 / 231."""
    line = np.column_stack([np.arange(4.0, 24.0), np.zeros(20)])
    past = np.column_stack([np.arange(4.0), np.zeros(4)])
    np.testing.assert_allclose(smooth(line, past)[:16], line[:16], atol=1e-12)
    peak = np.zeros((20, 2))
    peak[10, 0] = 1.0
    assert smooth(peak, np.zeros((4, 2)))[9:12, 0] == pytest.approx([54.0 / 231.0, 59.0 / 231.0, 54.0 / 231.0])


def test_a_plan_is_bounded():
    plan = np.array([[3.0, -4.0], [-1.0, 0.5]])
    np.testing.assert_array_equal(bounded(plan, -0.3, 2.0, 1.0), [[2.0, -1.0], [-0.3, 0.5]])


def test_the_noise_of_a_seed_repeats_and_has_its_scales():
    """Of four pairs in turn two are wide, one half, one a quarter; the last starts from standing."""
    noise, paces = proposal(np.random.default_rng(3), 8000, 9)
    again, _ = proposal(np.random.default_rng(3), 8000, 9)
    np.testing.assert_array_equal(noise, again)
    assert noise.shape == (4000, 9, 2)
    assert [float(noise[k::16].std()) for k in (0, 1, 2, 11)] == pytest.approx([1.0, 0.5, 0.25, 1.0], rel=0.05)
    assert paces[:5].tolist() == [1.0, 1.0, 1.0, 0.0, 1.0]
    assert (noise[3::16, :, 1] == 0.0).all()
    assert (noise[7::16, :, 0] == 0.0).all()
    assert abs(float(noise.mean())) < 3.0 / math.sqrt(noise.size)
