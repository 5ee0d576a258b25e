"""The smooth control law of Park & Kuipers 2011 by hand, and the parameters that follow from the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from navloom_trackers import derived
from navloom_trackers.graceful import (
    EgocentricPolar,
    curvature,
    egocentric_polar,
    line_of_sight,
    rates,
    speed,
    speed_weight,
    turning_speed,
)
from scipy.integrate import solve_ivp

K1, K2 = 1.0, 3.0
GAINS = st.floats(0.2, 5.0)


def test_a_pose_in_egocentric_polar_coordinates():
    """From (1, 1) to (4, 5): 3-4-5. The line of sight is at atan2(4, 3) = 53.13°, the robot at 90°, the pose at 0°."""
    seen = egocentric_polar(1.0, 1.0, 0.5 * math.pi, 4.0, 5.0, 0.0)
    assert seen == pytest.approx((5.0, -math.atan2(4.0, 3.0), 0.5 * math.pi - math.atan2(4.0, 3.0)))


def test_the_rates_are_those_of_a_moving_robot():
    """Line of sight along x, robot at 30°: it comes nearer at 0.4 cos 30° = 0.3464, and leaves the line at 0.2 m/s.

    The line of sight then turns right by 0.2 / 2 = 0.1 rad/s, so θ grows by 0.1 rad/s, and δ by 0.1 + 0.3.
    """
    found = rates(EgocentricPolar(2.0, 0.0, math.pi / 6.0), 0.4, 0.3)
    assert found == pytest.approx((-0.2 * math.sqrt(3.0), 0.1, 0.4))


def test_the_curvature_of_the_law():
    """k1 θ = 1: atan is π/4 and the factor of sin δ is 1 + 1/2. With δ = π/6, r = 2, k2 = 3:

    3 (π/6 + π/4) + 1.5 / 2 = 5π/4 + 0.75 = 4.6770, over -2: -2.3385 1/m.
    """
    assert curvature(EgocentricPolar(2.0, 1.0, math.pi / 6.0), K1, K2) == pytest.approx(-2.33850, abs=1e-5)


@given(st.floats(0.1, 5.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), GAINS, GAINS)
def test_the_heading_falls_to_the_one_that_theta_asks_for(r, theta, delta, k1, k2):
    """z = δ + atan(k1 θ), so z' = δ' + k1 θ' / (1 + (k1 θ)²), which the law makes -k2 v/r z; v = 1 m/s."""
    seen = EgocentricPolar(r, theta, delta)
    _, theta_rate, delta_rate = rates(seen, 1.0, curvature(seen, k1, k2))
    z = delta + math.atan(k1 * theta)
    assert delta_rate + k1 * theta_rate / (1.0 + (k1 * theta) ** 2) == pytest.approx(-k2 / r * z, abs=1e-9)


