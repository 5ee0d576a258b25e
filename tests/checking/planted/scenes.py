"""Plugins that are right in plain scenes, and wrong with other sensors, maps, robots or paths."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from navloom import (
    Avoidance,
    AvoiderInput,
    Contact,
    Context,
    ControllerInput,
    LocalizerInput,
    MapperInput,
    MapUpdate,
    Message,
    Metric,
    NodePlugin,
    OccupancyGrid,
    Params,
    Path,
    PlanFailure,
    PlannerInput,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    PoseEstimate,
    Publishes,
    RangeScan,
    Stamp,
    Tick,
    TrackingCommand,
    Trail,
    Truth,
    Twist2D,
    World,
    message,
)
from navloom_viewer import Panel
from pydantic import Field

from planted import Entries
from planted.sound import STILL, Dot, Flood, FromStart, Gap, Hits, Proportional

ENTRIES = Entries()


# --- avoiders ---------------------------------------------------------------------------------------------------------


@ENTRIES.plant("steers_into", caught_by="turns_away")
class SteersInto(Gap):
    """Takes left for right where it steers round something: what is straight ahead stays ahead."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        for scan in given.scans:
            near = np.flatnonzero((scan.ranges < 1.6) & (np.abs(scan.bearings) < 1.0))
            if near.size and answer.twist != STILL:
                side = float(np.sign(scan.bearings[near].mean()))
                return replace(answer, twist=Twist2D(0.2 * answer.twist.vx, 0.0, 0.4 * side))
        return answer


@ENTRIES.plant("first_scan_only", caught_by="no_contact")
class FirstScanOnly(Gap):
    """Uses only one of two lasers."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return super().avoid(replace(given, scans=given.scans[:1], sensors=given.sensors[:1]))


@ENTRIES.plant("backs_blindly", caught_by="no_contact")
class BacksBlindly(Gap):
    """Backs up to a target behind it, but only checks ahead."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        if abs(self.bearing(given)) > 2.0:
            return Avoidance(Twist2D(-0.3, 0.0, 0.0), "steering")
        return super().avoid(given)


@ENTRIES.plant("one_robot_only", caught_by="limits")
class OneRobotOnly(Gap):
    """Has the limits of one robot in its code."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        turn = min(max(4.0 * self.bearing(given), -1.0), 1.0)
        return answer if answer.twist == STILL else replace(answer, twist=Twist2D(0.5, 0.0, turn))


# --- controllers ------------------------------------------------------------------------------------------------------


@ENTRIES.plant("first_path_only", caught_by="settles")
class FirstPathOnly(Proportional):
    """Stops once a new path arrives."""

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        self.path_id = 0

    def reset(self) -> None:
        self.path_id = 0

    def control(self, given: ControllerInput) -> TrackingCommand:
        self.path_id = self.path_id or given.trajectory.path_id
        answer = super().control(given)
        return answer if given.trajectory.path_id == self.path_id else replace(answer, twist=STILL)


@ENTRIES.plant("turns_in_degrees", caught_by="limits")
class TurnsInDegrees(Proportional):
    """Uses degrees in one of its two branches, the one that turns in place."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        if given.reference.turn_to is None:
            return answer
        return replace(answer, twist=Twist2D(0.0, 0.0, math.degrees(answer.twist.wz)))


# --- planners ---------------------------------------------------------------------------------------------------------


@ENTRIES.plant("unturned_map", caught_by="reaches")
class UnturnedMap(Flood):
    """Treats every raster as parallel to the axes."""

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        grid = given.map.grid
        straight = replace(grid, origin=replace(grid.origin, heading=0.0))
        return super().plan(replace(given, map=replace(given.map, grid=straight)))


@ENTRIES.plant("first_map_only", caught_by="no_contact")
class FirstMapOnly(Flood):
    """Inflates the obstacles of a map only once for each size of map."""

    def free(self, grid: OccupancyGrid) -> np.ndarray:
        if getattr(self, "known", np.empty(0)).shape != grid.cells.shape:
            self.known = super().free(grid)
        return self.known


@ENTRIES.plant("transposed_free", caught_by="traversable")
class TransposedFree(Flood):
    """The grid of its path has rows and columns mixed up."""

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer, grid = super().plan(given), given.map.grid
        if isinstance(answer, PlanFailure):
            return answer
        cells = np.where(self.free(grid), 0, 100).astype(np.int8).T
        return replace(answer, traversable=OccupancyGrid(cells, grid.resolution, grid.origin))


# --- mappers and localizers -------------------------------------------------------------------------------------------


@ENTRIES.plant("newest_pose", caught_by="accurate")
class NewestPose(Hits):
    """Puts a scan where the robot is now, not where it was."""

    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        super().insert(replace(scan, stamp_ns=given.stamp_ns), given)


@ENTRIES.plant("refilled", caught_by="answers_stay")
class Refilled(Hits):
    """Publishes its array as read-only, and writes to it again."""

    def update(self, given: MapperInput) -> MapUpdate | None:
        self.cells.flags.writeable = True
        answer = super().update(given)
        self.cells.flags.writeable = False
        if answer is None:
            return None
        return replace(answer, grid=OccupancyGrid(self.cells, answer.grid.resolution, self.origin()))


