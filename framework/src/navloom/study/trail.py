"""What an episode is measured by: its ticks as arrays, and what it came to."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.footprints import inscribed_radius
from navloom.geometry.overlap import overlap_depth
from navloom.geometry.world import Place, World
from navloom.messages import GoalResult

if TYPE_CHECKING:
    from navloom.engine.lockstep import RunLog
    from navloom.engine.system import System
    from navloom.study.recorder import Recorder

__all__ = ["FALSE_SUCCESS", "TRUTH_MARGIN", "Trail", "WayLengths", "lost_trail", "trail_of", "ways_of"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

FALSE_SUCCESS = "false_success"
"""Outcome of an episode whose robot said that it had arrived where it had not."""
TRUTH_MARGIN = 0.1
"""How much further than the goal's tolerance a robot that arrived may be from the goal in truth, m."""


@dataclass(frozen=True, eq=False)
class Trail:
    """A finished episode as the metrics see it. Arrays are (n,), one entry a tick of the platform's truth.

    Attributes:
        time: Run time, s, rising; 0 is when the run began.
        x, y, heading: True pose of base, m, rad, map frame; headings as they come, wrapped or not.
        vx, wz: True velocity, base frame, m/s, rad/s.
        clearance: Gap between footprint and nearest obstacle, m: negative where they overlap, by the depth; +inf where
            there is nothing to meet, NaN where it is not known.
        cross_track: Signed distance to the left of the trajectory, m; NaN where none is driven.
        command_vx, command_wz: The gate's command, m/s, rad/s; 0 before the first.
        engaged: The avoider drives.
        stopped_by_gate: The gate commands zero for another reason than that there is no trajectory.
        outcome, reason: How the last goal ended: one of `navloom.messages.OUTCOMES`, and one phrase; `FALSE_SUCCESS`
            where the robot said that it had arrived and the ground truth says that it had not.
        touches: How often a contact began.
        recoveries: Attempts.
        gate_stops: How often the gate stopped a driving robot.
        period: Control tick, s.
        optimal: Shortest way of the inscribed disc in the true world, through all `via` points, up to where it comes
            within the goal's tolerance, m; None where it is not known or there is none.
        goal_distance: From where the episode ended to the goal, m; None where there was no goal.
        limit: Longest time an episode may take, s.
        max_linear: Limit of the robot's speed, m/s.
        max_deceleration: Of the robot, m/s².
        reaction: Longest time a command may go on that nothing has renewed, s: the gate's `stop_deadline`.
        tick_ns: Wall time of each control step, ns: not reproducible, so no metric may use it.
        pose_error: How far the robot took itself to be from where it was, m; NaN where it said nothing or no truth is
            known. Empty stands for NaN throughout.
        gate_limits: How often the gate's monitor began to slow or stop the robot.
        reference: Length that the BARN scores are relative to, m: the world's `reference_length`, else the shortest way
            to the goal itself; None stands for `optimal`.
    """

    time: Floats
    x: Floats
    y: Floats
    heading: Floats
    vx: Floats
    wz: Floats
    clearance: Floats
    cross_track: Floats
    command_vx: Floats
    command_wz: Floats
    engaged: Bools
    stopped_by_gate: Bools
    outcome: str
    reason: str
    touches: int
    recoveries: int
    gate_stops: int
    period: float
    optimal: float | None
    goal_distance: float | None
    limit: float
    max_linear: float
    max_deceleration: float
    reaction: float
    tick_ns: NDArray[np.int64]
    pose_error: Floats = field(default_factory=lambda: np.empty(0))
    gate_limits: int = 0
    reference: float | None = None

    @property
    def succeeded(self) -> bool:
        """The goal was reached, in truth where truth is known."""
        return self.outcome == "succeeded"

    @property
    def has_truth(self) -> bool:
        """It is known where the robot really was."""
        return bool(self.time.size)

    @property
    def duration(self) -> float:
        """From the first tick to the last, s, to the ns; 0 without ticks."""
        return round(float(self.time[-1] - self.time[0]), 9) if self.time.size else 0.0

    @property
    def path_length(self) -> float:
        """Distance driven, m: the sum of the chords between ticks."""
        return float(np.hypot(np.diff(self.x), np.diff(self.y)).sum())


