"""Errors of the mapping. Each message names the place, the value given and what was expected."""

from __future__ import annotations

from navloom import NavloomError

__all__ = ["DataError", "SettingError", "SweepError", "TrackError"]


class DataError(NavloomError, ValueError):
    """Input that cannot be mapped.

    Args:
        place: The field that is wrong, for example `sweep.ranges`.
        given: Its value.
        expected: The value it should have.
    """

    def __init__(self, place: str, given: str, expected: str) -> None:
        super().__init__(f"{place}: got {given}, expected {expected}")
        self.place = place
        self.given = given
        self.expected = expected


class SweepError(DataError):
    """A sweep that is empty, contains NaN or negative ranges, or has arrays of inconsistent shapes."""


class TrackError(DataError):
    """A pose track that is empty, out of order, or does not cover the sweep."""


class SettingError(DataError):
    """A setting outside the domain of its formula."""
