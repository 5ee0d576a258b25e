"""How likely a scan is from each particle: a likelihood field with rays along the map.

A beam that ends at a mapped wall speaks for a pose, one that ends before it says little (people and furniture that the
map lacks), and one that passes through a mapped wall contradicts it. The field alone (Thrun et al. 2005, 6.4) cannot
tell the last two apart.
"""

from __future__ import annotations

import math

import numpy as np
from navloom_scans.field import distance_field
from navloom_scans.sight import is_through
from numba import njit

__all__ = ["log_likelihoods", "moved", "warm_up", "weighed"]

_HIT = 0.5
"""Likelihood of a hit from which a beam counts as one that ends at a wall."""


@njit(cache=True, nogil=True, error_model="numpy")
def moved(particles, noise, step, time, spreads):  # type: ignore[no-untyped-def]
    """Move particles in place by a step of odometry with noise.

    The variances grow in proportion to the way, the turn and the time, so the spread of a drive does not depend on how
    many steps it is split into. Across, the spread is half of that along.

    Args:
        particles: (n, 3) x, y, m, heading, rad.
        noise: (n, 3) standard normal numbers.
        step: (3,) x, y, m, heading, rad, in the base frame before the step.
        time: Duration of the step, s.
        spreads: (5,) along, m/sqrt(m); of the heading, rad/sqrt(m) and rad/sqrt(rad); at rest, m/sqrt(s), rad/sqrt(s).
    """
    way, turned = math.hypot(step[0], step[1]), abs(step[2])
    rest = spreads[3] * spreads[3] * time
    along = math.sqrt(spreads[0] ** 2 * way + rest)
    across = math.sqrt(0.25 * spreads[0] ** 2 * way + rest)
    turn = math.sqrt(spreads[1] ** 2 * way + spreads[2] ** 2 * turned + spreads[4] ** 2 * time)
    dx, dy = (step[0] / way, step[1] / way) if way > 0.0 else (1.0, 0.0)
    for i in range(particles.shape[0]):
        a, b = along * noise[i, 0], across * noise[i, 1]
        error = turn * noise[i, 2]
        # Half of the error of the heading acts during the step.
        heading = particles[i, 2] + 0.5 * error
        c, s = math.cos(heading), math.sin(heading)
        x, y = step[0] + a * dx - b * dy, step[1] + a * dy + b * dx
        particles[i, 0] += c * x - s * y
        particles[i, 1] += s * x + c * y
        heading = particles[i, 2] + step[2] + error
        particles[i, 2] = (heading + math.pi) % math.tau - math.pi


@njit(cache=True, nogil=True, error_model="numpy")
def log_likelihoods(values, frame, particles, beams, echoes, model, found):  # type: ignore[no-untyped-def]
    """Logarithm of the likelihood of a scan from each particle; 0 if every beam ends exactly at a mapped wall.

    Args:
        values, frame: Attributes of a `DistanceField`.
        particles: (n, 3) x, y, m, heading, rad, map frame.
        beams: (m, 4) end point, m, and direction, base frame; first those with an echo.
        echoes: Number of beams with an echo.
        model: (6,) standard deviation of a hit, m; likelihood, relative to a hit, of an echo of something unmapped, of
            an echo through a wall, and of a missing echo through a wall; depth from which it is through, m; number of
            beams that count as one.
        found: (n,) filled.
    """
    inverse, short, through, silent = 0.5 / (model[0] * model[0]), model[1], math.log(model[2]), math.log(model[3])
    rows, columns = values.shape
    fc, fs, spacing = frame[2], frame[3], frame[4]
    for k in range(particles.shape[0]):
        px, py = particles[k, 0], particles[k, 1]
        c, s = math.cos(particles[k, 2]), math.sin(particles[k, 2])
        total = 0.0
        for i in range(beams.shape[0]):
            dx, dy = c * beams[i, 2] - s * beams[i, 3], s * beams[i, 2] + c * beams[i, 3]
            x, y = px + c * beams[i, 0] - s * beams[i, 1], py + s * beams[i, 0] + c * beams[i, 1]
            hit = 0.0
            if i < echoes:
                u = (fc * (x - frame[0]) + fs * (y - frame[1])) / spacing + 0.5
                v = (fc * (y - frame[1]) - fs * (x - frame[0])) / spacing + 0.5
                if 0.0 <= u < columns and 0.0 <= v < rows:
                    distance = values[np.int64(v), np.int64(u)]
                    hit = math.exp(-inverse * distance * distance)
            # Most beams that end at a wall have passed none: every fourth of them shows the rest.
            if hit < _HIT or i % 4 == 0:
                back = max(0.0, beams[i, 0] * beams[i, 2] + beams[i, 1] * beams[i, 3])
                if is_through(values, frame, x, y, dx, dy, back, model[4]):
                    total += through if i < echoes else silent
                    continue
            if i < echoes:
                total += math.log(short + (1.0 - short) * hit)
        found[k] = total / model[5]


@njit(cache=True, nogil=True, error_model="numpy")
def weighed(weights, logs):  # type: ignore[no-untyped-def]
    """Multiply weights (n,), in place, by likelihoods, given as (n,) logarithms, and make their sum 1.

    Returns:
        Logarithm of the mean likelihood; effective number of particles, 1 / sum of the squared weights.
    """
    best = logs.max()
    total, squares = 0.0, 0.0
    for i in range(len(weights)):
        weights[i] *= math.exp(logs[i] - best)
        total += weights[i]
    if not total > 0.0:
        weights[:] = 1.0 / len(weights)
        return best, float(len(weights))
    for i in range(len(weights)):
        weights[i] /= total
        squares += weights[i] * weights[i]
    return best + math.log(total), 1.0 / squares


def warm_up() -> None:
    """Compile the kernels."""
    field = distance_field(np.eye(3, dtype=np.bool_), 0.1, (0.0, 0.0, 0.0), 1.0)
    particles, beams = np.zeros((1, 3)), np.array([[0.1, 0.1, 1.0, 0.0]])
    moved(particles, np.zeros((1, 3)), np.zeros(3), 0.0, np.zeros(5))
    log_likelihoods(field.values, field.frame, particles, beams, 1, np.full(6, 0.5), np.empty(1))
    weighed(np.ones(1), np.zeros(1))
