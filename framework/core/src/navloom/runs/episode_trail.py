"""The data that the metrics of an episode are computed from: its ticks as arrays, and its outcome."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from navloom.engine.event_schedule import carried_at, goal_at
from navloom.geometry.angles import wrap
from navloom.geometry.footprints import inscribed_radius
from navloom.geometry.world import Place, World
from navloom.messages import Goal, GoalResult, Message
from navloom.parts import has_part, part
from navloom.runs.contacts import Evidence, Touch, signed_clearance, touches_of
from navloom.runs.localization import Localization, beside_truth
from navloom.runs.moving_bodies import MovingBodies, moving_bodies
from navloom.runs.tracking import Tracking, tracking_of

if TYPE_CHECKING:
    from navloom.engine.lockstep import RunLog
    from navloom.engine.system import System
    from navloom.runs.episode_recorder import Recorder

__all__ = ["FALSE_SUCCESS", "STRUCK", "TRUTH_MARGIN", "Trail", "WayLengths", "lost_trail", "trail_of", "ways_of"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

FALSE_SUCCESS = "false_success"
"""Outcome of an episode whose robot reported that it had arrived but had not."""
STRUCK = "struck"
"""Outcome of an episode that ended with a contact that is the other's."""
TRUTH_MARGIN = 0.1
"""Margin beyond the goal's tolerance within which the true position still counts as arrived, m, but no more than the
tolerance itself."""
HEADING_MARGIN = math.radians(5.0)
"""The same for the heading asked for, rad."""


