"""Faults of what sensors and maps say in numbers: stamps, ranges, noise, shifts of half a cell."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from navloom import (
    Context,
    LocalizerInput,
    MapperInput,
    MapUpdate,
    Metric,
    Path,
    PlanFailure,
    PlannerInput,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    PoseEstimate,
    RangeScan,
    Trail,
    World,
)
from navloom.geometry.world import Box, Place
from navloom.messages import Point2D
from navloom_sensors_sim.adapter import SensorsSim

from planted import Entries
from planted.sound import Flood, FromStart, Hits

ENTRIES = Entries()


# --- platforms --------------------------------------------------------------------------------------------------------


class Robot(SensorsSim):
    """The simulated robot, with a fault in each scan."""

    def advance(self, given: PlatformInput) -> PlatformOutput:
        report = super().advance(given)
        scans = {
            name: self.faulty(scan) if isinstance(scan, RangeScan) else scan for name, scan in report.scans.items()
        }
        return replace(report, scans=scans)

    def faulty(self, scan: RangeScan) -> RangeScan:
        return scan


@ENTRIES.plant("range_max_for_nothing", caught_by="no_echo")
class RangeMaxForNothing(Robot):
    """Many a driver does so."""

    def faulty(self, scan: RangeScan) -> RangeScan:
        return replace(scan, ranges=np.minimum(scan.ranges, scan.range_max))


@ENTRIES.plant("late_stamps", caught_by="echoes")
class LateStamps(Robot):
    """Puts the time of an earlier scan on each."""

    def faulty(self, scan: RangeScan) -> RangeScan:
        return replace(scan, stamp_ns=max(0, scan.stamp_ns - 800_000_000))


@ENTRIES.plant("early_stamps", caught_by="stamps")
class EarlyStamps(Robot):
    """Stamps of the next scan."""

    def faulty(self, scan: RangeScan) -> RangeScan:
        return replace(scan, stamp_ns=scan.stamp_ns + 300_000_000)


@ENTRIES.plant("range_max_in_km", caught_by="scan_geometry")
class RangeMaxInKm(Robot):
    def faulty(self, scan: RangeScan) -> RangeScan:
        return replace(scan, range_max=0.001 * scan.range_max, range_min=0.0)


@ENTRIES.plant("same_noise", caught_by="own_noise")
class SameNoise(Robot):
    """A seed of its own."""

    def __init__(self, params: Any, context: Context) -> None:
        super().__init__(params, replace(context, stream=lambda _: np.random.default_rng(0)))


# --- planners, mappers and localizers ---------------------------------------------------------------------------------


@ENTRIES.plant("at_corners", caught_by="centred")
class AtCorners(Flood):
    """Takes the corner of a cell for its middle."""

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer = super().plan(given)
        if isinstance(answer, PlanFailure):
            return answer
        points = answer.points.copy()
        points[1:-1] -= 0.5 * given.map.grid.resolution
        return replace(answer, points=points)


@ENTRIES.plant("all_free", caught_by="traversable")
class AllFree(Flood):
    """Its grid has nothing of the map."""

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer, grid = super().plan(given), given.map.grid
        if isinstance(answer, PlanFailure):
            return answer
        return replace(answer, traversable=replace(grid, cells=np.zeros_like(grid.cells)))


@ENTRIES.plant("length_in_cells", caught_by="path_length")
class LengthInCells(Flood):
    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer = super().plan(given)
        if isinstance(answer, PlanFailure):
            return answer
        return replace(answer, length=answer.length / given.map.grid.resolution)


@ENTRIES.plant("half_cell", caught_by="accurate")
class HalfCell(Hits):
    """The middle of its first cell is its origin."""

    def update(self, given: MapperInput) -> MapUpdate | None:
        answer = super().update(given)
        if answer is None:
            return None
        half, origin = 0.5 * answer.grid.resolution, answer.grid.origin
        return replace(answer, grid=replace(answer.grid, origin=Pose2D(origin.x + half, origin.y + half, 0.0)))


@ENTRIES.plant("laser_in_the_middle", caught_by="accurate")
class LaserInTheMiddle(Hits):
    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        super().insert(replace(scan, origins=np.zeros_like(scan.origins)), given)


@ENTRIES.plant("vague", caught_by="accurate")
class Vague(FromStart):
    """Its covariance is in square degrees."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        return replace(super().localize(given), covariance=np.diag([0.01, 0.01, 4.0]))


@ENTRIES.plant("one_stamp", caught_by="stamps")
class OneStamp(Hits):
    """Each of its maps has the stamp of the first."""

    def update(self, given: MapperInput) -> MapUpdate | None:
        answer = super().update(given)
        return None if answer is None else replace(answer, stamp_ns=0)


@ENTRIES.plant("always_lost", caught_by="accurate")
class AlwaysLost(FromStart):
    def localize(self, given: LocalizerInput) -> PoseEstimate:
        return replace(super().localize(given), state="lost", reason="no fix")


@ENTRIES.plant("place_in_cells", caught_by="typed_failures")
class PlaceInCells(Flood):
    def failure(self, given: PlannerInput, kind: str, place: Pose2D, why: str) -> PlanFailure:
        answer = super().failure(given, kind, place, why)
        row, column = self.cell(given.map.grid, place)
        return replace(answer, place=Point2D(float(column), float(row)))


# --- other kinds ------------------------------------------------------------------------------------------------------


@ENTRIES.plant("heading_in_degrees", "world_usable", "world")
def heading_in_degrees() -> World:
    return World("degrees", start=Place(0.0, 0.0, 90.0), goal=Place(2.0, 0.0), bounds=(-3.0, -3.0, 3.0, 3.0))


def fastest_turn(trail: Trail) -> float | None:
    trail.wz.setflags(write=True)
    trail.wz.sort()
    return float(trail.wz[-1]) if trail.wz.size else None


ENTRIES.plant("sorts_episode", "metric_untouched", "metric")(
    Metric("sorts_episode", "rad/s", "lower", fastest_turn, "Fastest turn to the left.")
)


@ENTRIES.plant("reversed_wall", "world_usable", "world")
def reversed_wall() -> World:
    wall = Box("wall", (2.0, -2.0), (1.0, 1.2))
    return World("reversed", (wall,), start=Place(0.0, 0.0), goal=Place(2.0, 0.0), bounds=(-3.0, -3.0, 3.0, 3.0))