def trail_of(system: System, recorder: Recorder, log: RunLog, result: GoalResult) -> Trail:
    """The trail of a finished episode: what ran, what was collected, and how the last goal ended.

    What was published in a tick is found by its stamp; what says nothing in a tick holds on. A run on a real robot has
    no truth, and so no ticks here: what is counted and how it ended are all there is.
    """
    config = system.config
    truth = np.array(recorder.truth, dtype=np.float64).reshape(-1, 6)
    time = truth[:, 0]
    commands = np.array(recorder.commands, dtype=np.float64).reshape(-1, 3)
    references = np.array(recorder.reference_times, dtype=np.float64)
    end = (truth[-1, 1], truth[-1, 2]) if len(truth) else (result.place.x, result.place.y)
    goal = recorder.goals.get(result.goal_id) or (None if system.goal is None else (system.goal.x, system.goal.y))
    goal_distance = None if goal is None else math.hypot(goal[0] - end[0], goal[1] - end[1])
    outcome, reason = _truly(result, goal_distance if len(truth) else None, system.goal_tolerance)
    ways = ways_of(system)
    return Trail(
        time=time,
        x=truth[:, 1],
        y=truth[:, 2],
        heading=truth[:, 3],
        vx=truth[:, 4],
        wz=np.array(recorder.turn_rates, dtype=np.float64),
        clearance=_signed(truth, recorder, system),
        cross_track=_at(time, references, np.array(recorder.cross_tracks, dtype=np.float64)),
        command_vx=_held(time, commands[:, 0], commands[:, 1]),
        command_wz=_held(time, commands[:, 0], commands[:, 2]),
        engaged=_switched(time, recorder.engaged),
        stopped_by_gate=_switched(time, recorder.gate_stopped),
        outcome=outcome,
        reason=reason,
        touches=recorder.touches,
        recoveries=recorder.recoveries,
        gate_stops=log.gate_stops,
        period=config.run.period,
        optimal=ways.within_tolerance,
        goal_distance=goal_distance,
        limit=system.time_limit,
        max_linear=system.robot.max_linear,
        max_deceleration=system.robot.max_deceleration,
        reaction=config.gate.stop_deadline,
        tick_ns=np.array(log.control_ns or log.tick_ns, dtype=np.int64),
        pose_error=_pose_error(truth, recorder),
        gate_limits=log.gate_limits,
        reference=ways.reference,
    )


def lost_trail(
    outcome: str,
    reason: str,
    *,
    period: float,
    limit: float,
    max_linear: float,
    max_deceleration: float,
    reaction: float,
    optimal: float | None = None,
    reference: float | None = None,
) -> Trail:
    """The trail of an episode of which nothing is left, as after a crash: no ticks. Arguments as of `Trail`."""
    none, never = np.empty(0), np.empty(0, dtype=np.bool_)
    return Trail(
        time=none,
        x=none,
        y=none,
        heading=none,
        vx=none,
        wz=none,
        clearance=none,
        cross_track=none,
        command_vx=none,
        command_wz=none,
        engaged=never,
        stopped_by_gate=never,
        outcome=outcome,
        reason=reason,
        touches=0,
        recoveries=0,
        gate_stops=0,
        period=period,
        optimal=optimal,
        goal_distance=None,
        limit=limit,
        max_linear=max_linear,
        max_deceleration=max_deceleration,
        reaction=reaction,
        tick_ns=np.empty(0, dtype=np.int64),
        reference=reference,
    )


@dataclass(frozen=True)
class WayLengths:
    """Lengths that a drive is measured by, m; None where there is no world, no goal, or no way.

    Attributes:
        to_goal: Shortest way of the robot's inscribed disc in the true world, at any angle, from the true start through
            all `via` points to the goal.
        within_tolerance: The same up to where it comes within the goal's tolerance, which is all that has to be driven.
        reference: What the BARN scores are relative to: the world's `reference_length` where start and goal are the
            world's to within its goal tolerance, else `to_goal`.
    """

    to_goal: float | None = None
    within_tolerance: float | None = None
    reference: float | None = None


_LEGS: WeakKeyDictionary[World, dict[tuple[float, ...], tuple[float, float] | None]] = WeakKeyDictionary()
"""Of a world, the lengths of the ways searched for: a search on a raster takes longer than many an episode."""