@given(st.floats(0.1, 5.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_the_mirrored_pose_gives_the_mirrored_curvature(r, theta, delta):
    mirrored = curvature(EgocentricPolar(r, -theta, -delta), K1, K2)
    assert mirrored == pytest.approx(-curvature(EgocentricPolar(r, theta, delta), K1, K2))


@pytest.mark.parametrize("radius", [0.5, 1.0, 3.0])
def test_with_the_papers_gains_a_circle_is_kept(radius):
    """A chord r of a circle R subtends 2α, sin α = r / 2R: δ = -α, θ = α. With k1 = 1 and k2 = 3, r κ is

    3 (α - atan α) + (1 + 1 / (1 + α²)) sin α = 2α - α³/3 + O(α⁵) = 2 sin α + O(α⁵), so κ = 1/R + O(α⁵)/r.
    """
    alpha = 0.2
    found = curvature(EgocentricPolar(2.0 * radius * math.sin(alpha), alpha, -alpha), 1.0, 3.0)
    assert found * radius == pytest.approx(1.0, abs=alpha**4)


def test_with_another_k1_a_circle_is_not_kept():
    """To first order R κ = (1 + k1 - k2 (k1 - 1)) / 2: with k1 = 2 and k2 = 3 the robot drives straight on."""
    alpha = 0.02
    seen = EgocentricPolar(2.0 * math.sin(alpha), alpha, -alpha)
    assert curvature(seen, 2.0, 3.0) == pytest.approx(0.0, abs=alpha**2)


def test_the_way_to_a_fixed_pose_ends_there_at_its_heading():
    """From 2 m before a pose and 1 m beside it, turned away by a right angle."""

    def unicycle(_, state):
        bend = curvature(egocentric_polar(*state, 2.0, 1.0, 0.0), K1, K2)
        near = min(1.0, math.hypot(2.0 - state[0], 1.0 - state[1]))
        return [near * math.cos(state[2]), near * math.sin(state[2]), near * bend]

    end = solve_ivp(unicycle, (0.0, 12.0), [0.0, 0.0, -0.5 * math.pi], rtol=1e-9, atol=1e-10).y[:, -1]
    assert end == pytest.approx([2.0, 1.0, 0.0], abs=1e-3)


@pytest.mark.parametrize(("bend", "slowed"), [(0.0, 0.5), (2.0, 0.5 / 2.6), (-2.0, 0.5 / 2.6)])
def test_the_speed_falls_with_curvature(bend, slowed):
    """1 + 0.4 * 2² = 2.6."""
    assert speed(0.5, bend, 0.4, 2.0) == pytest.approx(slowed)


def test_beyond_the_worst_curvature_the_turn_rate_stays():
    """β = 0.25, λ = 2: ω is greatest at κ = 2, 0.4 * 2 / 2 = 0.4 rad/s. At κ = 8 it is 3.2 / 17 by the law, or 0.4."""
    assert turning_speed(0.4, 1.0, 0.25, 2.0) == pytest.approx(0.4 / 1.25)
    assert speed(0.4, -8.0, 0.25, 2.0) == pytest.approx(0.4 / 17.0)
    assert turning_speed(0.4, -8.0, 0.25, 2.0) == pytest.approx(0.4 / 8.0)
    assert turning_speed(0.4, -8.0, 0.0, 2.0) == pytest.approx(0.4)


def test_the_weight_of_the_curvature_follows_from_the_turn_rate():
    """λ = 2: v κ / (1 + β κ²) is greatest at κ = 1/√β, v / (2 √β), so β = (v / 2ω)²: 1 m/s, 0.5 rad/s give 1."""
    assert speed_weight(1.0, 0.5, 2.0) == pytest.approx(1.0)
    assert speed_weight(0.5, math.radians(25.0), 2.0) == pytest.approx(0.32828, abs=1e-5)


@given(st.floats(0.1, 3.0), st.floats(0.2, 4.0), st.floats(1.2, 4.0))
def test_the_turn_rate_reaches_its_limit_and_never_exceeds_it(fastest, turn_rate, exponent):
    beta = speed_weight(fastest, turn_rate, exponent)
    bends = turn_rate / fastest * np.geomspace(0.1, 100.0, 4000)
    turns = [bend * speed(fastest, bend, beta, exponent) for bend in bends]
    assert max(turns) == pytest.approx(turn_rate, rel=1e-3)


@given(st.floats(0.1, 1.5), GAINS, GAINS)
def test_on_its_line_of_sight_the_law_keeps_the_approach(approach, k1, k2):
    sight = line_of_sight(approach, k1, k2)
    assert 0.0 < sight < approach
    assert curvature(EgocentricPolar(1.0, -sight, approach - sight), k1, k2) == pytest.approx(0.0, abs=1e-9)


# --- parameters that follow from the robot ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("damping", "stiffness", "per_second"),
    [
        # u² = (4 + √(16 + 16)) / 2 = 4.8284, u = 2.1974; atan u = 1.1437; 2.1974 / (1.1437 - 0.5236) = 3.544.
        (2.0, 2.0, 3.544),
        # u² = (25 + √(625 + 256)) / 2 = 27.341, u = 5.2288; atan(5 u / 8) = 1.2738; 5.2288 / 0.7502 = 6.970.
        (5.0, 8.0, 6.970),
    ],
    ids=["pure_pursuit", "graceful"],
)
def test_the_look_ahead_grows_with_the_time_that_passes(damping, stiffness, per_second):
    assert derived.margin_look_ahead(0.2, damping, stiffness) == pytest.approx(0.2 * per_second, rel=1e-3)


@given(st.floats(0.02, 0.5), GAINS, GAINS)
def test_the_late_loop_keeps_its_phase_margin(late, k1, k2):
    """The phase of (a s + b) / s² exp(-τ s) where its modulus is 1; s in units of 1/T, T the look-ahead."""
    a, b = 1.0 + k1 + k2, (1.0 + k1) * (1.0 + k2)
    time = derived.margin_look_ahead(late, a, b)
    u = np.geomspace(0.1, 100.0, 200_001)
    loop = (1j * a * u + b) / (1j * u) ** 2 * np.exp(-1j * u * late / time)
    crossing = loop[np.argmin(np.abs(np.abs(loop) - 1.0))]
    assert math.degrees(np.angle(-crossing)) == pytest.approx(30.0, abs=0.1)


def test_the_approach_brakes_at_the_robots_deceleration():
    """v = v_max d / D has the deceleration v v_max / D: at v_max = 0.5 m/s and D = 0.25 m, 1 m/s²."""
    assert derived.braking_approach(0.5, 1.0) == pytest.approx(0.25)
