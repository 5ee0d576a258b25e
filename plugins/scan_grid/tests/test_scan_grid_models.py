"""The inverse sensor models, with numbers that can be checked by hand."""

from __future__ import annotations

import math

import pytest
from navloom_scan_grid.models import beam_spans, cone_log_odds, log_odds, probability

CONE = {"half_angle": 0.25, "range_min": 0.3, "reach": 4.0, "depth": 0.1, "hit": 0.4, "passed": -0.8}


def test_log_odds_of_known_probabilities() -> None:
    assert log_odds(0.5) == 0.0
    assert log_odds(0.8) == pytest.approx(math.log(4.0))
    assert log_odds(0.2) == pytest.approx(-math.log(4.0))


def test_two_echoes_of_0_7_make_49_to_9() -> None:
    """(0.7 / 0.3)² = 49 / 9."""
    assert probability(2.0 * log_odds(0.7)) == pytest.approx(49.0 / 58.0)


@pytest.mark.parametrize(
    ("reading", "spans"),
    [
        (2.0, (1.8, 1.9, 2.1)),  # α = 0.2: occupied 0.1 before and behind the echo; the 0.1 before that unchanged
        (0.05, (0.0, 0.0, 0.15)),  # at the sensor's minimum: the obstacle may be nearer
        (0.15, (0.0, 0.05, 0.25)),  # nearer than the margins: nothing is free
        (5.0, (4.8, 4.9, 5.1)),
        (5.01, (5.0, 0.0, -1.0)),  # farther than the reach
        (math.inf, (5.0, 0.0, -1.0)),
    ],
)
def test_spans_of_a_beam(reading: float, spans: tuple[float, float, float]) -> None:
    free, near, far = beam_spans(reading, 0.05, 5.0, 0.2, 0.1)
    assert (free, near, far) == pytest.approx(spans)


def test_a_cone_is_strongest_on_its_axis_at_its_echo() -> None:
    assert cone_log_odds(2.0, 0.0, 2.0, **CONE) == 0.4


def test_a_cones_arc_fades_to_its_flanks_and_in_depth() -> None:
    """Half the half angle: 1 - 1/4; half of ε: 1 - 1/4."""
    assert cone_log_odds(2.0, 0.125, 2.0, **CONE) == pytest.approx(0.4 * 0.75)
    assert cone_log_odds(2.05, 0.0, 2.0, **CONE) == pytest.approx(0.4 * 0.75)
    assert cone_log_odds(2.05, 0.125, 2.0, **CONE) == pytest.approx(0.4 * 0.75 * 0.75)


def test_a_cone_frees_cells_before_its_echo_and_farther_ones_less() -> None:
    """R = 2.0, ε = 0.1, R_min = 0.3; at 1.1 half of the way from R_min to R - ε: 1 - 1/4."""
    assert cone_log_odds(0.2, 0.0, 2.0, **CONE) == -0.8
    assert cone_log_odds(1.1, 0.0, 2.0, **CONE) == pytest.approx(-0.8 * 0.75)
    assert cone_log_odds(1.1, 0.125, 2.0, **CONE) == pytest.approx(-0.8 * 0.75 * 0.75)


@pytest.mark.parametrize(
    ("distance", "angle", "reading"),
    [(2.11, 0.0, 2.0), (1.0, 0.25, 2.0), (2.0, 0.3, 2.0), (0.1, 0.0, 0.3), (4.0, 0.0, math.inf)],
    ids=["behind", "flank", "beside", "before the nearest reading", "at the reach"],
)
def test_a_cone_does_not_change_other_places(distance: float, angle: float, reading: float) -> None:
    assert cone_log_odds(distance, angle, reading, **CONE) == 0.0


def test_a_cone_without_an_echo_frees_up_to_its_reach_and_occupies_nothing() -> None:
    """Half of the way from R_min to 4.0: 1 - 1/4."""
    assert cone_log_odds(2.15, 0.0, math.inf, **CONE) == pytest.approx(-0.8 * 0.75)
    assert max(cone_log_odds(0.05 * k, 0.0, math.inf, **CONE) for k in range(100)) == 0.0
