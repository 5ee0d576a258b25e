"""What happens during a run, by the config: operators' requests by tick, and disturbances of a simulated robot."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom.config.schema import Config
from navloom.config.tables import EventTable, PlaceTable
from navloom.inputs.assignments import assignments
from navloom.messages import Goal, OperatorRequest, Point2D
from navloom.roles import Disturbance

__all__ = ["carried_at", "disturbances", "goal_at", "schedule"]


def schedule(config: Config, goal: PlaceTable | None) -> dict[int, list[OperatorRequest]]:
    """Requests by tick: the run's own goal in tick 0, each event in the first tick at or after its time.

    A tick without requests is the last one of a disturbance: the run must not end before.
    """
    requests: dict[int, list[OperatorRequest]] = {}
    goals = 0
    if goal is not None and config.navigation.drive:
        goals += 1
        via = tuple(Point2D(point.x, point.y) for point in config.navigation.via)
        requests[0] = [OperatorRequest("goal", goal_at(goals, goal.x, goal.y, goal.heading_deg, via))]
    # Sorted by time, stable: goals are numbered in the order in which they happen, not that of the file.
    for event in sorted(config.event, key=lambda event: event.at):
        # Rounded first: a time that is a whole number of ticks must not fall into the next one.
        tick = math.ceil(round((event.at + event.over) / config.run.period, 6))
        if event.do == "actor":  # in the world from the start, see `engine.build`
            continue
        if event.do == "displace" or event.do == "slip":
            requests.setdefault(tick, [])
            continue
        if event.do == "goal":
            goals += 1
        requests.setdefault(tick, []).append(_request(event, goals, config))
    return requests


def disturbances(config: Config) -> tuple[Disturbance, ...]:
    """The displacements and slips of a config, by their beginning."""
    found = [_disturbance(event, event.do) for event in config.event if event.do == "displace" or event.do == "slip"]
    return tuple(sorted(found, key=lambda one: one.begin_ns))


def carried_at(time: NDArray[np.float64], first: float, config: Config) -> NDArray[np.bool_]:
    """(n,) whether the robot was displaced in each tick; empty if the config has no displacement.

    Args:
        time: (n,) run times of ticks, s, increasing.
        first: That of the platform's first tick, s.
        config: The config.
    """
    moves = [move for move in disturbances(config) if move.do == "displace"]
    ticks, carried = np.round((time - first) * 1e9), np.zeros(len(time) if moves else 0, dtype=np.bool_)
    for move in moves:
        # The last one is the first tick at or after its end.
        begin, end = np.searchsorted(ticks, (move.begin_ns, move.end_ns)).tolist()
        carried[begin : end + 1] = True
    return carried


def _disturbance(event: EventTable, do: Literal["displace", "slip"]) -> Disturbance:
    to = by = None
    if event.by is not None:
        by = (event.by.x, event.by.y, math.radians(event.by.heading_deg))
    elif event.x is not None and event.y is not None:
        to = (event.x, event.y, math.radians(math.remainder(event.heading_deg or 0.0, 360.0)))
    return Disturbance(do, round(event.at * 1e9), round(event.over * 1e9), to, by)


def _request(event: EventTable, goals: int, config: Config) -> OperatorRequest:
    if event.do == "goal":
        assert event.x is not None and event.y is not None
        return OperatorRequest("goal", goal_at(goals, event.x, event.y, event.heading_deg))
    assert event.do != "displace" and event.do != "slip" and event.do != "actor"
    if event.do == "place":
        assert event.x is not None and event.y is not None
        spread, heading_spread = event.sigma or (None, None)
        place = goal_at(0, event.x, event.y, event.heading_deg)
        return OperatorRequest("place", place, spread=spread, heading_spread=heading_spread)
    role = event.role or ""
    instance = event.name or (config.role_table(role).instance if role else "")
    return OperatorRequest(event.do, None, role, instance, assignments(event.values))


def goal_at(number: int, x: float, y: float, heading_deg: float | None, via: tuple[Point2D, ...] = ()) -> Goal:
    """A goal from the values of a config: m, degrees, map frame."""
    # A heading of 270 is -90 in messages; `remainder` of degrees is exact, of radians it is not.
    heading = None if heading_deg is None else math.radians(math.remainder(heading_deg, 360.0))
    return Goal(number, x, y, heading, via)
