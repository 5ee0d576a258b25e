import math

import numpy as np
import pytest
from navloom.geometry.footprints import (
    FootprintError,
    circumscribed_radius,
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


@pytest.mark.parametrize("side", [0.0, -1.0, 100.5, math.nan, math.inf])
def test_a_rectangle_has_positive_sides_of_at_most_100_m(side: float) -> None:
    with pytest.raises(FootprintError, match="width"):
        rectangle(1.0, side)