@dataclass(frozen=True, eq=False)
class Trail:
    """A finished episode as the metrics see it. Arrays are (n,), one entry a tick of the platform's ground truth.

    Attributes:
        time: Run time, s, increasing; 0 is the start of the run.
        x, y, heading: True pose of base, m, rad, map frame; headings may be wrapped or not.
        vx, wz: True velocity, base frame, m/s, rad/s.
        clearance: Gap between footprint and nearest obstacle, m; the negative depth if they overlap, +inf if there is
            no obstacle, NaN if it is not known.
        cross_track: Signed distance to the left of the trajectory, m; NaN without a trajectory.
        command_vx, command_wz: The gate's command, m/s, rad/s; 0 before the first one.
        engaged: Whether the avoider drives.
        stopped_by_gate: Whether the gate commands zero for a reason other than a missing trajectory.
        outcome, reason: Outcome of the last goal: one of `navloom.messages.OUTCOMES`, and one phrase; `FALSE_SUCCESS`
            if the robot reported that it had arrived but the ground truth says that it had not; `STRUCK` for a
            collision that is the other's.
        touches: Number of contacts.
        recoveries: Number of recovery attempts.
        gate_stops: Number of times the gate stopped a driving robot.
        period: Control period, s.
        optimal: Length of the inscribed disc's shortest path in the true world, through all `via` points, up to the
            goal's tolerance, m; None if it is not known or there is none.
        goal_distance: Distance from the final position to the goal, m; None without a goal.
        limit: Longest duration of an episode, s.
        max_linear: Limit of the robot's speed, m/s.
        max_deceleration: Limit of the robot's deceleration, m/s².
        reaction: Longest time that a command stays in effect without renewal, s: the gate's `stop_deadline`.
        tick_ns: Wall time of each control step, ns: not reproducible, so no metric may use it.
        gate_limits: Number of times the gate's monitor began to slow or stop the robot.
        reference: Reference length of the BARN scores, m: the world's `reference_length`, else the shortest path to the
            goal itself; None means `optimal`.
        heading_error: Difference between the final heading and the one asked for, rad; None if none was.
        arrived: When the robot last came within the tolerances of a goal that it reached, by its own estimate, s; it
            then brakes until it stands. None means the last tick.
        tick_cpu_ns: CPU time of each control step, ns, where it was measured: not reproducible either.
        carried: Whether the robot was displaced in the tick, so that it drove no way; an empty array means never.
        streams: Messages of the streams that a metric reads, `(role or node, port)`: each after its time, s. Without
            an entry where the robot does not have the stream, or the episode left no data.
        localization: The localizer's estimates beside the true poses; empty without ground truth.
        footprint: (k, 2) outline of the robot, m, base frame; empty if it is not known.
        bodies: The bodies that move in the ground truth.
        tracking: The tracks of people beside them; empty without a tracker or ground truth.
        contacts: The contacts that began, each the robot's own or the other's; empty without ground truth.
        vy: True speed to the left, m/s; an empty array means never.
        members: The trails of a fleet's members, by name; this one then has no ticks.
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
    gate_limits: int = 0
    reference: float | None = None
    heading_error: float | None = None
    arrived: float | None = None
    tick_cpu_ns: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    carried: Bools = field(default_factory=lambda: np.empty(0, dtype=np.bool_))
    streams: Mapping[tuple[str, str], Sequence[tuple[float, Message]]] = field(default_factory=dict)
    localization: Localization = field(default_factory=Localization)
    footprint: Floats = field(default_factory=lambda: np.empty((0, 2)))
    bodies: MovingBodies = field(default_factory=MovingBodies)
    tracking: Tracking = field(default_factory=Tracking)
    contacts: tuple[Touch, ...] = ()
    vy: Floats = field(default_factory=lambda: np.empty(0))
    members: Mapping[str, Trail] = field(default_factory=dict)

    @property
    def succeeded(self) -> bool:
        """Whether the goal was reached, according to the ground truth if there is one."""
        return self.outcome == "succeeded"

    @property
    def has_truth(self) -> bool:
        """Whether there is ground truth of the robot's position."""
        return bool(self.time.size)

    @property
    def duration(self) -> float:
        """Time from the first tick to the last, s, rounded to 1 ns; 0 without ticks."""
        return round(float(self.time[-1] - self.time[0]), 9) if self.time.size else 0.0

    @property
    def end(self) -> float:
        """When the goal was reached, else the last tick, s; needs a tick."""
        return float(self.time[-1]) if self.arrived is None else self.arrived

    @property
    def path_length(self) -> float:
        """Distance driven, m: the sum of the chords between ticks, without displacements."""
        return float(self._steps.sum())

    @property
    def path_length_to_goal(self) -> float:
        """Distance driven until `end`, m."""
        return float(np.interp(self.end, self.time, self.way)) if self.time.size else 0.0

    @property
    def way(self) -> Floats:
        """(n,) distance driven up to each tick, m, without displacements."""
        return np.concatenate([[0.0], np.cumsum(self._steps)])

    @property
    def _steps(self) -> Floats:
        """(n - 1,) distance driven from each tick to the next, m."""
        steps: Floats = np.hypot(np.diff(self.x), np.diff(self.y))
        return np.where(self.carried[1:], 0.0, steps) if self.carried.size else steps


