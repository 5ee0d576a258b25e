"""Operators' requests by tick: the config's goal and its `[[event]]` tables."""

from __future__ import annotations

import math

from navloom.config.schema import Config
from navloom.config.tables import EventTable, PlaceTable
from navloom.inputs.assignments import assignments
from navloom.messages import Goal, OperatorRequest, Point2D

__all__ = ["goal_at", "schedule"]


def schedule(config: Config, goal: PlaceTable | None) -> dict[int, list[OperatorRequest]]:
    """Requests by tick: the run's own goal in tick 0, each event in the first tick at or after its time."""
    requests: dict[int, list[OperatorRequest]] = {}
    goals = 0
    if goal is not None and config.navigation.drive:
        goals += 1
        via = tuple(Point2D(point.x, point.y) for point in config.navigation.via)
        requests[0] = [OperatorRequest("goal", goal_at(goals, goal.x, goal.y, goal.heading_deg, via))]
    # Sorted by time, stable: goals are numbered in the order in which they happen, not that of the file.
    for event in sorted(config.event, key=lambda event: event.at):
        # Rounded first: a time that is a whole number of ticks must not fall into the next one.
        tick = math.ceil(round(event.at / config.run.period, 6))
        if event.do == "goal":
            goals += 1
        requests.setdefault(tick, []).append(_request(event, goals, config))
    return requests


def _request(event: EventTable, goals: int, config: Config) -> OperatorRequest:
    if event.do == "goal":
        assert event.x is not None and event.y is not None
        return OperatorRequest("goal", goal_at(goals, event.x, event.y, event.heading_deg))
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
