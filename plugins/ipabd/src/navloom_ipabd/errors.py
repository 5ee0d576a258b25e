"""What the mapping refuses, as types: each message names the place, what was given and what was expected."""

from __future__ import annotations

__all__ = ["DataError", "SettingError", "SweepError", "TrackError"]


class DataError(ValueError):
    """Input that cannot be mapped.

    Args:
        place: The field that is wrong, as `sweep.ranges`.
        given: What it holds.
        expected: What it should hold.
    """

    def __init__(self, place: str, given: str, expected: str) -> None:
        super().__init__(f"{place}: got {given}, expected {expected}")
        self.place = place
        self.given = given
        self.expected = expected


class SweepError(DataError):
    """A sweep that is empty, holds NaN or a negative, or whose arrays do not fit each other."""


class TrackError(DataError):
    """A pose track that is empty, out of order, or does not cover the sweep."""


class SettingError(DataError):
    """A setting outside of what its formula is defined for."""
