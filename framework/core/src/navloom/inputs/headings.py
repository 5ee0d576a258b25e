"""Headings that people give, in commands, options and files: degrees within a turn to either side."""

from __future__ import annotations

import logging
import math

__all__ = ["heading_problem", "warn_of_radians"]

TURN_DEG = 360.0
ROUNDED = 0.002
"""Largest deviation of an angle in radians that was typed with few digits, rad, as 3.14 for π."""


def heading_problem(heading_deg: float) -> str:
    """Why a heading is refused; empty if it is in degrees within a turn to either side."""
    return "" if abs(heading_deg) <= TURN_DEG else f"got {heading_deg:g}, expected degrees of -360 to 360"


def warn_of_radians(heading_deg: float) -> None:
    """Log a warning if a heading looks like radians: a multiple of 45° in radians that is no multiple of 0.5°."""
    eighths = round(heading_deg / (math.pi / 4.0)) if abs(heading_deg) <= TURN_DEG else 0
    is_close = abs(heading_deg - eighths * math.pi / 4.0) <= ROUNDED
    if 1 <= abs(eighths) <= 8 and is_close and heading_deg % 0.5:
        logging.getLogger("navloom.headings").warning(
            f"a heading of {heading_deg:g} is read in degrees; if it is in radians, give {45 * eighths}"
        )
