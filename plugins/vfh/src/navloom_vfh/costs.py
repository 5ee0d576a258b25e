"""Cost of a candidate direction: Ulrich & Borenstein 1998 (VFH+) and 2000 (VFH*).

Differences of directions are in rad; the papers count sectors. The common factor changes no choice.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Weights = tuple[float, float, float]


@njit(cache=True, nogil=True)
def difference(a: float, b: float) -> float:
    """Delta(c1, c2): the smaller angle between two directions, rad in [0, pi]."""
    return abs((a - b + math.pi) % (2.0 * math.pi) - math.pi)


@njit(cache=True, nogil=True)
def primary_cost(c: float, target: float, heading: float, previous: float, weights: Weights) -> float:
    """VFH+: g(c) = mu_1 Delta(c, k_t) + mu_2 Delta(c, theta) + mu_3 Delta(c, k_d,n-1).

    Args:
        c: Candidate. target: k_t. heading: theta. previous: Direction chosen last; all rad in one frame.
        weights: mu_1, mu_2, mu_3; with mu_1 > mu_2 + mu_3 the target counts most.
    """
    return (
        weights[0] * difference(c, target) + weights[1] * difference(c, heading) + weights[2] * difference(c, previous)
    )


@njit(cache=True, nogil=True)
def projected_cost(
    c: float,
    effective: float,
    target: float,
    heading: float,
    previous: float,
    weights: Weights,
    discount: float,
    depth: int,
) -> float:
    """VFH*: g(c_i) = lambda^i (mu_1' D_t + mu_2' Delta(c_i, theta_i) + mu_3' Delta(c_i, c_i-1)).

    D_t = max(Delta(c_i, k_t), Delta(k_e, k_t)).

    Args:
        c: Candidate c_i at the projected place. effective: k_e, direction in which the step towards c_i actually leads.
        target, heading: k_t and theta_i at the projected place. previous: c_i-1. All rad in one frame.
        weights: mu_1', mu_2', mu_3'. discount: lambda, 0..1. depth: i, 0 for the primary candidates.
    """
    most = max(difference(c, target), difference(effective, target))
    turned = weights[1] * difference(c, heading) + weights[2] * difference(c, previous)
    return discount**depth * (weights[0] * most + turned)


@njit(cache=True, nogil=True)
def remaining_cost(
    target: float, heading: float, previous: float, weights: Weights, discount: float, depth: int
) -> float:
    """VFH*: h, the cost of the next step if the target direction itself were a candidate there.

    h = lambda^i (mu_2' Delta(k_t, theta_i) + mu_3' Delta(k_t, c_i-1)), where i is the next step. With
    mu_1' >= mu_2' + mu_3' no candidate costs less (triangle inequality), so A* finds the cheapest path.

    Args:
        target, heading, previous, weights, discount, depth: As for projected_cost(), for the next step.
    """
    return discount**depth * (weights[1] * difference(target, heading) + weights[2] * difference(target, previous))


@njit(cache=True, nogil=True)
def cheapest(
    directions: NDArray[np.float64], count: int, target: float, heading: float, previous: float, weights: Weights
) -> int:
    """Index of the candidate with the least primary_cost(), the first of equals; -1 where there is none."""
    best, least = -1, np.inf
    for i in range(count):
        cost = primary_cost(directions[i], target, heading, previous, weights)
        if cost < least:
            best, least = i, cost
    return best
