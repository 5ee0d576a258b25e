"""What is wrong with a task before the first tick: checked against the true world, in simulation only."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom.config import ConfigError
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import inscribed_radius
from navloom.geometry.world import Place
from navloom.runtime.build import System

__all__ = ["check_places", "check_task", "place_problem"]


def check_task(system: System) -> None:
    """Refuse a start or goal that the robot cannot stand at in the true world.

    Raises:
        ConfigError: Occupied, naming the obstacle, outside the world, or no goal at all.
    """
    config = system.config
    gives_goal = any(event.do == "goal" for event in config.event)
    if (system.goal is None or not config.navigation.drive) and not gives_goal:
        raise ConfigError(
            "navigation.goal: is missing, and the world names none; give one, as in goal = { x = 0.0, y = 7.6 }"
        )
    check_places(system)


def check_places(system: System) -> None:
    """Refuse a start, or a goal of the config, that the robot cannot stand at in the true world. Raises ConfigError."""
    start, goal = system.true_start, system.goal
    problem = place_problem(system, start.x, start.y, start.heading)
    if problem:
        raise ConfigError(f"navigation.start: {problem}")
    if goal is not None:
        heading = None if goal.heading_deg is None else math.radians(goal.heading_deg)
        problem = place_problem(system, goal.x, goal.y, heading)
        if problem:
            raise ConfigError(f"navigation.goal: {problem}")


def place_problem(system: System, x: float, y: float, heading: float | None) -> str:
    """Why the robot cannot stand at a place of the true world, m and rad; empty where it can, or no world is known."""
    world, outline = system.world, system.robot.footprint
    if world is None:
        return ""
    left, low, right, high = world.bounds
    if not (left <= x <= right and low <= y <= high):
        return (
            f"({x:g}, {y:g}) is outside the world {world.name}, "
            f"which reaches from ({left:g}, {low:g}) to ({right:g}, {high:g}) m"
        )
    shape = outline if heading is not None else _disc(inscribed_radius(outline))
    gap, name = clearance(shape, Place(x, y, heading or 0.0), world, height=system.robot.height)
    return "" if gap > 0.0 else f"the robot does not fit at ({x:g}, {y:g}): occupied by {name}"


def _disc(radius: float) -> NDArray[np.float64]:
    """(16, 2) corners of a polygon within a disc: what a robot that may stand at any heading covers for certain."""
    angles = np.arange(16) * (math.tau / 16)
    return radius * np.column_stack((np.cos(angles), np.sin(angles)))
