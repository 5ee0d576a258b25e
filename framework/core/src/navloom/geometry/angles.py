"""Angles in [-π, π): wrapping and differences, of one angle or of arrays."""

from __future__ import annotations

import math
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["difference", "wrap"]


@overload
def wrap(angle: float) -> float: ...
@overload
def wrap(angle: NDArray[np.float64]) -> NDArray[np.float64]: ...


def wrap(angle: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
    """The same direction in [-π, π), rad. An angle in this range is returned bit for bit."""
    if isinstance(angle, np.ndarray):
        return _wrap_array(angle)
    if -math.pi <= angle < math.pi:
        return angle
    # Its range has both ends, -π and π.
    turned = math.remainder(angle, math.tau)
    return -math.pi if turned >= math.pi else turned


def _wrap_array(angle: ArrayLike) -> NDArray[np.float64]:
    given = np.asarray(angle, dtype=np.float64)
    # np.remainder rounds down, not to nearest. In the range the multiple is 0, which leaves every bit.
    turned = given - math.tau * np.round(given / math.tau)
    # Rounding leaves results within an ulp of ±π; both belong to -π.
    return np.where((turned >= math.pi) | (turned < -math.pi), -math.pi, turned)


@overload
def difference(angle: float, reference: float) -> float: ...
@overload
def difference(angle: NDArray[np.float64], reference: float | NDArray[np.float64]) -> NDArray[np.float64]: ...
@overload
def difference(angle: float, reference: NDArray[np.float64]) -> NDArray[np.float64]: ...


def difference(
    angle: float | NDArray[np.float64], reference: float | NDArray[np.float64]
) -> float | NDArray[np.float64]:
    """Shortest turn from `reference` to `angle`, rad in [-π, π), counter-clockwise positive."""
    return wrap(angle - reference)
