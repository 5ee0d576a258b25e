"""From costs to the next plan: path integral weights, the mean of the noise, warm start, smoothing."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SMOOTHING = np.array([-21.0, 14.0, 39.0, 54.0, 59.0, 54.0, 39.0, 14.0, -21.0]) / 231.0
"""Least squares of a parabola over nine points: Savitzky & Golay 1964."""


@njit(cache=True, nogil=True)
def weights_of(costs: Floats, temperature: float) -> Floats:
    """Weights of roll-outs: w_k = exp(-(S_k - min S) / λ) / η, Williams et al. 2017, eq. (28).

    Args:
        costs: (n,) S, finite. temperature: λ, > 0, unit of the costs.

    Returns:
        (n,), their sum is 1.
    """
    weights: Floats = np.exp((costs.min() - costs) / temperature)
    weights /= weights.sum()
    return weights


@njit(cache=True, nogil=True)
def effective(weights: Floats) -> float:
    """Number of roll-outs that would have the same variance with equal weights: 1 / Σ w² (Kish 1965)."""
    return float(1.0 / (weights * weights).sum())


@njit(cache=True, nogil=True)
def mean_of(
    plan: Floats, weights: Floats, noise: NDArray[np.float32], paces: Floats, sigma: tuple[float, float], hold: int
) -> Floats:
    """Weighted mean of the controls of all roll-outs: u ← Σ w_k (pace_k u + ε_k), with pace 1 u + Σ w_k ε_k.

    Args:
        plan: (steps, 2). weights: (2 n,), their sum is 1. noise, paces, sigma, hold: As for rollout.roll_out().

    Returns:
        (steps, 2).
    """
    pace = 0.0
    knots = noise.shape[1]
    mean = np.zeros((knots, 2))
    for i in range(noise.shape[0]):
        both, difference = weights[2 * i] + weights[2 * i + 1], weights[2 * i] - weights[2 * i + 1]
        pace += both * paces[i]
        for j in range(knots):
            mean[j, 0] += both * noise[i, j, 0]
            mean[j, 1] += difference * noise[i, j, 1]
    found = pace * plan
    for t in range(plan.shape[0]):
        j, part = t // hold, (t % hold) / hold
        for a in range(2):
            found[t, a] += sigma[a] * (mean[j, a] + part * (mean[j + 1, a] - mean[j, a]))
    return found


def shifted(plan: Floats, time: float, step: float) -> Floats:
    """The plan (steps, 2) a time later, s: warm start. Its last command is held."""
    at = np.arange(plan.shape[0]) * step
    return np.column_stack([np.interp(at + time, at, plan[:, a]) for a in range(2)])


def smooth(plan: Floats, past: Floats) -> Floats:
    """The plan after a Savitzky-Golay filter; the past commands and the held last one continue it at its ends.

    Args:
        plan: (steps, 2). past: (4, 2) commands that were sent, oldest first.
    """
    longer = np.concatenate([past, plan, np.repeat(plan[-1:], 4, axis=0)])
    return np.column_stack([np.convolve(longer[:, a], SMOOTHING, "valid") for a in range(2)])


def bounded(plan: Floats, slowest: float, fastest: float, turn: float) -> Floats:
    """The plan within the limits of speed, m/s, and turn rate, rad/s."""
    return np.column_stack([np.clip(plan[:, 0], slowest, fastest), np.clip(plan[:, 1], -turn, turn)])


SCALES, PACES = np.array([1.0, 0.5, 0.25, 1.0]), np.array([1.0, 1.0, 1.0, 0.0])
"""Standard deviation of four pairs of roll-outs in turn, and the plan's share in them: wide, finer, and from standing.

Noise that is right for full speed is too coarse for a narrow passage, and hardly ever brakes a fast plan.
"""
STRAIGHT, IN_PLACE, OF_PAIRS = 3, 7, 16
"""Of 16 pairs, that which drives straight, and that which turns in place, both from standing.

Beside a wall at its margin, only a motion that is exactly straight is free.
"""


def proposal(stream: np.random.Generator, samples: int, knots: int) -> tuple[NDArray[np.float32], Floats]:
    """Noise of a tick, drawn from a stream; each pair of samples shares it.

    Returns:
        (samples / 2, knots, 2) noise in standard deviations, and (samples / 2,) paces, see rollout.roll_out().
    """
    pairs = math.ceil(samples / 2)
    noise = stream.standard_normal((pairs, knots, 2), dtype=np.float32)
    noise *= np.resize(SCALES.astype(np.float32), pairs)[:, None, None]
    noise[STRAIGHT::OF_PAIRS, :, 1] = 0.0
    noise[IN_PLACE::OF_PAIRS, :, 0] = 0.0
    return noise, np.resize(PACES, pairs)


SPEEDS, TURNS = (1.0, 0.67, 0.33, 0.0, -1.0), (0.0, 0.33, 0.67, 1.0)
"""Shares of the highest speeds, forwards or backwards, and of the highest turn rate in evade()."""


def evade(
    noise: NDArray[np.float32], paces: Floats, sigma: tuple[float, float], limits: tuple[float, float, float]
) -> None:
    """Replace the first pairs of a proposal by constant commands over all that the robot can do, from standing.

    Noise around a plan that stands hardly ever leads out of the way of a body that comes. Half of these commands turn
    for the first half of the roll-out only.

    Args:
        noise, paces: From proposal(), changed in place. sigma: Standard deviations of speed, m/s, and turn rate, rad/s.
        limits: Slowest and fastest speed, m/s, and highest turn rate, rad/s.
    """
    slowest, fastest, turn = limits
    k, half = 0, noise.shape[1] // 2
    for share in SPEEDS:
        for turning in TURNS:
            for until in (half, noise.shape[1]):
                if k < len(paces):
                    noise[k, :, 0] = (fastest if share >= 0.0 else -slowest) * share / sigma[0]
                    noise[k, :, 1] = 0.0
                    noise[k, :until, 1] = turn * turning / sigma[1]
                    paces[k] = 0.0
                    k += 1
