"""A step of a crowd: against RVO2 in 32 bits, pairs that never touch, mirrored scenes, and whom an agent sees."""

import math

import numpy as np
import pytest
from navloom_orca.crowd import Reaction, react
from navloom_orca.half_planes import put_agent
from navloom_orca.neighbours import fill_cells, insert
from navloom_orca.programme import violation
from orca_scenes import crowd_of

ALL = Reaction(horizon=5.0, reach=10.0, most=10)


def everybody(count):
    return np.ones((count, count), dtype=bool)


def by_rvo2(crowd, reaction, lines=()):
    """(n, 2) velocities by the reference implementation, m/s."""
    pyrvo = pytest.importorskip("pyrvo", reason="pyrvo is not installed")
    positions, velocities, radii, preferred, fastest = crowd
    peer = pyrvo.RVOSimulator()
    peer.set_time_step(reaction.period)
    for line in lines:
        peer.add_obstacle([tuple(line[:2]), tuple(line[2:])])
    if len(lines):
        peer.process_obstacles()
    for i in range(len(positions)):
        peer.add_agent(
            tuple(positions[i]), reaction.reach, reaction.most, reaction.horizon, reaction.line_horizon, radii[i],
            fastest[i], tuple(velocities[i]),
        )  # fmt: skip
        peer.set_agent_pref_velocity(i, tuple(preferred[i]))
    peer.do_step()
    found = [peer.get_agent_velocity(i) for i in range(len(positions))]
    return np.array([[v.x, v.y] for v in found])


def worst_violation(crowd, i, velocity, reaction):
    """Greatest violation by a velocity of agent i, m/s, of the half planes of all within reach."""
    positions, velocities, radii = crowd[:3]
    planes, worst = np.zeros((1, 4)), 0.0
    order = np.argsort(np.hypot(*(positions - positions[i]).T), kind="stable")[1 : reaction.most + 1]
    for j in order:
        place = positions[j] - positions[i]
        if np.hypot(*place) < reaction.reach:
            speed = velocities[i] - velocities[j]
            put_agent(
                planes, 0, tuple(place), tuple(velocities[i]), tuple(speed), radii[i] + radii[j], reaction.horizon,
                reaction.period, 0.5,
            )  # fmt: skip
            worst = max(worst, violation(planes, 0, *velocity))
    return worst


def test_it_agrees_with_rvo2_and_elsewhere_is_nearer_to_the_optimum():
    """RVO2 computes in 32 bits. Where both differ, ours violates the half planes less, or is nearer to the wanted."""
    agents, differ = 0, 0
    for seed in range(300):
        rng = np.random.default_rng([seed, 3])
        crowd = crowd_of(rng, int(rng.integers(2, 51)), rng.uniform(6.0, 12.0))
        ours, theirs = react(*crowd, everybody(len(crowd[0])), reaction=ALL), by_rvo2(crowd, ALL)
        error = np.hypot(*(ours - theirs).T)
        agents += len(error)
        for i in np.flatnonzero(error > 1.0e-4):
            differ += 1
            mine, other = (worst_violation(crowd, i, v[i], ALL) for v in (ours, theirs))
            nearness = [np.hypot(*(v[i] - crowd[3][i])) for v in (ours, theirs)]
            assert mine < other or (mine < 1.0e-6 and nearness[0] < nearness[1])
    assert agents > 5000
    assert differ <= 1.0e-3 * agents


def test_beside_one_line_obstacle_it_agrees_with_rvo2():
    """Not beside several: RVO2 splits lines where others cross their extension."""
    errors = []
    for seed in range(100):
        rng = np.random.default_rng([seed, 4])
        crowd = crowd_of(rng, 20, 6.0)
        lines = rng.uniform(-5.0, 5.0, (1, 4)).astype(np.float32).astype(np.float64)
        ours = react(*crowd, everybody(20), lines, ALL)
        errors += np.hypot(*(ours - by_rvo2(crowd, ALL, lines)).T).tolist()
    assert (np.array(errors) > 1.0e-4).mean() <= 1.0e-3


