"""Parameters of the mappers scan_grid and layered, as a config file gives them."""

from __future__ import annotations

import math
from typing import Literal

from navloom import Params
from pydantic import Field, model_validator

from navloom_scan_grid.kernels import Weights
from navloom_scan_grid.layer import LayerSettings
from navloom_scan_grid.mapping import MapSettings
from navloom_scan_grid.models import log_odds

__all__ = ["LayeredParams", "ScanGridParams"]


class ScanGridParams(Params):
    """Lengths in m, probabilities without unit. The README gives the source of each default."""

    cell: float = Field(0.05, ge=0.005, le=1.0, description="Edge of a cell, m.")
    chunk: float = Field(
        5.0, gt=0.0, le=100.0, description="Length by which the map grows at a time, m, in whole cells."
    )
    extent: tuple[float, float, float, float] | None = Field(
        None, description="Area covered from the start: lowest x, y, highest x, y, m; none: only what is seen."
    )
    max_range: float = Field(10.0, gt=0.0, le=1000.0, description="Readings are used up to this range, m.")
    max_range_tolerance: float = Field(
        0.01, ge=0.0, le=10.0, description="A reading this near to the sensor's maximum is no echo, m."
    )
    no_echo_clears: bool = Field(True, description="A reading without an echo clears the cells before the sensor.")
    p_hit: float = Field(0.7, gt=0.5, lt=1.0, description="Occupancy probability given by one echo of a beam.")
    p_passed: float = Field(0.4, gt=0.0, lt=0.5, description="Occupancy probability given by one beam that passed.")
    p_cone_hit: float = Field(
        0.6, gt=0.5, lt=1.0, description="Occupancy probability given by a cone on its axis at the echo."
    )
    p_cone_passed: float = Field(
        0.3, gt=0.0, lt=0.5, description="Occupancy probability given by a cone right before the sensor."
    )
    p_lowest: float = Field(0.12, gt=0.0, lt=0.5, description="Lowest probability of a cell.")
    p_highest: float = Field(0.97, gt=0.5, lt=1.0, description="Highest probability of a cell.")
    thickness: float = Field(0.0, ge=0.0, le=2.0, description="Depth of obstacles along a beam, m; 0: one cell.")
    clear_margin: float = Field(0.1, ge=0.0, le=2.0, description="Length before a beam's echo that is not cleared, m.")
    cone_depth: float = Field(0.1, gt=0.0, le=2.0, description="Half the depth of a cone's arc, m.")
    levels: Literal["ternary", "percent"] = Field("ternary", description="Publish free and occupied, or percent.")
    occupied_from: float = Field(0.65, gt=0.0, lt=1.0, description="Ternary: occupied from this probability on.")
    publish_rate_hz: float = Field(
        2.0, gt=0.0, le=1000.0, description="Highest rate at which the map is published, Hz."
    )
    clear_radius: float | None = Field(
        None,
        gt=0.0,
        le=1000.0,
        description="Radius around the robot that a clear request forgets, m; none: the whole map.",
    )
    track_slack: float = Field(
        0.2, ge=0.0, le=10.0, description="Longest time by which a scan may lie outside the track of poses, s."
    )

    @model_validator(mode="after")
    def _limits_enclose(self) -> ScanGridParams:
        if self.extent is not None and not (self.extent[0] <= self.extent[2] and self.extent[1] <= self.extent[3]):
            raise ValueError(f"extent is {list(self.extent)}, expected lowest x, y, highest x, y")
        if not self.p_lowest < self.occupied_from <= self.p_highest:
            raise ValueError(
                f"occupied_from is {self.occupied_from:g}, expected more than p_lowest and at most p_highest"
            )
        return self

    def settings(self, start: tuple[float, float]) -> MapSettings:
        """These parameters as settings of the pure modules.

        Args:
            start: Start position of the robot, m, map frame.
        """
        weights = Weights(
            hit=log_odds(self.p_hit),
            passed=log_odds(self.p_passed),
            cone_hit=log_odds(self.p_cone_hit),
            cone_passed=log_odds(self.p_cone_passed),
            lowest=log_odds(self.p_lowest),
            highest=log_odds(self.p_highest),
            thickness=self.thickness,
            clear_margin=self.clear_margin,
            depth=self.cone_depth,
            no_echo_clears=self.no_echo_clears,
        )
        return MapSettings(
            weights=weights,
            cell=self.cell,
            chunk=max(1, round(self.chunk / self.cell)),
            extent=self.extent or (*start, *start),
            max_range=self.max_range,
            max_range_tolerance=self.max_range_tolerance,
            occupied_from=log_odds(self.occupied_from),
            is_ternary=self.levels == "ternary",
            track_slack=self.track_slack,
        )


class LayeredParams(Params):
    """Lengths in m, times in s. The README gives the reason of each default."""

    max_range: float = Field(10.0, gt=0.0, le=1000.0, description="Readings are used up to this range, m.")
    wall_margin: float = Field(
        0.2, ge=0.0, le=2.0, description="An echo this near to a wall of the known map is that wall, m."
    )
    body_margin: float = Field(
        0.02, ge=0.0, le=1.0, description="An echo this near to the robot's footprint is the robot itself, m."
    )
    memory: float | None = Field(
        300.0,
        gt=0.0,
        description="How long an obstacle stays after it was last seen, s; none: until a sensor sees through it.",
    )
    publish_rate_hz: float = Field(
        1.0, gt=0.0, le=1000.0, description="Highest rate at which the map is published, Hz."
    )

    def settings(self) -> LayerSettings:
        """These parameters as settings of the pure module."""
        memory = math.inf if self.memory is None else self.memory
        return LayerSettings(MapSettings(max_range=self.max_range), self.wall_margin, memory)
