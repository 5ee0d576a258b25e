"""Choice of a valley and of the direction in it: Borenstein & Koren 1991 (VFH)."""

import math
from collections.abc import Sequence

from navloom_avoidance.steering import wrap

TURN = 2.0 * math.pi


def target_offset(valley: tuple[int, int], sectors: int, target: float) -> float:
    """Angle from the target direction to a valley's nearer border, rad; 0 where the target is in the valley.

    Args:
        valley: First sector and number of sectors, counter-clockwise. sectors: Number of sectors of the full circle.
        target: rad, in the frame of the sectors.
    """
    alpha = TURN / sectors
    first, width = valley
    if (target - first * alpha) % TURN <= width * alpha:
        return 0.0
    return min(abs(wrap(first * alpha - target)), abs(wrap((first + width) * alpha - target)))


def nearest_valley(valleys: Sequence[tuple[int, int]], sectors: int, target: float) -> tuple[int, int] | None:
    """The candidate valley nearest to the target direction, the first of equals; None where there is none."""
    return min(valleys, key=lambda valley: target_offset(valley, sectors, target), default=None)


def valley_direction(valley: tuple[int, int], sectors: int, widest: int, target: float) -> float:
    """theta = (k_n + k_f) / 2 with the near border k_n and, in a wide valley, k_f = k_n +- s_max; rad in [-pi, pi).

    The paper does not cover a target direction inside a wide valley. Here the robot steers to the target if that is
    s_max / 2 from both borders (VFH+), else by the rule above from the border nearer to the target.

    Args:
        valley, sectors, target: As for target_offset(). widest: s_max; a valley with more sectors is wide.
    """
    alpha = TURN / sectors
    first, width = valley
    if width == sectors:
        return wrap(target)
    right, left, half = first * alpha, (first + width) * alpha, 0.5 * widest * alpha
    if width <= widest:
        return wrap(0.5 * (right + left))
    inside = (target - right) % TURN
    if half <= inside <= width * alpha - half:
        return wrap(target)
    if abs(wrap(right - target)) <= abs(wrap(left - target)):
        return wrap(0.5 * (right + (right + widest * alpha)))
    return wrap(0.5 * (left + (left - widest * alpha)))