def least_gap(first, second, sees, seconds=20.0):
    """Least gap of two agents, m: each (place, velocity, radius, goal, highest speed)."""
    both = (first, second)
    positions, velocities, radii, goals, fastest = (np.array([one[k] for one in both], float) for k in range(5))
    gap, reaction = math.inf, Reaction(horizon=3.0, period=0.1)
    for _ in range(round(seconds / reaction.period)):
        gap = min(gap, math.dist(*positions) - radii.sum())
        wanted = goals - positions
        wanted *= (fastest / np.maximum(np.hypot(*wanted.T), 1.0e-9)).clip(max=1.0 / reaction.period)[:, None]
        velocities = react(positions, velocities, radii, wanted, fastest, sees, reaction=reaction)
        positions = positions + reaction.period * velocities
    return gap, np.hypot(*(positions - goals).T).max()


def random_pair(rng):
    angle, aside = rng.uniform(-np.pi, np.pi), rng.uniform(-0.5, 0.5)
    place = 3.0 * np.array([math.cos(angle), math.sin(angle)])
    pair = []
    for start, goal in (((-3.0, 0.0), (3.0, aside)), (place, -place)):
        pair.append((np.array(start), np.zeros(2), rng.uniform(0.2, 0.5), np.array(goal), rng.uniform(0.5, 1.5)))
    return pair


def test_pairs_that_see_each_other_never_touch():
    rng, gaps = np.random.default_rng(5), []
    while len(gaps) < 200:
        pair = random_pair(rng)
        if math.dist(pair[0][0], pair[1][0]) > 1.5 and math.dist(pair[0][3], pair[1][3]) > 1.5:
            gaps.append(least_gap(*pair, everybody(2))[0])
    assert min(gaps) > -1.0e-9


def test_a_pair_that_meets_nearly_head_on_passes():
    """1 cm aside. Exactly head-on both stop, as in RVO2: the scene has no side to turn to."""
    first = (np.array([-3.0, 0.01]), np.zeros(2), 0.3, np.array([3.0, 0.01]), 1.0)
    second = (np.array([3.0, 0.0]), np.zeros(2), 0.3, np.array([-3.0, 0.0]), 1.0)
    gap, left = least_gap(first, second, everybody(2))
    assert gap > -1.0e-9
    assert left < 0.01


def circle_swap(seed, count=10, radius=4.0, seconds=40.0):
    """Least gap, m, of agents that swap places on a circle, and how many have not arrived."""
    rng, period = np.random.default_rng(seed), 0.05
    angles = 2.0 * np.pi * np.arange(count) / count
    goals = -radius * np.column_stack([np.cos(angles), np.sin(angles)])
    positions, velocities, gap = rng.normal(0.0, 0.05, (count, 2)) - goals, np.zeros((count, 2)), np.inf
    for _ in range(round(seconds / period)):
        away = goals - positions
        wanted = away / np.maximum(np.hypot(*away.T), 1.0)[:, None] + rng.normal(0.0, 0.02, (count, 2))
        velocities = react(
            positions, velocities, np.full(count, 0.3), wanted, np.full(count, 1.2), everybody(count),
            reaction=Reaction(period=period),
        )  # fmt: skip
        positions = positions + period * velocities
        apart = np.hypot(*np.moveaxis(positions[:, None] - positions[None], -1, 0)) + 10.0 * np.eye(count)
        gap = min(gap, float(apart.min()) - 0.6)
    return gap, int((np.hypot(*(goals - positions).T) > 0.3).sum())


def test_ten_that_swap_places_on_a_circle_overlap_by_less_than_0_2_mm():
    """Where no velocity is permitted, the least violation is chosen: agents may then touch."""
    swaps = [circle_swap(seed) for seed in range(50)]
    assert min(gap for gap, _ in swaps) > -2.0e-4
    assert sum(left == 0 for _, left in swaps) >= 45


