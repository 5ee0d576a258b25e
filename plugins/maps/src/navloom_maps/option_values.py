"""Values of options of generated worlds: sides of an area and shares, as in `?size=30x20&blind=0.5`."""

from __future__ import annotations

import math
import re

from navloom.worlds import WorldError

__all__ = ["share_of", "sides_of"]

_SIDE = r"\d{1,3}(?:\.\d{1,3})?"


def sides_of(reference: str, key: str, text: str, count: int, limits: tuple[float, float]) -> list[float]:
    """The sides of an area, m: `10`, or with a count of two `16x6`.

    Raises:
        WorldError: They are not `count` numbers within the limits, m.
    """
    found = [float(side) for side in text.split("x")] if re.fullmatch(f"{_SIDE}(?:x{_SIDE})*", text, re.ASCII) else []
    if len(found) != count or not all(limits[0] <= side <= limits[1] for side in found):
        what = "a side" if count == 1 else "length x width"
        example = "x".join(["10", "6"][:count])
        raise WorldError(
            f"{reference}: {key}={text}: expected {what} from {limits[0]:g} to {limits[1]:g} m, as in {key}={example}"
        )
    return found


def share_of(reference: str, key: str, text: str) -> float:
    """A number from 0 to 1.

    Raises:
        WorldError: It is not.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    # Negated, so that NaN is refused too.
    if not 0.0 <= value <= 1.0:
        raise WorldError(f"{reference}: {key}={text}: expected a share from 0 to 1")
    return value
