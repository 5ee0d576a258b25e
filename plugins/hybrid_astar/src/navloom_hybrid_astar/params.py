"""Parameters of the hybrid_astar planner. What is `None` follows from the robot."""

from __future__ import annotations

import math
from typing import Literal

from navloom import Params, RobotSpec
from navloom.geometry.footprints import circumscribed_radius
from pydantic import Field

from navloom_hybrid_astar.planning import Settings

__all__ = ["HybridAstarParams"]

_STEERING_RESERVE = 1.1
"""Default radius over the least of an Ackermann robot: the tracker must be able to correct on either side."""


class HybridAstarParams(Params):
    """Lengths in m. The README says how each default was chosen."""

    source: Literal["auto", "segments", "cells"] = Field(
        "auto", description="plan on outlines or on the map's own cells; auto: outlines if there are any"
    )
    cell: float = Field(0.05, ge=0.01, le=1.0, description="edge of a cell of the grid that outlines are drawn on, m")
    occupied_from: int = Field(50, ge=1, le=100, description="lowest value of a cell that is an obstacle, percent")
    unknown: Literal["free", "blocked"] = Field("free", description="how unknown cells are treated")
    clearance: float = Field(
        0.05, ge=0.0, le=1.0, description="distance between footprint and obstacles where there is a path with it, m"
    )
    turn_radius: float | None = Field(
        None,
        gt=0.0,
        le=100.0,
        description="least radius of an arc, m; default: 1.1 times that of an Ackermann robot, otherwise the radius at "
        "the highest speed and turn rate, at least half the circumscribed one",
    )
    backwards: bool = Field(True, description="whether the path may lead backwards; false: Dubins curves")
    reverse_cost: float = Field(0.5, ge=0.0, le=100.0, description="extra cost of each metre backwards, m")
    switch_cost: float = Field(0.3, ge=0.0, le=100.0, description="cost of a change of direction, m")
    steer_cost: float = Field(
        0.02, ge=0.0, le=100.0, description="cost of a change between straight and the least radius, in the search, m"
    )
    turn_cost: float | None = Field(
        None,
        ge=0.0,
        le=100.0,
        description="cost of each rad turned in place, m; default: what the robot would drive in that time at its "
        "highest speed",
    )
    lattice_cell: float = Field(0.2, ge=0.02, le=2.0, description="edge of the cells of the search, m")
    headings: int = Field(72, ge=16, le=360, description="headings of the search, in a full turn")
    max_expansions: int = Field(150_000, ge=1, le=2_000_000, description="bound of the search, expansions")
    improvement: float = Field(
        1.0,
        ge=0.0,
        le=100.0,
        description="the search for a cheaper path after the first one takes at most this times its expansions",
    )
    smoothing_rounds: int = Field(6, ge=0, le=50, description="rounds of joining and shifting poses")

    def settings(self, robot: RobotSpec) -> Settings:
        """Settings of the pure modules for a robot."""
        at_full = robot.max_linear / robot.max_angular
        if self.turn_radius is not None:
            radius = self.turn_radius
        elif robot.turn_radius > 0.0:
            radius = _STEERING_RESERVE * robot.turn_radius
        else:
            radius = max(at_full, 0.5 * circumscribed_radius(robot.footprint))
        turn = at_full if self.turn_cost is None else self.turn_cost
        return Settings(
            radius=radius,
            source=self.source,
            cell=self.cell,
            occupied_from=self.occupied_from,
            unknown=self.unknown,
            clearance=self.clearance,
            backwards=self.backwards,
            reverse=self.reverse_cost,
            switch=self.switch_cost,
            steer=self.steer_cost,
            turn=math.inf if robot.turn_radius > 0.0 else turn,
            edge=self.lattice_cell,
            headings=self.headings,
            most=self.max_expansions,
            further=self.improvement,
            rounds=self.smoothing_rounds,
        )
