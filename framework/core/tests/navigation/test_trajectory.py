"""From path to trajectory: fillets, sampling and speed."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from limits import speed_limits
from navloom.navigation import fillets
from navloom.navigation.trajectory import (
    free_samples,
    keep_corners,
    make_trajectory,
    sample_path,
    speed_profile,
)
from scipy.special import fresnel

LIMITS = speed_limits()
ORIGIN = (0.0, 0.0)
QUARTER = 0.5 * math.pi
TURN_RATE = math.radians(25.0)


def wrap(angle):
    return (np.asarray(angle) + math.pi) % (2.0 * math.pi) - math.pi


def corridor(width=3.0, resolution=0.25, size=10.0):
    """An L: along the bottom edge, then up the right edge; cells `width` wide are free."""
    n, w = round(size / resolution), round(width / resolution)
    cells = np.zeros((n, n), np.bool_)
    cells[:w, :] = cells[:, n - w :] = True
    return cells, resolution


# --- the shape of a fillet -------------------------------------------------------------------------------------------


def test_a_clothoid_ends_where_the_fresnel_integrals_say():
    turn = 1.8
    x, y, heading, bend = fillets.fillet_point(turn, turn, 1.0)
    scale = math.sqrt(math.pi * turn)
    sine, cosine = fresnel(turn / scale)
    assert (x, y) == pytest.approx((scale * cosine, scale * sine), abs=1e-12)
    assert (heading, bend) == pytest.approx((0.9, 1.0))


def test_a_fillet_with_small_clothoids_is_nearly_an_arc():
    reach, aside = fillets.fillet_shape(QUARTER, 1e-6)
    assert reach == pytest.approx(1.0, abs=1e-5), "R tan 45°"
    assert aside == pytest.approx(math.sqrt(2.0) - 1.0, abs=1e-5), "R (1 / cos 45° - 1)"


@pytest.mark.parametrize("share", [1.0, 0.6, 0.3])
def test_a_fillet_turns_by_half_on_each_side(share):
    assert fillets.fillet_point(0.5 * 1.2 * (1.0 + share), 1.2, share)[2] == pytest.approx(0.6)


def test_the_turn_of_a_corner_is_positive_to_the_left():
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]])
    assert [fillets.turn_at(corners, i) for i in range(4)] == pytest.approx([0.0, QUARTER, -QUARTER, 0.0])


# --- whole trajectories -----------------------------------------------------------------------------------------------


def test_a_straight_line():
    made = make_trajectory(np.array([[1.0, 1.0], [1.0, 2.0], [1.0, 3.0]]), LIMITS, spacing=0.05)
    assert made.samples.shape == (41, 6)
    assert made.samples[:, 0] == pytest.approx(np.linspace(0.0, 2.0, 41))
    assert made.samples[:, 1] == pytest.approx(1.0)
    assert made.samples[:, 2] == pytest.approx(np.linspace(1.0, 3.0, 41))
    assert made.samples[:, 3] == pytest.approx(QUARTER)
    assert made.samples[:, 4].tolist() == [0.0] * 41
    assert made.samples[[0, 20, -1], 5] == pytest.approx([0.2, 0.4, 0.2])
    assert len(made.slow_places) == 0


def test_a_right_angle_in_a_wide_corridor_is_taken_at_full_speed():
    cells, resolution = corridor(width=2.5)
    made = make_trajectory(np.array([[0.5, 0.5], [9.5, 0.5], [9.5, 9.5]]), LIMITS, cells, resolution, ORIGIN)
    assert made.radii[1] == pytest.approx(0.4 / TURN_RATE)
    reach, _ = fillets.fillet_shape(QUARTER, 1.0)
    assert made.samples[-1, 0] == pytest.approx(18.0 - 2.0 * made.radii[1] * reach + 2.0 * made.radii[1] * QUARTER)
    assert made.samples[:, 3].min() >= -1e-12
    assert made.samples[-1, 1:4] == pytest.approx([9.5, 9.5, QUARTER])


def test_an_s_bend_turns_left_then_right_and_back_to_the_first_heading():
    made = make_trajectory(np.array([[0.0, 0.0], [4.0, 0.0], [8.0, 4.0], [12.0, 4.0]]), LIMITS, rounding=0.1)
    curvature, s = made.samples[:, 4], made.samples[:, 0]
    left, right = s[curvature > 0.0], s[curvature < 0.0]
    assert left.max() < right.min()
    step = made.samples[1, 0]
    assert curvature[curvature > 0.0].sum() * step == pytest.approx(0.25 * math.pi, abs=2e-3)
    assert curvature[curvature < 0.0].sum() * step == pytest.approx(-0.25 * math.pi, abs=2e-3)
    assert made.samples[-1, 3] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(curvature).max() == pytest.approx(1.0 / made.radii[1], rel=0.05)


def check_consistency(made, limits=LIMITS):
    s, x, y, heading, curvature, speed = made.samples.T
    step = s[1]
    assert np.diff(s) == pytest.approx(step, abs=1e-9)
    bend = 1.0 / made.radii.min()
    chord = np.hypot(np.diff(x), np.diff(y))
    assert chord.max() <= step + 1e-9
    if bend * step < 0.3:  # fillets the samples resolve
        # the curvature is piecewise linear: over one kink the trapezoid is off by a quarter of the steepest step
        kink = np.abs(np.diff(curvature)).max() + 1e-9
        assert wrap(np.diff(heading)) / step == pytest.approx(0.5 * (curvature[1:] + curvature[:-1]), abs=0.3 * kink)
        middle = heading[:-1] + 0.5 * wrap(np.diff(heading))
        assert np.abs(wrap(np.arctan2(np.diff(y), np.diff(x)) - middle)).max() < 0.1 * kink * step + 1e-9
    assert (heading >= -math.pi).all()
    assert (heading < math.pi).all()
    assert np.abs(curvature).max() <= bend * (1.0 + 1e-9)
    check_speed(speed, curvature, step, limits)


def check_speed(speed, curvature, step, limits):
    assert (speed > 0.0).all()
    assert (speed <= limits.fastest).all()
    assert np.abs(speed * curvature).max() <= limits.robot.max_angular + 1e-12
    gentle = np.abs(curvature) <= 1.0 / limits.radius_at(limits.slowest)
    assert (speed[gentle] ** 2 * np.abs(curvature[gentle]) <= limits.lateral + 1e-9).all()
    rates = np.diff(speed**2) / (2.0 * step)
    assert rates.max(initial=0.0) <= limits.robot.max_acceleration + 1e-9
    assert rates.min(initial=0.0) >= -limits.robot.max_deceleration - 1e-9
    assert speed[-1] <= limits.slowest


def test_curvature_is_continuous_and_the_heading_fits_the_points():
    cells, resolution = corridor(width=0.75)
    made = make_trajectory(np.array([[0.5, 0.5], [9.5, 0.5], [9.5, 9.5]]), LIMITS, cells, resolution, ORIGIN)
    check_consistency(made)
    # a clothoid that turns share * φ / 2 up to 1/R has the slope 1 / (R² share φ)
    slope = 1.0 / (made.radii[1] ** 2 * 0.3 * QUARTER)
    assert np.abs(np.diff(made.samples[:, 4])).max() <= slope * made.samples[1, 0] + 1e-9
    plain_arc_jump = 1.0 / made.radii[1]
    assert np.abs(np.diff(made.samples[:, 4])).max() < 0.3 * plain_arc_jump


def test_a_corner_is_moved_outwards_where_a_wall_is_on_its_inside():
    cells = np.ones((80, 80), np.bool_)
    cells[10:, :40] = False  # a block whose corner is at (2, 0.5)
    path = np.array([[0.025, 0.475], [2.025, 0.475], [2.025, 3.9]])
    made = make_trajectory(path, LIMITS, cells, 0.05, ORIGIN)
    assert len(made.slow_places) == 0
    assert made.radii[1] >= 0.2 / TURN_RATE
    assert made.corners[1, 0] > 2.1
    assert made.corners[1, 1] < 0.4
    assert free_samples(made.samples, cells, 0.05, ORIGIN)
    rigid_radius = 0.025 * math.sqrt(2.0) / fillets.fillet_shape(QUARTER, 0.3)[1]
    assert rigid_radius < 0.1, "without the move the corner would allow no more than this"


def test_a_one_cell_corridor_gets_the_tightest_fillet_and_its_speed():
    cells, resolution = corridor(width=0.1, resolution=0.1)
    made = make_trajectory(np.array([[0.05, 0.05], [9.95, 0.05], [9.95, 9.95]]), LIMITS, cells, resolution, ORIGIN)
    assert free_samples(made.samples, cells, resolution, ORIGIN)
    assert 0.115 < made.radii[1] < 0.458
    assert made.slow_places.tolist() == [made.corners[1].tolist()]
    assert made.samples[:, 5].min() == pytest.approx(TURN_RATE * made.radii[1], rel=0.02)
    assert made.samples[:, 5].min() > 0.05
    check_consistency(made)


def test_without_a_grid_the_corner_is_cut_by_the_rounding():
    made = make_trajectory(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]), LIMITS, rounding=0.05)
    gap = np.hypot(made.samples[:, 1] - 3.0, made.samples[:, 2]).min()
    assert gap == pytest.approx(0.05, abs=1e-3)


def test_a_slight_turn_is_no_curvature_spike():
    made = make_trajectory(np.array([[0.0, 0.0], [3.0, 0.0], [6.0, 0.05]]), LIMITS, rounding=0.01)
    assert np.abs(made.samples[:, 4]).max() < 0.12, "φ = 1/60 over 0.3 m: at most 2 φ / 0.3"


def test_a_path_without_length_is_one_sample():
    made = make_trajectory(np.array([[1.0, 2.0], [1.0, 2.0]]), LIMITS, heading=1.5 * math.pi)
    assert made.samples == pytest.approx(np.array([[0.0, 1.0, 2.0, -QUARTER, 0.0, 0.2]]))


def test_a_path_that_reverses_has_no_fillet_and_almost_no_speed():
    made = make_trajectory(np.array([[0.0, 0.0], [2.0, 0.0], [0.5, 0.0]]), LIMITS)
    assert made.radii[1] == 0.0
    assert made.samples[-1, :3] == pytest.approx([3.5, 0.5, 0.0])
    assert made.samples[:, 5].min() == pytest.approx(TURN_RATE * made.samples[1, 0] / math.pi, rel=1e-6)


def test_the_result_cannot_be_changed():
    made = make_trajectory(np.array([[0.0, 0.0], [2.0, 0.0]]), LIMITS)
    with pytest.raises(ValueError, match="read-only"):
        made.samples[0, 0] = 1.0


@pytest.mark.parametrize("points", [np.zeros((0, 2)), np.zeros((3, 3)), np.array([[0.0, np.nan]]), np.zeros(4)])
def test_points_that_form_no_path_are_refused(points):
    with pytest.raises(ValueError, match=r"points: expected \(n, 2\)"):
        make_trajectory(points, LIMITS)


# --- speed -----------------------------------------------------------------------------------------------------------


def test_the_speed_of_a_long_bend():
    curvature = np.zeros(1001)
    curvature[400:600] = [2.0] * 200  # w_lim / κ = 0.218
    speed = speed_profile(0.01, curvature, LIMITS)
    assert speed[0] == 0.2
    assert speed[6] == pytest.approx(math.sqrt(0.04 + 2.0 * 0.5 * 0.06)), "v² = v0² + 2 a s"
    assert speed[12:380] == pytest.approx(0.4)
    assert speed[400:600] == pytest.approx(TURN_RATE / 2.0)
    assert speed[-1] == 0.2


def test_lateral_acceleration_binds_where_it_is_small():
    limits = speed_limits(lateral=0.05)
    speed = speed_profile(0.01, np.full(500, 0.5), limits)
    assert speed[250] == pytest.approx(math.sqrt(0.05 / 0.5))


def test_the_turn_acceleration_limits_the_speed_where_the_curvature_rises():
    """v² dκ/ds is half the turn acceleration: v = sqrt(0.5 * 0.1 / 2) at dκ/ds = 2 /m². Before, v² falls by 2 a s."""
    curvature = np.concatenate([np.zeros(300), np.linspace(0.0, 1.0, 51), np.ones(300)])
    speed = speed_profile(0.01, curvature, speed_limits(max_angular_acceleration=0.1))
    assert speed[300:351] == pytest.approx(math.sqrt(0.025))
    assert speed[299] == pytest.approx(math.sqrt(0.025 + 2.0 * 0.5 * 0.01))


def test_the_turn_acceleration_limits_how_fast_the_speed_changes_in_a_bend():
    """κ dv/dt is a quarter of the turn acceleration: dv/dt = 0.25 * 0.2 / 2 at κ = 2 /m."""
    speed = speed_profile(0.01, np.full(500, 2.0), speed_limits(slowest=0.1, max_angular_acceleration=0.2))
    assert speed[1] == pytest.approx(math.sqrt(0.1**2 + 2.0 * 0.025 * 0.01))


def turn_accelerations(limits):
    """(n,) dω/dt of the reference round the corner of an L, rad/s²."""
    cells, resolution = corridor()
    samples = make_trajectory(np.array([[1.0, 1.5], [8.5, 1.5], [8.5, 9.0]]), limits, cells, resolution).samples
    speed, step = samples[:, 5], samples[1, 0]
    return np.diff(samples[:, 4] * speed) / (2.0 * step / (speed[1:] + speed[:-1]))


@pytest.mark.parametrize("limit", [0.02, 0.05, 0.1])
def test_the_turn_rate_changes_round_a_corner_by_less_than_the_turn_acceleration(limit):
    limits = {"fastest": 0.8, "max_acceleration": 0.2, "max_deceleration": 0.2}
    assert np.abs(turn_accelerations(speed_limits(**limits))).max() > 0.8 * limit
    assert np.abs(turn_accelerations(speed_limits(**limits, max_angular_acceleration=limit))).max() <= 0.76 * limit


def test_a_large_turn_acceleration_changes_no_trajectory():
    cells, resolution = corridor()
    points = np.array([[1.0, 1.5], [8.5, 1.5], [8.5, 9.0]])
    free, large = (
        make_trajectory(points, speed_limits(max_angular_acceleration=limit), cells, resolution).samples
        for limit in (math.inf, 10.0)
    )
    assert (free == large).all()


def test_a_given_start_speed_is_kept():
    assert speed_profile(0.01, np.zeros(500), LIMITS, start=0.3)[0] == pytest.approx(0.3)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2.0), st.floats(0.05, 2.0), st.floats(0.005, 0.05))
def test_every_speed_keeps_its_bounds(seed, up, down, step):
    rng = np.random.default_rng(seed)
    curvature = np.convolve(rng.normal(0.0, 4.0, 300), np.ones(20) / 20.0, mode="same")
    limits = speed_limits(max_acceleration=up, max_deceleration=down)
    check_speed(speed_profile(step, curvature, limits), curvature, step, limits)


# --- properties ------------------------------------------------------------------------------------------------------


def shortest_steps(cells, start, end):
    """(n, 2) cells row, column of a breadth-first path, 8-connected without cutting corners, or None."""
    came, queue = {start: start}, deque([start])
    steps = [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]
    while queue:
        r, c = queue.popleft()
        for dr, dc in steps:
            a = (r + dr, c + dc)
            inside = 0 <= a[0] < cells.shape[0] and 0 <= a[1] < cells.shape[1]
            if a not in came and inside and cells[a] and cells[r, a[1]] and cells[a[0], c]:
                came[a] = (r, c)
                queue.append(a)
    if end not in came:
        return None
    path = [end]
    while path[-1] != start:
        path.append(came[path[-1]])
    return np.array(path[::-1])


def random_case(seed, density):
    """A random grid of 0.25 m cells with origin (-2, 1), and a path over its cell centres."""
    rng = np.random.default_rng(seed)
    cells = rng.random((16, 20)) > density
    start, end = (tuple(rng.integers(0, (16, 20))) for _ in range(2))
    assume(cells[start] and cells[end] and start != end)
    steps = shortest_steps(cells, start, end)
    assume(steps is not None)
    return cells, (steps[:, ::-1] + 0.5) * 0.25 + (-2.0, 1.0)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.5))
def test_on_any_grid_the_trajectory_is_free_and_consistent(seed, density):
    cells, path = random_case(seed, density)
    made = make_trajectory(path, LIMITS, cells, 0.25, (-2.0, 1.0))
    assert free_samples(made.samples, cells, 0.25, (-2.0, 1.0))
    assert made.samples[0, 1:3] == pytest.approx(path[0], abs=1e-9)
    assert made.samples[-1, 1:3] == pytest.approx(path[-1], abs=1e-9)
    check_consistency(made)
    assert made.samples[:, 5].min() > 0.05


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.5))
def test_turning_the_world_by_90_degrees_turns_the_answer(seed, density):
    cells, path = random_case(seed, density)
    made = make_trajectory(path, LIMITS, cells, 0.25, (-2.0, 1.0)).samples
    # (x, y) -> (-y, x): the grid's rows become columns, from the highest y on
    turned_cells = np.ascontiguousarray(cells.T[:, ::-1])
    turned_path = np.column_stack([-path[:, 1], path[:, 0]])
    turned = make_trajectory(turned_path, LIMITS, turned_cells, 0.25, (-1.0 - 16 * 0.25, -2.0)).samples
    assert turned.shape == made.shape
    assert turned[:, 1] == pytest.approx(-made[:, 2], abs=1e-9)
    assert turned[:, 2] == pytest.approx(made[:, 1], abs=1e-9)
    assert wrap(turned[:, 3] - made[:, 3] - QUARTER) == pytest.approx(0.0, abs=1e-9)
    assert turned[:, [0, 4, 5]] == pytest.approx(made[:, [0, 4, 5]], abs=1e-7)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_polyline_without_a_grid_stays_near_itself(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-3.0, 3.0, (rng.integers(2, 12), 2))
    made = make_trajectory(points, LIMITS, rounding=0.05)
    for x, y in made.samples[::7, 1:3]:
        assert distance_to_polyline(points, x, y) <= 0.1 + 1e-9


def distance_to_polyline(points, x, y):
    a, run = points[:-1], np.diff(points, axis=0)
    share = (((np.array([x, y]) - a) * run).sum(axis=1) / (run**2).sum(axis=1)).clip(0.0, 1.0)
    return np.hypot(*(a + share[:, None] * run - [x, y]).T).min()


def test_the_length_of_a_sampled_fillet_is_that_of_its_formula():
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])
    samples = sample_path(corners, np.array([np.inf, 0.5, np.inf]), np.ones(3), 0.001)
    reach, aside = fillets.fillet_shape(QUARTER, 1.0)
    assert samples[-1, 0] == pytest.approx(4.0 - reach + 0.5 * QUARTER * 2.0)
    assert np.hypot(*np.diff(samples[:, 1:3], axis=0).T).sum() == pytest.approx(samples[-1, 0], abs=1e-5)
    assert np.hypot(samples[:, 1] - 2.0, samples[:, 2]).min() == pytest.approx(0.5 * aside, abs=1e-5)
    assert samples[:, 4].max() == pytest.approx(2.0, abs=0.01)


# --- along the path's own points -------------------------------------------------------------------------------------


def test_a_kept_corner_is_driven_through_at_full_speed_and_its_heading_jumps():
    made = keep_corners(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), LIMITS)
    length, x, y, heading, bend, speed = made.samples.T
    assert length[-1] == pytest.approx(2.0) and (x[-1], y[-1]) == pytest.approx((1.0, 1.0))
    assert (bend == 0.0).all()
    assert set(np.round(heading, 12)) == {0.0, round(QUARTER, 12)}
    assert np.minimum(np.abs(y), np.abs(x - 1.0)).max() < 1e-12  # on the legs, not cut
    # v² = 0.2² + 2 · 0.5 · s: 0.4 m/s after 0.12 m, and 0.2 m/s again at the end.
    assert speed[length > 0.125][0] == 0.4 and speed[length < 0.115].max() < 0.4
    assert (speed[(length > 0.15) & (length < 1.85)] == 0.4).all()
    assert (speed[0], speed[-1]) == (0.2, 0.2)


def test_a_path_of_one_place_stands_there_with_the_heading_asked_for():
    made = keep_corners(np.array([[2.0, 3.0], [2.0, 3.0]]), LIMITS, heading=1.0)
    assert made.samples.tolist() == [[0.0, 2.0, 3.0, 1.0, 0.0, 0.2]]
