"""What the tables of a config are made of: their bases, kinds of numbers, and places in the map."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag

from navloom.inputs.spreads import GUESS, sigma_of
from navloom.roles.base import StrictModel

__all__ = ["Heading", "HeadingSpread", "OffsetTable", "OpenTable", "PlaceTable", "PointTable", "Positive",
           "Start", "StartTable", "Table"]  # fmt: skip

Positive = Annotated[float, Field(gt=0.0)]
Heading = Annotated[float, Field(ge=-360.0, le=360.0)]
HeadingSpread = Annotated[float, Field(gt=0.0, le=180.0)]


class Table(StrictModel):
    """Base of the config's tables: unknown keys are refused, integers are accepted as floats, infinity is not."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class OpenTable(StrictModel):
    """Base of tables that hold a plugin's parameters in addition to their own keys."""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    @property
    def params(self) -> dict[str, Any]:
        """The keys that belong to the plugin."""
        # A copy: the table is frozen, its dict is not.
        return dict(self.__pydantic_extra__ or {})


class PointTable(Table):
    """A point in the map frame, m."""

    x: float
    y: float


class PlaceTable(Table):
    """A place in the map frame, m and degrees."""

    x: float
    y: float
    heading_deg: Heading | None = None


class StartTable(PlaceTable):
    """Where the robot starts: exactly, or with a spread, which makes it a guess."""

    spread: Positive | None = Field(
        default=None, description=f"standard deviation of x and of y, m; a guess without it: {GUESS[0]:g}"
    )
    heading_spread_deg: HeadingSpread | None = Field(
        default=None, description=f"standard deviation of the heading, degrees; a guess without it: {GUESS[1]:g}"
    )

    @property
    def sigma(self) -> tuple[float, float] | None:
        """Standard deviations of the place, m, and of the heading, rad; None for an exact start."""
        return sigma_of(self.spread, self.heading_spread_deg)


# Told apart by their types: an error in a table would otherwise say that "unknown" was expected.
Start = Annotated[
    Annotated[StartTable, Tag("table")] | Annotated[Literal["unknown"], Tag("text")],
    Discriminator(lambda given: "text" if isinstance(given, str) else "table"),
]
"""A start: a pose, a guess, or "unknown"."""


class OffsetTable(Table):
    """An offset of a pose."""

    x: float = Field(default=0.0, description="m")
    y: float = Field(default=0.0, description="m")
    heading_deg: Heading = Field(default=0.0, description="degrees, counter-clockwise")
