import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from navloom.geometry.angles import difference, wrap

ANGLES = st.floats(-1e6, 1e6)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (math.pi, -math.pi),
        (-math.pi, -math.pi),
        (0.0, 0.0),
        (1e-300, 1e-300),
        (math.tau, 0.0),
        (1.5 * math.pi, -0.5 * math.pi),
    ],
)
def test_wrapping_leads_into_the_half_open_range(angle: float, wrapped: float) -> None:
    assert wrap(angle) == wrapped
    assert wrap(np.array([angle]))[0] == wrapped


@given(ANGLES)
def test_a_wrapped_angle_is_the_same_direction(angle: float) -> None:
    wrapped = wrap(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)


@given(st.lists(ANGLES, min_size=1, max_size=5))
def test_arrays_wrap_like_their_elements(angles: list[float]) -> None:
    wrapped = wrap(np.array(angles))
    assert (wrapped >= -math.pi).all()
    assert (wrapped < math.pi).all()
    apart = np.abs(wrapped - [wrap(a) for a in angles])
    assert np.minimum(apart, math.tau - apart).max() < 1e-9


@given(st.floats(-math.pi, math.nextafter(math.pi, 0.0)))
def test_an_angle_in_range_comes_back_bit_for_bit(angle: float) -> None:
    assert wrap(angle) == angle
    assert wrap(np.array([angle]))[0] == angle


def test_a_difference_goes_the_short_way() -> None:
    assert math.isclose(difference(math.radians(-170), math.radians(170)), math.radians(20))
    assert np.allclose(difference(np.array([3.0, -3.0]), -3.0), [6.0 - math.tau, 0.0])