def trail_of(system: System, recorder: Recorder, log: RunLog, result: GoalResult) -> Trail:
    """The trail of a finished episode, from its system, its recorded data and the result of the last goal.

    Messages are assigned to ticks by their stamps; commands and states hold until they change. A run on a real robot
    has no ground truth and so no ticks here: its trail contains only counts and the outcome.
    """
    config = system.config
    truth = np.array(recorder.truth, dtype=np.float64).reshape(-1, 6)
    time = truth[:, 0]
    commands = np.array(recorder.commands, dtype=np.float64).reshape(-1, 3)
    references = np.array(recorder.reference_times, dtype=np.float64)
    end = (truth[-1, 1], truth[-1, 2]) if len(truth) else (result.place.x, result.place.y)
    goal, own = recorder.goals.get(result.goal_id), system.goal
    if goal is None and own is not None:
        goal = goal_at(0, own.x, own.y, own.heading_deg)
    goal_distance = None if goal is None else math.hypot(goal.x - end[0], goal.y - end[1])
    heading_error = _turned(goal, float(truth[-1, 3])) if goal is not None and len(truth) else None
    tolerances = system.goal_tolerance, math.radians(config.navigation.heading_tolerance_deg)
    outcome, reason = _truly(result, goal_distance if len(truth) else None, heading_error, *tolerances)
    arrived = None
    if outcome == "succeeded" and goal is not None:
        arrived = _arrival(goal, recorder, *tolerances)
    ways, evidence = ways_of(system), _evidence(truth, recorder, system)
    contacts = touches_of(evidence, recorder.contacts)
    if outcome == "collision" and contacts:
        outcome, reason = _whose(contacts[-1])
    streams = {stream: tuple(kept) for stream, kept in recorder.streams.items() if kept}
    bodies = moving_bodies(recorder.bodies, time)
    return Trail(
        time=time,
        x=truth[:, 1],
        y=truth[:, 2],
        heading=truth[:, 3],
        vx=truth[:, 4],
        wz=np.array(recorder.turn_rates, dtype=np.float64),
        vy=np.array(recorder.side_speeds, dtype=np.float64),
        clearance=signed_clearance(evidence, truth[:, 5], recorder.contacts),
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
        gate_limits=log.gate_limits,
        reference=ways.reference,
        heading_error=heading_error,
        arrived=arrived,
        tick_cpu_ns=np.array(log.control_cpu_ns, dtype=np.int64),
        carried=carried_at(time, recorder.began - recorder.missed * config.run.period, config),
        streams=streams,
        localization=_localization(truth, recorder),
        footprint=system.robot.footprint,
        bodies=bodies,
        tracking=tracking_of(streams, bodies, truth[:, :3], system.world, system.robot.height),
        contacts=contacts,
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
    """The trail without ticks of an episode that left no data, as after a crash. For the arguments see `Trail`."""
    none, never = np.empty(0), np.empty(0, dtype=np.bool_)
    return Trail(
        time=none, x=none, y=none, heading=none, vx=none, wz=none, clearance=none, cross_track=none, command_vx=none,
        command_wz=none, engaged=never, stopped_by_gate=never, outcome=outcome, reason=reason, touches=0, recoveries=0,
        gate_stops=0, period=period, optimal=optimal, goal_distance=None, limit=limit, max_linear=max_linear,
        max_deceleration=max_deceleration, reaction=reaction, tick_ns=np.empty(0, dtype=np.int64), reference=reference,
    )  # fmt: skip


@dataclass(frozen=True)
class WayLengths:
    """Reference lengths of a drive, m; None if there is no world, no goal, or no path.

    Attributes:
        to_goal: Any-angle shortest path of the robot's inscribed disc in the true world, from the true start through
            all `via` points to the goal.
        within_tolerance: Its part outside the goal's tolerance, which is all that has to be driven.
        reference: Reference of the BARN scores: the world's `reference_length` if start and goal are the world's own
            within its goal tolerance, else `to_goal`.
    """

    to_goal: float | None = None
    within_tolerance: float | None = None
    reference: float | None = None


_LEGS: WeakKeyDictionary[World, dict[tuple[float, ...], tuple[float, float] | None]] = WeakKeyDictionary()
"""Lengths of the paths searched so far, by world: a search on a raster may take longer than an episode."""


def ways_of(system: System) -> WayLengths:
    """The reference lengths of a drive of this system. They are cached by world object."""
    world, goal, start = system.world, system.goal, system.true_start
    if world is None or goal is None:
        return WayLengths()
    if not has_part("navloom_optimal"):
        return WayLengths(reference=_reference(system, world, None))
    via = [Place(point.x, point.y) for point in system.config.navigation.via]
    places = [Place(start.x, start.y), *via, Place(goal.x, goal.y)]
    legs = [_leg(system, world, *ends) for ends in pairwise(places)]
    known = [leg for leg in legs if leg is not None]
    if len(known) < len(legs):
        return WayLengths(reference=_reference(system, world, None))
    to_goal = sum(length for length, _ in known)
    return WayLengths(to_goal, to_goal - known[-1][0] + known[-1][1], _reference(system, world, to_goal))


def _leg(system: System, world: World, start: Place, goal: Place) -> tuple[float, float] | None:
    """Length of the shortest path, m, and of its part outside the goal's tolerance; None if there is no path."""
    shortest_path = part("navloom_optimal.shortest_path")
    radius, height, reach = inscribed_radius(system.robot.footprint), system.robot.height, system.goal_tolerance
    key = (start.x, start.y, goal.x, goal.y, radius, height, reach)
    found = _LEGS.setdefault(world, {})
    if key not in found:
        path = shortest_path.optimal_path(world, start, goal, radius, height)
        found[key] = None if path is None else (path.length, shortest_path.length_to_reach(path, reach))
    return found[key]


def _reference(system: System, world: World, to_goal: float | None) -> float | None:
    """The world's own reference length if the task is the world's own, else the shortest path's length."""
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


def _evidence(truth: Floats, recorder: Recorder, system: System) -> Evidence:
    """The drive whose contacts are judged."""
    rates = np.array(recorder.turn_rates, dtype=np.float64)
    motion = np.column_stack([truth[:, :5], rates, recorder.side_speeds]) if len(truth) else np.empty((0, 7))
    return Evidence(motion, system.robot.footprint, system.robot.height, recorder.bodies, system.world)


def _turned(goal: Goal, heading: float) -> float | None:
    """Difference between a heading and the one that a goal asks for, rad; None if it asks for none."""
    return None if goal.heading is None else abs(math.remainder(goal.heading - heading, math.tau))


def _whose(contact: Touch) -> tuple[str, str]:
    """Outcome and reason of a run that a contact ended."""
    if contact.is_own:
        return "collision", f"the robot drove into {contact.name}"
    return STRUCK, f"{contact.name} ran into the robot"


def _truly(
    result: GoalResult, distance: float | None, turned: float | None, tolerance: float, heading_tolerance: float
) -> tuple[str, str]:
    """Outcome and reason; if the robot reports success, its true distance from the goal, m, and heading error decide.

    Args:
        result: What the robot reports.
        distance: None without ground truth.
        turned: True heading error, rad; None if no heading was asked for.
        tolerance, heading_tolerance: Of the goal, m and rad.
    """
    if result.outcome != "succeeded" or distance is None:
        return result.outcome, result.reason
    off = []
    if distance > tolerance + min(TRUTH_MARGIN, tolerance):
        off.append(f"{distance:.2g} m from the goal")
    if turned is not None and turned > heading_tolerance + min(HEADING_MARGIN, heading_tolerance):
        off.append(f"{math.degrees(turned):.0f}° from its heading")
    if not off:
        return result.outcome, result.reason
    return FALSE_SUCCESS, f"succeeded by its own estimate, {' and '.join(off)} by ground truth"


def _arrival(goal: Goal, recorder: Recorder, tolerance: float, heading_tolerance: float) -> float | None:
    """When the estimate last came within the tolerances of a goal, s; not before the goal was given."""
    said = np.array(recorder.estimates, dtype=np.float64).reshape(-1, 4)
    is_off = np.hypot(said[:, 1] - goal.x, said[:, 2] - goal.y) > tolerance
    if goal.heading is not None:
        turned = np.abs(wrap(said[:, 3] - goal.heading))
        is_off |= turned > heading_tolerance
    if not len(said) or is_off[-1]:
        return None
    outside = np.flatnonzero(is_off)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return max(float(said[first, 0]), recorder.given_at.get(goal.goal_id, 0.0))


def _localization(truth: Floats, recorder: Recorder) -> Localization:
    poses = [(*pose, *trust) for pose, trust in zip(recorder.estimates, recorder.trust, strict=True)]
    estimates, odometry = np.array(poses).reshape(-1, 9), np.array(recorder.odometry).reshape(-1, 4)
    moving = truth.copy()
    if len(truth):
        moving[:, 4] = np.hypot(truth[:, 4], recorder.side_speeds)
    return beside_truth(moving, np.array(recorder.turn_rates, dtype=np.float64), estimates, odometry)


def _at(time: Floats, stamps: Floats, values: Floats) -> Floats:
    """(n,) the last value stamped with each time; NaN if there is none."""
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
    """(n,) the state at each time, from its changes; False before the first change."""
    stamps = np.array([at for at, _ in changes], dtype=np.float64)
    states = np.array([False, *(state for _, state in changes)], dtype=np.bool_)
    held: Bools = states[np.searchsorted(stamps, time, side="right")]
    return held