@ENTRIES.plant("map_in_seconds", caught_by="stamps")
class MapInSeconds(Hits):
    def update(self, given: MapperInput) -> MapUpdate | None:
        answer = super().update(given)
        return answer and replace(answer, stamp_ns=answer.stamp_ns // 10**9)


@ENTRIES.plant("stands_still", caught_by="accurate")
class StandsStill(FromStart):
    """Its pose moves, its twist is 0."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        return replace(super().localize(given), twist=STILL)


@ENTRIES.plant("lopsided", caught_by="covariance")
class Lopsided(FromStart):
    """Sets only one half of the covariance."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        covariance = np.diag([0.01, 0.01, 0.01])
        covariance[0, 2] = 0.005
        return replace(super().localize(given), covariance=covariance)


@ENTRIES.plant("impossible_covariance", caught_by="covariance")
class ImpossibleCovariance(FromStart):
    """Gives a covariance larger than its variances allow."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        covariance = np.array([[0.01, 0.02, 0.0], [0.02, 0.01, 0.0], [0.0, 0.0, 0.01]])
        return replace(super().localize(given), covariance=covariance)


# --- platforms --------------------------------------------------------------------------------------------------------


@ENTRIES.plant("mirrored_laser", caught_by="echoes")
class MirroredLaser(Dot):
    """Scans the mirror image of its world."""

    def scan(self, given: PlatformInput) -> RangeScan:
        turn = np.linspace(-1.0, 1.0, 9)
        heading = self.context.start.heading + self.heading
        room = 1.4 - (self.context.start.y + self.y)
        with np.errstate(divide="ignore"):
            ranges = np.where(np.sin(heading - turn) > 0.2, room / np.sin(heading - turn), np.inf)
        zeros = np.zeros(9)
        return RangeScan(given.time_ns, np.zeros((9, 2)), turn, zeros, zeros, ranges, 0.05, 30.0)


@ENTRIES.plant("feels_nothing", caught_by="contact")
class FeelsNothing(Dot):
    """Its truth touches the wall, its bumper does not."""

    def advance(self, given: PlatformInput) -> PlatformOutput:
        answer = super().advance(given)
        start, is_there = self.context.start, self.x > 0.5
        pose = Pose2D(start.x + self.x, start.y + self.y, self.heading)
        truth = Truth(pose, answer.odometry.twist, 0.0 if is_there else 1.0, "wall", is_there)
        return replace(answer, contact=Contact(False), truth=truth)


class BeamSettings(Params):
    beams: int = Field(9, ge=1, le=100, description="Beams of a scan.")


@ENTRIES.plant("single_beam", caught_by="sensor_extremes")
class SingleBeam(Dot):
    """Fails at a single beam, which its settings allow."""

    sensor_settings = {"laser": BeamSettings}

    def scan(self, given: PlatformInput) -> RangeScan:
        beams = self.context.sensors[0].settings.get("beams", 9)
        assert 180 // (beams - 1) >= 0
        return super().scan(given)


class FarSettings(Params):
    reach: float = Field(5.0, gt=0.0, le=50.0, description="Farther echoes are none.")


@ENTRIES.plant("unitless_sensor", caught_by="units")
class UnitlessSensor(Dot):
    sensor_settings = {"laser": FarSettings}


@ENTRIES.plant("fixed_tick", caught_by="drives_as_told")
class FixedTick(Dot):
    """Advances by one tick, whatever the time of its input."""

    def advance(self, given: PlatformInput) -> PlatformOutput:
        self.time_ns = given.time_ns - 50_000_000 * (given.time_ns > 0)
        return super().advance(given)


# --- others -----------------------------------------------------------------------------------------------------------


def only_ahead(trail: Trail) -> float | None:
    """Fails where the robot backs up."""
    return math.sqrt(float(trail.vx.mean())) if trail.vx.size else None


ENTRIES.plant("only_ahead", "metric_values", "metric")(
    Metric("only_ahead", "m", "lower", only_ahead, "A number of an episode; it is not defined without a tick.")
)


def infinite_dot(given: RangeScan, seen: Any) -> Any:
    """Draws the nearest echo even where there is none."""
    import rerun as rr

    if given.ranges.size:
        yield seen.in_base("nearest"), rr.Points3D([(float(given.ranges.min()), 0.0, 0.0)])


ENTRIES.plant("infinite_dot", "panel_draws", "panel")(Panel("infinite_dot", RangeScan, infinite_dot))


@ENTRIES.plant("reads_here", "scheme_refuses", "scheme")
def reads_here(argument: str, base: FilePath) -> World:
    """Reads from the folder where navloom was started, not from that of the config."""
    try:
        FilePath(argument).read_text("utf-8")
    except OSError as error:
        raise ValueError(str(error)) from None
    raise ValueError("no world")


@message
class Beat(Message):
    """A sign of life.

    Attributes:
        stamp_ns: Run clock.
    """

    stamp_ns: Stamp


@ENTRIES.plant("beats_in_seconds", caught_by="stamps", kind="node")
class BeatsInSeconds(NodePlugin):
    """Stamps in s."""

    ticks = True
    beat = Publishes(Beat)

    def step(self, tick: Tick) -> None:
        self.beat.put(Beat(tick.time_ns // 10**9))
