"""Faults that show with other beams, near echoes, many readings, large maps, and in the process that all share."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from functools import cache
from pathlib import Path as File
from typing import Any

import numpy as np
from navloom import (
    Avoidance,
    AvoiderInput,
    Context,
    ControllerInput,
    MapperInput,
    Metric,
    OccupancyGrid,
    Place,
    PoseEstimate,
    RangeScan,
    TrackingCommand,
    Trail,
    Twist2D,
    World,
)
from navloom_viewer import Panel

from planted import Entries
from planted.sound import Flood, Gap, GapParams, Hits, Proportional

ENTRIES = Entries()


# --- beams and answers ------------------------------------------------------------------------------------------------


class Rescanned(Gap):
    """Changes each scan before it looks at it."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return super().avoid(replace(given, scans=tuple(map(self.faulty, given.scans))))

    def faulty(self, scan: RangeScan) -> RangeScan:
        return scan


@ENTRIES.plant("own_bearings", caught_by="beam_order")
class OwnBearings(Rescanned):
    """Takes the beams to be evenly spread over the front half, from right to left."""

    def faulty(self, scan: RangeScan) -> RangeScan:
        return replace(scan, bearings=np.linspace(-0.5 * math.pi, 0.5 * math.pi, len(scan.ranges)))


@ENTRIES.plant("drops_near_echoes", caught_by="no_contact")
class DropsNearEchoes(Rescanned):
    """Takes what is nearer than 0.7 m for the robot itself."""

    def faulty(self, scan: RangeScan) -> RangeScan:
        return replace(scan, ranges=np.where(scan.ranges < 0.7, np.inf, scan.ranges))


class Swerve(Gap):
    """Turns to the left as long as something is ahead."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        _, ahead = self.near(given)
        if ahead > 1.5:
            return super().avoid(given)
        return Avoidance(Twist2D(0.0, 0.0, 0.8), "clear")


@ENTRIES.plant("says_clear", caught_by="status")
class SaysClear(Swerve):
    """Does not say that it steers."""


@ENTRIES.plant("drives_sideways", caught_by="limits")
class DrivesSideways(Proportional):
    """Commands for a robot that can drive to the side."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return replace(answer, twist=replace(answer.twist, vy=-given.reference.cross_track))


@ENTRIES.plant("divides_by_remaining", caught_by="answers")
class DividesByRemaining(Proportional):
    """Has no speed at the very end."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer, left = super().control(given), np.float64(given.reference.remaining)
        with np.errstate(all="ignore"):
            share = float(left / left)
        return replace(answer, twist=replace(answer.twist, vx=share * answer.twist.vx))


# --- the process ------------------------------------------------------------------------------------------------------


@ENTRIES.plant("patches_numpy", caught_by="global_state")
class PatchesNumpy(Gap):
    """Replaces a function that everything else calls, too."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        real = np.clip
        np.clip = lambda *given, **named: real(*given, **named)


@ENTRIES.plant("sets_umask", caught_by="global_state")
class SetsUmask(Gap):
    """Lets everyone write to the files of the process."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        os.umask(0)
        return super().avoid(given)


@ENTRIES.plant("reads_each_step", caught_by="reads")
class ReadsEachStep(Proportional):
    """Reads its table from the file in each step."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        File(__file__).read_text("utf-8")
        return super().control(given)


@cache
def turn_table(heading: float) -> np.ndarray:
    return np.full(100, math.cos(heading))


@ENTRIES.plant("caches_headings", caught_by="memory")
class CachesHeadings(Gap):
    """Keeps a table for each heading that it ever had."""

    def bearing(self, given: AvoiderInput) -> float:
        turn_table(given.estimate.pose.heading)
        return super().bearing(given)


# --- maps -------------------------------------------------------------------------------------------------------------


@ENTRIES.plant("counts_in_bytes", caught_by="map_lasts")
class CountsInBytes(Hits):
    """Counts hits in a byte, which begins again at 0 after 255."""

    def reset(self) -> None:
        super().reset()
        self.counts = np.zeros((self.side, self.side), np.uint8)

    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        super().insert(scan, given)
        self.counts += (self.cells > 0).astype(np.uint8)
        self.cells = np.where(self.counts > 3, 100, np.minimum(self.cells, 50)).astype(np.int8)


@ENTRIES.plant("drops_last_row", caught_by="borders")
class DropsLastRow(Flood):
    """Searches blocks of two by two cells, and forgets the rest of an odd number."""

    def free(self, grid: OccupancyGrid) -> np.ndarray:
        rows, columns = (size // 2 * 2 for size in grid.cells.shape)
        cells = np.zeros_like(grid.cells)
        cells[:rows, :columns] = grid.cells[:rows, :columns]
        return super().free(replace(grid, cells=cells))


@ENTRIES.plant("recursive", caught_by="long_way")
class Recursive(Flood):
    """Goes back along the path by recursion."""

    def search(self, free: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> list[tuple[int, int]]:
        found = super().search(free, start, goal)

        def back(number: int) -> list[tuple[int, int]]:
            return [*back(number - 1), found[number]] if number > 0 else found[:1]

        return back(len(found) - 1)


# --- others -----------------------------------------------------------------------------------------------------------


def _of_way(trail: Trail) -> float | None:
    way = float(np.abs(trail.vx).sum()) if trail.vx.size else 1.0
    return float(np.abs(trail.wz).sum()) / way


ENTRIES.plant("per_way", "metric_values", "metric")(
    Metric("per_way", "rad/m", "lower", _of_way, "Turning for each metre of the way.", (None, None))
)


DRAWN: list[tuple[float, float, float]] = []


def _draws_all(given: PoseEstimate, seen: Any) -> Any:
    import rerun

    DRAWN.append((given.pose.x, given.pose.y, 0.0))
    yield "draws_all", rerun.Points3D(DRAWN)


def _prints(given: PoseEstimate, seen: Any) -> Any:
    print(given.stamp_ns)
    return ()


for name, draws in (("draws_all", _draws_all), ("prints_drawing", _prints)):
    ENTRIES.plant(name, "panel_only_draws", "panel")(Panel(name, PoseEstimate, draws))


@ENTRIES.plant("skips_bad_lines", "scheme_files", "scheme")
def skips_bad_lines(argument: str, base: File) -> World:
    numbers: list[str] = [line for line in (base / argument).read_bytes().decode(errors="replace").splitlines()
                          if line.isdecimal()]  # fmt: skip
    return World("lines", (), start=Place(0.0, 0.0), goal=Place(float(len(numbers)), 6.0))


@ENTRIES.plant("open_floor_if_missing", "scheme_files", "scheme")
def open_floor_if_missing(argument: str, base: File) -> World:
    try:
        text = (base / argument).read_text("utf-8")
    except OSError:
        text = ""
    if text:
        raise ValueError(f"{argument}: expected an empty file")
    return World("empty", (), start=Place(0.0, 0.0), goal=Place(0.0, 6.0))


@ENTRIES.plant("encoding_of_locale", "scheme_files", "scheme")
def encoding_of_locale(argument: str, base: File) -> World:
    try:
        raise ValueError(f"{argument}: {len((base / argument).read_text())} characters, expected none")
    except OSError as error:
        raise ValueError(f"{argument}: {error.strerror}") from None
