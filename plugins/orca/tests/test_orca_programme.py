"""The linear programmes against hand-worked corners and an exact solver."""

import math

import numpy as np
import pytest
from navloom_orca.programme import best_velocity, violation
from orca_scenes import FASTEST, crowd_of, exact_least, exact_nearest, planes_of

BELOW = (0.0, 0.5, -1.0, 0.0)
"""y <= 0.5."""
LEFT = (0.3, 0.0, 0.0, 1.0)
"""x <= 0.3."""


def best(*planes, wanted=(1.0, 0.0), fastest=FASTEST, firm=0, hard=0):
    rows = np.array(planes, dtype=float).reshape(-1, 4)
    return best_velocity(rows, len(rows), firm, hard, fastest, *wanted, np.zeros_like(rows))


def test_without_half_planes_the_wanted_velocity_is_taken():
    assert best() == (1.0, 0.0)


def test_the_highest_speed_scales_it():
    assert best(wanted=(3.0, 4.0), fastest=1.0) == pytest.approx((0.6, 0.8))


def test_one_half_plane_is_met_by_the_projection():
    assert best(BELOW, wanted=(1.0, 1.0)) == pytest.approx((1.0, 0.5))


def test_two_half_planes_are_met_in_their_corner():
    assert best(BELOW, LEFT, wanted=(1.0, 1.0)) == pytest.approx((0.3, 0.5))


def test_a_half_plane_and_the_highest_speed_are_met_on_the_circle():
    """Slowed to 1 m/s, (3, 4) is (0.6, 0.8); of y <= 0.5, the circle's point is the nearest to (3, 4)."""
    assert best(BELOW, wanted=(3.0, 4.0), fastest=1.0) == pytest.approx((math.sqrt(0.75), 0.5))


def test_three_that_contradict_each_other_are_violated_alike():
    """x >= 1, y >= 1 and x + y <= 0: (t, t) violates the first two by 1 - t, the last by sqrt(2) t."""
    t = 1.0 / (1.0 + math.sqrt(2.0))
    half = math.sqrt(0.5)
    found = best((1.0, 0.0, 0.0, -1.0), (0.0, 1.0, 1.0, 0.0), (0.0, 0.0, -half, half))
    assert found == pytest.approx((t, t))


def test_an_obstacle_is_kept_where_agents_contradict_it():
    """x >= 1 of an agent, x <= 0.3 of an obstacle."""
    assert best(LEFT, (1.0, 0.0, 0.0, -1.0), hard=1)[0] == pytest.approx(0.3)


def test_obstacles_that_contradict_each_other_do_not_hide_agents():
    """Obstacles demand x <= -1 and x >= 1, so x is 0; an agent demands y >= 0.7."""
    found = best((-1.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, -1.0), (0.0, 0.7, 1.0, 0.0), hard=2)
    assert found == pytest.approx((0.0, 0.7), abs=1e-8)


def test_limits_are_kept_where_obstacles_contradict_them():
    """The robot reaches x <= 0.3 at most; the obstacle demands x >= 1."""
    assert best(LEFT, (1.0, 0.0, 0.0, -1.0), firm=1, hard=2)[0] == pytest.approx(0.3, abs=1e-8)


def errors_of(scenes, most):
    """Largest deviation from the exact solver, m/s, of feasible and infeasible programmes, and how many there were.

    At most `most` agents of a scene are looked at.
    """
    nearest, least = [0.0], [0.0]
    for seed in scenes:
        rng = np.random.default_rng([seed, 1])
        crowd = crowd_of(rng, int(rng.integers(2, 51)), rng.uniform(3.0, 10.0), None)
        for i in range(min(most, len(crowd[0]))):
            planes, wanted = planes_of(crowd, i), tuple(crowd[3][i])
            found = np.array(best_velocity(planes, len(planes), 0, 0, FASTEST, *wanted, np.zeros_like(planes)))
            exact = exact_nearest(planes, FASTEST, wanted)
            if exact is not None:
                nearest.append(float(np.hypot(*(found - exact))))
                continue
            exact, amount = exact_least(planes, FASTEST)
            reached = max(violation(planes, k, *found) for k in range(len(planes)))
            least.append(max(float(np.hypot(*(found - exact))), abs(float(reached - amount))))
    return max(nearest), max(least), len(nearest) - 1, len(least) - 1


def test_it_is_exact_on_100_crowds():
    nearest, least, feasible, infeasible = errors_of(range(100), 3)
    assert max(nearest, least) < 1.0e-9
    assert min(feasible, infeasible) > 20


@pytest.mark.slow
def test_it_is_exact_on_1000_crowds():
    nearest, least, feasible, infeasible = errors_of(range(1000), 50)
    print(f"largest error {nearest:.1e} m/s of {feasible} feasible, {least:.1e} m/s of {infeasible} infeasible")
    assert max(nearest, least) < 1.0e-9


def test_with_obstacles_it_is_exact():
    """Obstacles that permit standing, so that some velocity fits; agents that contradict them and each other."""
    compared, worst = 0, 0.0
    for seed in range(60):
        rng = np.random.default_rng([seed, 2])
        crowd = crowd_of(rng, 14, 1.6, None)
        angles = rng.uniform(-np.pi, np.pi, 3)
        normals = np.column_stack([np.cos(angles), np.sin(angles)])
        walls = np.column_stack([rng.uniform(0.05, 0.5, (3, 1)) * normals, -normals[:, 1], normals[:, 0]])
        planes = np.vstack([walls, planes_of(crowd, 0)])
        if exact_nearest(planes, FASTEST, crowd[3][0]) is None:
            found = best_velocity(planes, len(planes), 0, 3, FASTEST, *crowd[3][0], np.zeros_like(planes))
            exact, _ = exact_least(planes, FASTEST, 3)
            compared, worst = compared + 1, max(worst, float(np.hypot(*(np.array(found) - exact))))
    assert compared > 20
    assert worst < 1.0e-9
