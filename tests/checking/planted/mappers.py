"""Mappers and localizers with a fault each."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from navloom import LocalizerInput, MapperInput, MapUpdate, OccupancyGrid, Pose2D, PoseEstimate, RangeScan

from planted import Entries
from planted.sound import FromStart, Hits

ENTRIES = Entries()


@ENTRIES.plant("base_frame", caught_by="accurate")
class BaseFrame(Hits):
    """Forgets to turn the beams into the map."""

    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        poses = given.track.poses.copy()
        poses[:, 2] = 0.0
        super().insert(scan, replace(given, track=replace(given.track, poses=poses)))


@ENTRIES.plant("columns_first", caught_by="accurate")
class ColumnsFirst(Hits):
    """x by row and y by column."""

    def mark(self, x: np.ndarray, y: np.ndarray) -> None:
        origin = self.origin()
        super().mark(y - origin.y + origin.x, x - origin.x + origin.y)


@ENTRIES.plant("oldest_pose", caught_by="accurate")
class OldestPose(Hits):
    """Takes the first pose of the track for the last."""

    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        track = replace(given.track, poses=given.track.poses[::-1].copy())
        super().insert(scan, replace(given, track=track))


@ENTRIES.plant("moved_origin", caught_by="accurate")
class MovedOrigin(Hits):
    """Gives its map another origin than it used for the cells."""

    def update(self, given: MapperInput) -> MapUpdate | None:
        answer = super().update(given)
        if answer is None:
            return None
        origin = replace(answer.grid.origin, x=answer.grid.origin.x + 0.5)
        return replace(answer, grid=replace(answer.grid, origin=origin))


@ENTRIES.plant("no_echo_is_wall", caught_by="accurate")
class NoEchoIsWall(Hits):
    """Marks a wall at the sensor's range for each beam without an echo."""

    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        ranges = np.where(np.arange(len(scan.ranges)) % 2, 0.6, scan.ranges)
        super().insert(replace(scan, ranges=ranges), given)


@ENTRIES.plant("never_maps", caught_by="accurate")
class NeverMaps(Hits):
    def update(self, given: MapperInput) -> MapUpdate | None:
        super().update(given)
        return None


@ENTRIES.plant("cells_of_255", caught_by="answers")
class CellsOf255(Hits):
    def update(self, given: MapperInput) -> MapUpdate | None:
        answer = super().update(given)
        if answer is None:
            return None
        grid = OccupancyGrid(np.where(answer.grid.cells > 0, 127, 0), 0.1, answer.grid.origin)  # type: ignore[arg-type]
        return replace(answer, grid=grid)


@ENTRIES.plant("future_map", caught_by="answers")
class FutureMap(Hits):
    def update(self, given: MapperInput) -> MapUpdate | None:
        answer = super().update(given)
        return None if answer is None else replace(answer, stamp_ns=given.stamp_ns * 1000 + 10**12)


@ENTRIES.plant("keeps_map_over_reset", caught_by="reset_as_new")
class KeepsMapOverReset(Hits):
    is_made = False

    def reset(self) -> None:
        if not self.is_made:
            super().reset()
        self.is_made, self.due_ns = True, 0


@ENTRIES.plant("huge_map", caught_by="message_size")
class HugeMap(Hits):
    """Uses cells of one millimetre."""

    def update(self, given: MapperInput) -> MapUpdate | None:
        answer = super().update(given)
        if answer is None:
            return None
        return replace(answer, grid=OccupancyGrid(np.zeros((12_000, 12_000), np.int8), 0.001, answer.grid.origin))


@ENTRIES.plant("fails_without_echo", caught_by="odd_readings")
class FailsWithoutEcho(Hits):
    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        assert np.isfinite(scan.ranges).any()
        super().insert(scan, given)


# --- localizers -------------------------------------------------------------------------------------------------------


@ENTRIES.plant("at_zero", caught_by="accurate")
class AtZero(FromStart):
    """Takes the odometry frame for the map."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        return replace(super().localize(given), pose=given.odometry.pose)


@ENTRIES.plant("unturned_start", caught_by="accurate")
class UnturnedStart(FromStart):
    """Adds the start, but does not turn by its heading."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        start, seen = self.context.start, given.odometry.pose
        heading = math.remainder(start.heading + seen.heading, math.tau)
        return replace(super().localize(given), pose=Pose2D(start.x + seen.x, start.y + seen.y, heading))


@ENTRIES.plant("old_stamp", caught_by="answers")
class OldStamp(FromStart):
    """Publishes the stamp of the previous step."""

    before = 0

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        stamp, self.before = self.before, given.odometry.stamp_ns
        return replace(super().localize(given), stamp_ns=stamp)


@ENTRIES.plant("negative_variance", caught_by="answers")
class NegativeVariance(FromStart):
    def localize(self, given: LocalizerInput) -> PoseEstimate:
        return replace(super().localize(given), covariance=-np.eye(3))


@ENTRIES.plant("heading_beyond_pi", caught_by="answers")
class HeadingBeyondPi(FromStart):
    """Does not wrap its heading."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        answer = super().localize(given)
        return replace(answer, pose=replace(answer.pose, heading=answer.pose.heading + math.tau))


@ENTRIES.plant("drifts", caught_by="accurate")
class Drifts(FromStart):
    """Adds a growing error in each step."""

    steps = 0

    def reset(self) -> None:
        self.steps = 0

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        self.steps += 1
        answer = super().localize(given)
        return replace(answer, pose=replace(answer.pose, x=answer.pose.x + 0.001 * self.steps))
