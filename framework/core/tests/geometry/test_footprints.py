import math

import numpy as np
import pytest
from navloom.geometry.footprints import (
    FootprintError,
    circumscribed_radius,
    disc,
    inscribed_radius,
    polygon,
    rectangle,
)


def test_the_radii_of_a_rectangle_are_half_its_width_and_half_its_diagonal() -> None:
    footprint = rectangle(0.8, 0.6)
    assert inscribed_radius(footprint) == pytest.approx(0.3)
    assert circumscribed_radius(footprint) == pytest.approx(0.5)
    assert np.array_equal(polygon(footprint), footprint)


def test_the_radii_are_taken_round_the_origin_not_the_middle() -> None:
    footprint = polygon([(1.0, -0.5), (1.0, 0.5), (-0.2, 0.5), (-0.2, -0.5)])
    assert inscribed_radius(footprint) == pytest.approx(0.2)
    assert circumscribed_radius(footprint) == pytest.approx(math.hypot(1.0, 0.5))


def test_a_checked_footprint_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        polygon(rectangle(1.0, 1.0))[0, 0] = 2.0


STAR = [(math.cos(a), math.sin(a)) for a in (math.radians(144.0 * k) for k in range(5))]


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ([(1, 0), (0, 1), (0.1, 0.1), (-1, 0), (0, -1)], r"not convex at the corner \[0\.1, 0\.1\]"),
        ([(0, -1), (-1, 0), (0.1, 0.1), (0, 1), (1, 0)], r"not convex at the corner \[0\.1, 0\.1\]"),
        ([(1, 1), (-1, -1), (1, -1), (-1, 1)], "crosses itself"),
        (STAR, "not convex"),
        (STAR[::-1], "not convex"),
        ([(1, 1), (2, 1), (2, 2), (1, 2)], "does not contain the base frame's origin"),
        ([(1, 1), (-1, 1)], "3 to 64 corners"),
        ([(1, 1), (-1, 1), (-1, 1), (-1, -1)], "corner 1 is there twice"),
        ([(1, 1), (-1, 1), (-1, math.nan)], "corner 2 is not finite"),
        ([(400, 300), (-400, 300), (-400, -300), (400, -300)], r"\[400\.0, 300\.0\]: expected metres, each"),
        ("square", r"expected corners as \[\[x, y\]"),
        ([(0, 0), (1, 0), (0, 1)], "does not contain"),
    ],
)
def test_no_other_outline_is_a_footprint(corners: object, message: str) -> None:
    with pytest.raises(FootprintError, match=message):
        polygon(corners)  # type: ignore[arg-type]


def test_a_clockwise_outline_is_turned() -> None:
    clockwise = [(1.0, 0.5), (1.0, -0.5), (-0.5, -0.5), (-0.5, 0.5)]
    assert polygon(clockwise).tolist() == [list(corner) for corner in reversed(clockwise)]
    assert inscribed_radius(polygon(clockwise)) == 0.5


def test_a_disc_is_enclosed_to_half_a_percent() -> None:
    assert inscribed_radius(disc(0.2)) == pytest.approx(0.2)
    assert circumscribed_radius(disc(0.2)) == pytest.approx(0.201, abs=5e-5)
    assert np.array_equal(polygon(disc(0.2)), disc(0.2))


@pytest.mark.parametrize("radius", [0.0, -1.0, 100.5, math.nan])
def test_a_disc_has_a_positive_radius_of_at_most_100_m(radius: float) -> None:
    with pytest.raises(FootprintError, match="radius"):
        disc(radius)


SQUARE = [(0.3, -0.3), (0.3, 0.3), (-0.3, 0.3), (-0.3, -0.3)]


@pytest.mark.parametrize(
    "corners",
    [
        [(0.3, -0.3), (0.3, 0.0), *SQUARE[1:]],
        [(0.3, -0.3), (0.3, -0.1), (0.3, 0.1), (0.3, 0.3), (0.1, 0.3), *SQUARE[2:]],
        [*SQUARE, (0.0, -0.3)],
        [(0.3, -0.3), (0.2995, 0.0), *SQUARE[1:]],
        [(0.0, -0.3), *reversed(SQUARE)],
    ],
)
def test_corners_on_a_straight_edge_are_left_out(corners: list[tuple[float, float]]) -> None:
    assert sorted(polygon(corners).tolist()) == sorted(map(list, SQUARE))


def test_a_corner_on_a_slanted_edge_is_left_out_although_rounded() -> None:
    # A third of the way from (0.3, -0.3) to (0.4, 0.4), to three digits.
    assert len(polygon([(0.3, -0.3), (0.333, -0.067), (0.4, 0.4), (-0.3, 0.3), (-0.3, -0.3)])) == 4


def test_a_dent_of_2_mm_is_not_a_straight_edge() -> None:
    with pytest.raises(FootprintError, match=r"not convex at the corner \[0\.298, 0\.0\]"):
        polygon([(0.3, -0.3), (0.298, 0.0), *SQUARE[1:]])


@pytest.mark.parametrize("side", [0.0, -1.0, 100.5, math.nan, math.inf])
def test_a_rectangle_has_positive_sides_of_at_most_100_m(side: float) -> None:
    with pytest.raises(FootprintError, match="width"):
        rectangle(1.0, side)