def ways_of(system: System) -> WayLengths:
    """The lengths that a drive of this system is measured by. Kept by world object: one world is searched once."""
    world, goal, start = system.world, system.goal, system.true_start
    if world is None or goal is None:
        return WayLengths()
    via = [Place(point.x, point.y) for point in system.config.navigation.via]
    places = [Place(start.x, start.y), *via, Place(goal.x, goal.y)]
    legs = [_leg(system, world, *ends) for ends in pairwise(places)]
    known = [leg for leg in legs if leg is not None]
    if len(known) < len(legs):
        return WayLengths(reference=_reference(system, world, None))
    to_goal = sum(length for length, _ in known)
    return WayLengths(to_goal, to_goal - known[-1][0] + known[-1][1], _reference(system, world, to_goal))


def _leg(system: System, world: World, start: Place, goal: Place) -> tuple[float, float] | None:
    """Length of the shortest way, m, and of its part outside the goal's tolerance; None where there is no way."""
    from navloom.study.optimal.shortest import length_to_reach, optimal_path

    radius, height, reach = inscribed_radius(system.robot.footprint), system.robot.height, system.goal_tolerance
    key = (start.x, start.y, goal.x, goal.y, radius, height, reach)
    found = _LEGS.setdefault(world, {})
    if key not in found:
        path = optimal_path(world, start, goal, radius, height)
        found[key] = None if path is None else (path.length, length_to_reach(path, reach))
    return found[key]


def _reference(system: System, world: World, to_goal: float | None) -> float | None:
    """The world's own length for the world's own task, else the shortest way."""
    start, goal = system.true_start, system.goal
    if world.reference_length is None or world.start is None or world.goal is None or goal is None:
        return to_goal
    off = world.goal_tolerance or system.goal_tolerance
    is_own = (
        not system.config.navigation.via
        and math.hypot(start.x - world.start.x, start.y - world.start.y) <= off
        and math.hypot(goal.x - world.goal.x, goal.y - world.goal.y) <= off
    )
    return world.reference_length if is_own else to_goal


def _signed(truth: Floats, recorder: Recorder, system: System) -> Floats:
    """(n,) clearances, m, with the depth of the overlap where the simulator says contact."""
    clearance = truth[:, 5].copy()
    if system.world is not None:
        for row, name in recorder.contacts:
            time, x, y, heading = truth[row, :4].tolist()
            depth = overlap_depth(system.robot.footprint, Place(x, y, heading), system.world, name, time)
            clearance[row] = -depth if depth > 0.0 else 0.0
    return clearance


def _truly(result: GoalResult, distance: float | None, tolerance: float) -> tuple[str, str]:
    """Outcome and reason; where a robot says that it has arrived, its true distance from the goal, m, decides."""
    if result.outcome != "succeeded" or distance is None or distance <= tolerance + TRUTH_MARGIN:
        return result.outcome, result.reason
    return FALSE_SUCCESS, f"succeeded by its own estimate, {distance:.1f} m from the goal by ground truth"


def _pose_error(truth: Floats, recorder: Recorder) -> Floats:
    """(n,) distance between the pose estimated for each tick and the true one, m."""
    said = np.array(recorder.estimates, dtype=np.float64).reshape(-1, 4)
    time = truth[:, 0]
    return np.hypot(_at(time, said[:, 0], said[:, 1]) - truth[:, 1], _at(time, said[:, 0], said[:, 2]) - truth[:, 2])


def _at(time: Floats, stamps: Floats, values: Floats) -> Floats:
    """(n,) the value stamped with each time, the last one where there are more; NaN where there is none."""
    given = np.full(len(time), np.nan)
    if stamps.size:
        last = np.searchsorted(stamps, time, side="right") - 1
        there = (last >= 0) & (stamps[last] == time)
        given[there] = values[last[there]]
    return given


def _held(time: Floats, stamps: Floats, values: Floats) -> Floats:
    """(n,) the newest value at each time; 0 before the first."""
    last = np.searchsorted(stamps, time, side="right")
    return np.concatenate([[0.0], values])[last]


def _switched(time: Floats, changes: list[tuple[float, bool]]) -> Bools:
    """(n,) what holds at each time, from the times it changed; False before the first."""
    stamps = np.array([at for at, _ in changes], dtype=np.float64)
    states = np.array([False, *(state for _, state in changes)], dtype=np.bool_)
    held: Bools = states[np.searchsorted(stamps, time, side="right")]
    return held
