"""Plans one path on one map, without a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path as FilePath
from time import perf_counter_ns
from typing import Any

import numpy as np
from pydantic import ValidationError

from navloom.config import ConfigError, check_params
from navloom.config.config_presets import preset_values
from navloom.config.loader import parse_override
from navloom.config.tables import DEFAULT_PLUGINS, FootprintTable, MapTable, RobotTable, RunTable
from navloom.engine.build import grid_of, robot_spec
from navloom.engine.nodes.planner_node import with_unknown_named
from navloom.engine.random_streams import stream_source
from navloom.geometry.world import World
from navloom.messages import MapUpdate, OccupancyGrid, Path, PlanFailure, PlanRequest, Pose2D
from navloom.plugins import Discovery, PluginError
from navloom.plugins.error_origin import raised_in
from navloom.roles import Context, InputError, Planner, PlannerInput, Role
from navloom.roles.presets import named_plugin

__all__ = ["blamed", "map_update", "plan_once"]

LARGEST = 100.0
"""Longest side of a robot, m."""
POINT = 1e-6
"""Side length that represents a point robot, m."""


def map_update(grid: OccupancyGrid) -> MapUpdate:
    """A map without segments, so that planners use its cells."""
    return MapUpdate(0, grid, np.empty((0, 4)), ())


@contextmanager
def blamed(cls: type[Role]) -> Iterator[None]:
    """Makes a PluginError, with the line, of what a plugin raises; an InputError goes through."""
    try:
        yield
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(f"{cls.role} {cls.name} failed: {raised_in(error, cls)}") from error


def plan_once(
    reference: str,
    base: FilePath,
    start: tuple[float, float],
    goal: tuple[float, float],
    *,
    planner: str = DEFAULT_PLUGINS["planner"],
    changes: Sequence[str] = (),
    size: tuple[float, float] = (0.0, 0.0),
    resolution: float = MapTable().resolution,
    discovery: Discovery | None = None,
) -> dict[str, Any]:
    """Plan on a world's map.

    Args:
        reference: World reference.
        base: Base folder of relative paths.
        start, goal: x and y, m, map frame.
        planner: Name of the plugin.
        changes: Its parameters as `key=value`.
        size: Length and width of the robot, m; 0 is a point.
        resolution: Cell size for maps without a raster, m.

    Returns:
        `outcome` ("found" or the kind of failure), `reason`, `place`, `length_m`, `points`, `planner`, `planner_ms`.

    Raises:
        ConfigError: The request is wrong; PluginError: so is the planner, or what it gives.
    """
    _check_sizes(size, resolution)
    discovery = discovery or Discovery()
    name, preset = named_plugin(planner)
    cls = discovery.role("planner", name)
    assert issubclass(cls, Planner)
    params = check_params(
        cls.Params,
        {**preset_values(cls, preset, f"--planner {planner}"), **dict(map(parse_override, changes))},
        "--set",
    )
    world: World = discovery.world(reference, base)
    for name, (x, y) in (("--from", start), ("--to", goal)):
        _check_inside(name, x, y, world)
    length, width = (max(side, POINT) for side in size)
    robot = robot_spec(RobotTable(footprint=FootprintTable(length=length, width=width)))
    context = Context("plan", RunTable().period, robot, stream_source(0, "planner", "plan"), Pose2D(*start, 0.0))
    given = PlannerInput(
        PlanRequest(1, Pose2D(*start, 0.0), Pose2D(*goal, 0.0), True),
        map_update(grid_of(world, resolution, robot.height)),
    )
    with blamed(cls):
        cls.warm_up()
        plugin = cls(params, context)
        before = perf_counter_ns()
        answer = plugin.plan(given)
        spent = (perf_counter_ns() - before) * 1e-6
        if not isinstance(answer, (Path, PlanFailure)):
            raise TypeError(f"plan() gives {type(answer).__name__}, expected Path or PlanFailure")
    if isinstance(answer, Path):
        return {
            "outcome": "found", "reason": "", "place": None, "length_m": answer.length,
            "points": answer.points.tolist(), "planner": planner, "planner_ms": spent,
        }  # fmt: skip
    answer = with_unknown_named(answer, robot, world)
    return {
        "outcome": answer.kind, "reason": answer.detail, "place": [answer.place.x, answer.place.y], "length_m": None,
        "points": [], "planner": planner, "planner_ms": spent,
    }  # fmt: skip


def _check_sizes(size: tuple[float, float], resolution: float) -> None:
    if not all(0.0 <= side <= LARGEST for side in size):
        raise ConfigError(
            f"--size {size[0]:g},{size[1]:g}: expected a length and a width of 0 to {LARGEST:g} m; 0,0 is a point"
        )
    try:
        MapTable(resolution=resolution)
    except ValidationError:
        raise ConfigError(f"--resolution {resolution:g}: expected 0.005 to 1 m") from None


def _check_inside(name: str, x: float, y: float, world: World) -> None:
    left, low, right, high = world.bounds
    if not (left <= x <= right and low <= y <= high):
        raise ConfigError(
            f"{name} {x:g},{y:g}: outside the map, which reaches from ({left:g}, {low:g}) to ({right:g}, {high:g}) m"
        )