def test_one_that_is_not_seen_takes_all_of_the_change():
    """The second sees nobody and drives on straight; the first alone avoids it."""
    first = (np.array([-3.0, 0.1]), np.zeros(2), 0.3, np.array([3.0, 0.1]), 1.0)
    second = (np.array([3.0, 0.0]), np.zeros(2), 0.3, np.array([-3.0, 0.0]), 1.0)
    sees = np.array([[True, True], [False, False]])
    assert least_gap(first, second, sees)[0] > -1.0e-9


def test_one_that_sees_nobody_takes_its_preferred_velocity():
    crowd = crowd_of(np.random.default_rng(6), 10, 2.0, None)
    np.testing.assert_array_equal(react(*crowd, np.zeros((10, 10), bool)), crowd[3])


def test_a_mirrored_crowd_takes_mirrored_velocities():
    crowd = crowd_of(np.random.default_rng(7), 30, 6.0)
    lines = np.array([[1.0, 2.0, 3.0, 4.0], [-2.0, -3.0, -2.0, -3.0]])
    mirror, flip = np.array([1.0, -1.0]), np.array([1.0, -1.0, 1.0, -1.0])
    flipped = [a * mirror if a.ndim == 2 else a for a in crowd]
    ours = react(*crowd, everybody(30), lines)
    np.testing.assert_allclose(react(*flipped, everybody(30), lines * flip), ours * mirror, atol=1e-9)


def test_the_order_of_agents_does_not_matter():
    crowd, order = crowd_of(np.random.default_rng(8), 40, 8.0), np.random.default_rng(9).permutation(40)
    sees = np.random.default_rng(10).random((40, 40)) < 0.5
    ours = react(*crowd, sees)
    again = react(*(a[order] for a in crowd), sees[np.ix_(order, order)])
    np.testing.assert_allclose(again, ours[order], atol=1e-12)


def test_a_wall_between_agent_and_goal_is_not_touched():
    """A robot of radius 0.3 m that wants through a wall 2 m ahead stops 0.3 m before it."""
    place, velocity, wall = np.array([[0.0, 0.1]]), np.zeros((1, 2)), np.array([[2.0, -3.0, 2.0, 3.0]])
    for _ in range(400):
        velocity = react(place, velocity, [0.3], [[1.0, 0.0]], [1.0], everybody(1), wall)
        place = place + 0.05 * velocity
    assert place[0, 0] == pytest.approx(1.7, abs=1e-6)


def test_the_cells_find_the_neighbours_that_a_search_of_all_finds():
    positions = np.random.default_rng(11).uniform(-20.0, 20.0, (80, 2))
    left, low, side, columns, rows, first, order = fill_cells(positions, 5.0)
    assert sorted(order.tolist()) == list(range(80))
    for i, (x, y) in enumerate(positions):
        column, row = int((x - left) / side), int((y - low) / side)
        near = {
            int(j)
            for r in range(max(0, row - 1), min(rows, row + 2))
            for j in order[first[r * columns + max(0, column - 1)] : first[r * columns + min(columns, column + 2)]]
        }
        assert set(np.flatnonzero(np.hypot(*(positions - positions[i]).T) < 5.0).tolist()) <= near


def test_the_list_of_neighbours_keeps_the_nearest():
    others, squares, count = np.zeros(3, np.int64), np.zeros(3), 0
    for other, square in ((4, 9.0), (7, 1.0), (2, 4.0), (1, 4.0), (9, 16.0)):
        count = insert(others, squares, count, other, square)
    assert (count, others.tolist()) == (3, [7, 1, 2])


def test_nobody_is_a_crowd_too():
    assert react(*(np.zeros((0, 2)), np.zeros((0, 2)), [], np.zeros((0, 2)), []), np.zeros((0, 0), bool)).shape == (
        0,
        2,
    )
