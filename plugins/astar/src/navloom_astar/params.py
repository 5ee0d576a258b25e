"""Parameters of the astar planner, as a config file gives them, and its presets."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from navloom import Params, Preset
from numpy.typing import NDArray
from pydantic import Field

from navloom_astar.inflation import circumscribed_radius, inscribed_radius
from navloom_astar.planning import Settings
from navloom_astar.raster import RasterMethod

__all__ = ["PRINTED", "ROBUST", "AstarParams"]


class AstarParams(Params):
    """Parameters of the three planners. Lengths in m. The README gives the source of each default."""

    source: Literal["auto", "segments", "cells"] = Field(
        "auto", description="plan on outlines or on the map's own cells; auto: outlines if there are any"
    )
    cell: Annotated[float, Field(gt=0.0)] | Literal["third_of_chassis"] = Field(
        0.40, description="edge of a cell of the grid that outlines are drawn on, m"
    )
    anchor: tuple[float, float] | Literal["start", "lowest"] = Field(
        "start",
        description="a cell centre of the grid of outlines, m, map frame; lowest: the lowest x and y of all outlines",
    )
    raster: RasterMethod = Field("distance", description="which cells an outline occupies")
    paper_raster_t: float | None = Field(
        None, gt=0.0, description="T of the printed slope test, cells; default: the robot's size"
    )
    margin: float = Field(0.0, ge=0.0, description="margin around everything the grid must contain, m; see `outside`")
    outside: Literal["refused", "unknown"] = Field(
        "refused", description="start or goal outside the map's cells; unknown: the map is enlarged by unknown cells"
    )
    occupied_from: int = Field(50, ge=1, le=100, description="lowest value of a cell that is an obstacle, percent")
    unknown: Literal["free", "blocked", "cost"] = Field("free", description="how unknown cells are treated")
    unknown_cost: float = Field(
        1.0,
        ge=0.0,
        le=31.0,
        description="extra cost per metre of unknown ground, no unit, in eighths; for unknown = cost",
    )
    inflation: Literal["auto", "cells", "metres", "none"] = Field(
        "auto", description="how obstacles are grown; auto: cells on outlines, metres on the map's cells"
    )
    dilation_cells: int = Field(2, ge=0, le=1000, description="half width of the square for inflation = cells, cells")
    inflation_radius: Annotated[float, Field(ge=0.0)] | Literal["inscribed", "circumscribed"] = Field(
        "circumscribed", description="radius of the disc for inflation = metres, m, or a radius of the footprint"
    )
    inflation_margin: float = Field(0.0, ge=0.0, description="added to the radius, m")
    squeeze_margin: float | None = Field(
        0.05,
        ge=0.0,
        description="metres: ground from the radius to the inscribed one plus this, m, costs 4 m per m; none: closed",
    )
    escape_start: float | None = Field(
        None, ge=0.0, description="longest way out of the inflation, m; default: 1.5 times (its reach + a cell)"
    )

    def anchor_at(self, start: tuple[float, float]) -> tuple[float, float] | None:
        """x, y of a cell centre, m, map frame; None: the lowest x and y of the outlines. `start` is S."""
        if self.anchor == "lowest":
            return None
        return start if self.anchor == "start" else self.anchor

    def settings(self, footprint: NDArray[np.float64]) -> Settings:
        """Settings of the pure modules, with words such as "inscribed" resolved to lengths.

        Args:
            footprint: (n, 2) corners of the robot, m, base frame, convex, counter-clockwise.
        """
        size = float(np.ptp(footprint, axis=0).max())
        cell = size / 3.0 if self.cell == "third_of_chassis" else self.cell
        if self.inflation_radius == "inscribed":
            radius = inscribed_radius(footprint)
        elif self.inflation_radius == "circumscribed":
            radius = circumscribed_radius(footprint)
        else:
            radius = self.inflation_radius
        return Settings(
            source=self.source,
            cell=cell,
            raster=self.raster,
            paper_t=size / cell if self.paper_raster_t is None else self.paper_raster_t,
            margin=self.margin,
            outside=self.outside,
            occupied_from=self.occupied_from,
            inflation=self.inflation,
            dilation_cells=self.dilation_cells,
            radius=radius + self.inflation_margin,
            unknown=self.unknown,
            unknown_cost=self.unknown_cost,
            squeeze=None if self.squeeze_margin is None else inscribed_radius(footprint) + self.squeeze_margin,
            escape=self.escape_start,
        )


ROBUST = Preset("ours: cells from the start, and the inflation that suits the map")

PRINTED = Preset(
    "Hoang et al. 2013, III.A and IV.B",
    {
        "source": ("segments", "III.A: the grid is made from line segments"),
        "cell": (0.40, "IV.B: squares of 40 x 40 cm; III.A says a third of the chassis, 27 cm"),
        "anchor": ("lowest", "III.A: (x - x_min) / cellsize and (y - y_min) / cellsize"),
        "raster": (
            "distance",
            "III.A prints a slope test that leaves no path; decided: within half a cell of the line",
        ),
        "inflation": ("cells", "III.A: dilation by cells"),
        "dilation_cells": (2, "III.A: two more cells"),
        "unknown": ("free", "III.A: only line segments are obstacles"),
        "escape_start": (None, "not in the paper; decided: a start within the inflation is left on the shortest way"),
    },
)
